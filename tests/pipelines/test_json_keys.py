"""What commands print and write as JSON has the keys of docs/reference/json.md, and no others."""

import json
import select
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.described import KINDS, described, optional
from tests.pipelines.conftest import half_circle
from tests.worked_finding import worked_finding
from tssgeom.identify.finding import LawCurve
from tssgeom.identify.proposal import ExpectedEvidence, NarrowedInterval, Proposal, ProposedRun
from tssgeom.io.results.findings import report_object
from tssgeom.route.pieces import Arcs

SAMPLES = Path(__file__).parents[2] / "sample_shapes"
CLEAN = SAMPLES / "campaign_clean"
ROUTE, RUN, RIG = (CLEAN / name for name in ("route_half_circle.csv", "half_slow.csv", "rig.toml"))


def test_analyse_writes_the_keys_of_the_reference(run, tmp_path, recording, write_csv):
    title, rig, rng = "analyse --json, batch --json", tmp_path / "rig.toml", np.random.default_rng(1)
    rig.write_text('[shape]\nsource = "fbg"\n')
    lines = [write_csv(f"{k}.csv", half_circle(300.0, 80) + rng.normal(0.0, 0.2, (80, 3))) for k in range(3)]
    objects = [json.loads(run("analyse", SAMPLES / "colon_fibre.csv", "--rig", rig, "--json").out)]
    objects += json.loads(run("analyse", *lines, recording, "--json").out)
    objects += json.loads(run("analyse", *lines, "--same", "--json").out)
    assert set().union(*(described(title, each) for each in objects)) == optional(title)


def test_batch_writes_the_keys_of_the_reference(run, tmp_path, recording, half):
    out = tmp_path / "out"
    done = run("batch", recording, half, "--out", out, "--no-pictures", "--json")
    for each in json.loads(done.out):
        described("analyse --json, batch --json", each)
    described("run.json", json.loads((out / "run.json").read_text("utf-8")))
    described("verify --json", json.loads(run("verify", out, "--json").out))


def test_simulate_compensate_and_calibrate_write_the_keys_of_the_reference(run, tmp_path, write_csv):
    given = ("--rig", RIG, "--out", tmp_path, "--json")
    described("simulate --json", json.loads(run("simulate", ROUTE, "--drive", RUN, *given).out))
    time = np.linspace(0.0, 4.0, 81)
    move = np.column_stack((time, 1e-3 * (1 - np.cos(2 * np.pi * time / 4))))
    target, rig = write_csv("target.csv", move, "time_s,displacement_out_m"), tmp_path / "limited.toml"
    rig.write_text(RIG.read_text("utf-8") + "\n[drive]\nlimits.tension_N = 5.0\n")
    done = run("compensate", ROUTE, "--target", target, "--tolerance-mm", "0.1", *given, "--rig", rig)
    report = json.loads(done.out)
    assert report["limited"]
    described("compensate --json", report)
    done = run("calibrate", RUN, "--shape", ROUTE, *given, "--out", tmp_path / "rig.toml")
    described("calibrate --json, calibration.json", json.loads(done.out))


@pytest.mark.parametrize("verdict", ["none", "effect", "law", "tie", "unknown"])
def test_a_finding_has_the_keys_of_the_reference(verdict):
    title, finding = "discover --json, report.json", worked_finding("effect" if verdict == "law" else verdict)
    if verdict == "law":
        x = np.array([1.0, 2.0])
        law = LawCurve("tension [N]", x, x, x, x, "1", (("stribeck", 3.0),))
        finding = replace(finding, effects=(replace(finding.effects[0], law=law),), proposal=_proposal())
    assert described(title, json.loads(json.dumps(report_object(finding, "1")))) == optional(title)


def _proposal() -> Proposal:
    x, channel = np.array([0.0, 1.0]), {"tension_out_N": np.zeros(2)}
    arcs, expected = Arcs.exact(0.5, 2.0), (ExpectedEvidence("a", "b", 9.0),)
    one = ProposedRun(
        *("run_1", "half_circle", "half_slow", arcs, ("tension_in_N",), x, x[:, None], x, x[:, None]),
        *("why", ("if a",), expected),
        channels={"a": channel},
        differences={"b": channel},
        sigma=channel,
        clearest="tension_out_N",
    )
    narrowed = NarrowedInterval("friction", 0.1, "1", 0.02, 0.01)
    return Proposal("sentence", ("a", "b"), {"tension_N": 9.0}, ("tension_N",), (one,), narrowed, "tension")


def test_check_writes_the_keys_of_the_reference(run, tmp_path, recording, half):
    fibre, bad = tmp_path / "fibre.csv", tmp_path / "bad.csv"
    s = np.linspace(0, 500, 40)
    table = np.column_stack((s, 0 * s + 0.004, 0.002 * np.sin(s)))
    np.savetxt(fibre, table, delimiter=",", header="s_mm,kappa_x_per_mm,kappa_y_per_mm", comments="")
    bad.write_text("x,y\n1,2\n")
    of = {
        "check --json of a shape or recording": (half, recording, fibre),
        "check --json of a measured run, rig or mesh": (RUN, RIG, SAMPLES / "colon_lumen.ply"),
        "check --json of a campaign": (CLEAN,),
        "check --json of what cannot be used": (bad,),
    }
    for title, files in of.items():
        reports = [json.loads(run("check", file, "--json").out)[0] for file in files]
        written = set().union(*(described(title, each) for each in reports))
        assert written == optional(title) - ({"warnings"} if files == (bad,) else set())


def test_remedy_and_paper_write_the_keys_of_the_reference(run, tmp_path):
    few = ("--trials", "20", "--most-beta-deg", "180", "--json")
    reports = [
        json.loads(run("remedy", "--shape", SAMPLES / "half_circle.csv", *few, *tolerance).out)
        for tolerance in ((), ("--tolerance-percent", "100"), ("--tolerance-mm", "0.08"))
    ]
    written = set().union(*(described("remedy --json, remedy.json", each) for each in reports))
    assert written == optional("remedy --json, remedy.json")
    described("paper --json", json.loads(run("paper", "--out", tmp_path, "--json").out))


def test_a_stream_writes_the_keys_of_the_reference(tmp_path):
    files = ("--record", tmp_path / "a.rrd", "--state", tmp_path / "s", "--write-rig", tmp_path / "r.toml")
    command = [
        Path(sys.executable).parent / "tssgeom",
        "live",
        "--source",
        "-",
        "--source",
        "tcp://127.0.0.1:0",
    ]
    options = ("--stats", "--adapt", "--view", "--view-port", str(_free_port()), "--stale-after", "0.5")
    options += ("--deadline-ms", "1")  # the first fit takes longer
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen([*command, *map(str, files), *options], **pipes) as stream:
        ready = _line(stream.stderr, b"ready").decode()
        port = int(ready.partition("tcp://127.0.0.1:")[2].split()[0].strip(","))
        with socket.create_connection(("127.0.0.1", port), 10) as client:
            client.sendall(b"GET / HTTP/1.1\r\n\r\n")
            described("live: a client is cut off", json.loads(client.makefile().readline()))
        points = half_circle(count=12).round(6).tolist()
        for frame in ({"t": 0.1, "unit": "mm", "points": points, "tension_in_N": 5.0}, {"t": 0.2}):
            stream.stdin.write(json.dumps(frame).encode() + b"\n")
            stream.stdin.flush()
        wanted = {
            "a late answer",
            "an answer",
            "a rejected frame",
            "silence",
        }  # beside other work in any order
        while wanted:
            answer = json.loads(stream.stdout.readline())
            described(f"live: {(title := _title(answer))}", answer)
            wanted.discard(title)
        title = "live --stats"
        written = described(title, json.loads(_line(stream.stderr, b'"t"')))
        assert written == optional(title)
        stream.send_signal(signal.SIGTERM)
        stream.stdin.close()
        assert stream.wait(30) == 0


def _title(answer: dict[str, Any]) -> str:
    """Return what an answer of a stream is."""
    if answer.get("stale"):
        return "a late answer" if "late" in answer else "silence"
    return "a rejected frame" if "rejected" in answer else "an answer"


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def _line(pipe, part: bytes) -> bytes:
    """Return the next line with this in it."""
    while select.select([pipe], [], [], 60)[0] and (line := pipe.readline()):
        if part in line:
            return line
    raise AssertionError(f"no line with {part!r}")


def test_every_object_of_the_reference_is_tested():
    texts = [path.read_text("utf-8") for path in Path(__file__).parent.glob("test_*.py")]
    by_struct = {"the file of track --calibrate"}  # the struct that is written
    titles = {title: title.removeprefix("live: ") for title in KINDS.keys() - by_struct}
    assert [title for title, part in titles.items() if not any(part in text for text in texts)] == []
