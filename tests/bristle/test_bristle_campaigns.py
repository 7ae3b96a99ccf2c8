"""Campaigns of the second generator: of one tendon and of pairs, readable, silent about their cause."""

import ast
import json
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipelines.cli import main
from tests.bristle import CAUSES, PAIR_CAUSES, PAIR_PLANS, PLANS, SEEDS, laws, make_campaign
from tests.bristle.machine import PAIR_RANGES, random_pair, run_pair
from tests.bristle.make import generator
from tests.bristle.rig import Rig, run
from tests.bristle.sensors import toml, write_shape
from tests.bristle.sheath import sheath_of
from tests.campaigns import SEEDS as FIRST_SEEDS
from tssgeom.io.formats.campaigns import read_campaign

COLUMNS = {
    name: f"{name}_{'N' if name.startswith('tension') else 'm'}" for plan in PLANS.values() for name in plan
}


def contents(folder):
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


def test_it_imports_nothing_of_what_it_judges_and_nothing_of_the_first_generator():
    for file in Path(__file__).parent.glob("*.py"):
        if not file.name.startswith("test_"):
            tree = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
            names = [node.module or "" for node in tree if isinstance(node, ast.ImportFrom)]
            names += [alias.name for node in tree if isinstance(node, ast.Import) for alias in node.names]
            for name in names:
                assert name.split(".")[0] not in ("tssgeom", "pipelines", "benchmarks"), file
                assert not name.startswith(("tests.lumped", "tests.campaigns")), file


def test_a_seed_gives_its_campaign_digit_by_digit_and_splits_share_no_rig(tmp_path):
    truth = make_campaign(tmp_path / "one", 4, "wear")
    assert make_campaign(tmp_path / "again", 4, "wear") == truth
    assert contents(tmp_path / "again") == contents(tmp_path / "one")
    sealed = make_campaign(tmp_path / "test", 4, "wear", split="test")
    assert sealed.friction != truth.friction
    bases = sorted([*SEEDS.values(), *FIRST_SEEDS.values()])
    assert min(np.diff(bases)) >= 1_000_000
    with pytest.raises(ValueError, match="0 to 999999"):
        make_campaign(tmp_path / "far", 1_000_000)


def test_half_the_size_is_the_same_rig_with_half_the_law(tmp_path):
    full, half = (make_campaign(tmp_path / f"{size}", 1, "end_stretch", size) for size in (1.0, 0.5))
    assert (half.friction, half.length_m, half.plan) == (full.friction, full.length_m, full.plan)
    values = [np.interp([3.0, 6.0, 9.0], one.law["x"], one.law["value"]) for one in (full, half)]
    assert values[1] == pytest.approx(0.5 * values[0], abs=2e-6)


@pytest.mark.parametrize("cause", ["", *CAUSES])
def test_the_program_reads_every_campaign_and_no_file_says_the_cause(cause, tmp_path):
    plan = CAUSES[cause].plans[0] if cause else "full"
    begin = time.process_time()
    truth = make_campaign(tmp_path / "case", 2, cause, plan=plan)
    assert time.process_time() - begin < 20.0
    campaign = read_campaign(tmp_path / "case")
    assert 3 <= len(campaign.runs) <= 6
    for run_ in campaign.runs:
        assert {COLUMNS[name] for name in PLANS[plan]} <= set(run_.columns)
        assert np.min(run_.columns["tension_in_N"]) > 0.5
    assert [one.held_out for one in campaign.runs].count(True) == 1
    for text in contents(tmp_path / "case").values():
        assert not cause or cause.encode() not in text
    assert json.loads((tmp_path / "case.truth.json").read_text())["mechanism"] == truth.mechanism
    if truth.law:
        assert len(truth.law["x"]) == len(truth.law["value"])
        assert np.ptp(truth.law["value"]) > 0.0


@pytest.mark.parametrize("cause", ["", *PAIR_CAUSES])
@pytest.mark.parametrize("plan", PAIR_PLANS)
def test_runs_of_a_pair_have_the_channels_of_a_machine(cause, plan, tmp_path):
    truth = make_campaign(tmp_path / "pair", 3, cause, plan=plan)
    head = (tmp_path / "pair" / "run_1.csv").read_text().splitlines()[0].split(",")
    assert [name.rpartition("_")[0] for name in head] == ["time", *PAIR_PLANS[plan]]
    assert truth.plan == plan
    with pytest.raises(ValueError, match="does not show"):
        make_campaign(tmp_path / "wrong", 3, "wear", plan=plan)


def test_a_law_of_friction_is_one_at_its_reference():
    assert laws.stribeck(0.25, 4e-3, 6.0, 0.01)(np.array(0.01)) == pytest.approx(1.0)
    assert laws.saturating(0.8, 4.0, 8.0)(np.array(8.0)) == pytest.approx(1.0)
    assert laws.quadratic(0.5, 9.0)(np.array(9.0)) == pytest.approx(1.0)
    for law in (laws.worn(-0.3, 0.01), laws.run_in(0.3, 0.01), laws.warming(-0.3, 5.0)):
        assert law(np.array(0.0)) == pytest.approx(1.0)
    assert laws.stretches(((0.2, 0.05, 1.0),), 0.01)(np.array([0.0, 0.2])) == pytest.approx([1.0, 2.0])


def test_sums_of_elements_are_the_laws_that_they_stand_for():
    t = np.geomspace(0.1, 100.0, 50)
    assert laws.crept(laws.prony(0.25, 0.1))(t) == pytest.approx(0.1 * t**0.25, rel=0.04)
    at, share = laws.dahl(0.2e-3)
    x = np.linspace(0.0, 1e-3, 50)
    sum_ = sum(w * np.minimum(x / z, 1.0) for w, z in zip(share, at, strict=True))
    assert sum_ == pytest.approx(-np.expm1(-x / 0.2e-3), abs=0.01)


def test_play_and_lag_are_those_of_their_width_and_time():
    course = np.interp(np.arange(300.0), [0, 100, 200, 299], [0, 2e-3, 1e-3, 3e-3])
    behind = laws.play(course, 0.3e-3)
    assert behind[100] == pytest.approx(2e-3)
    assert behind[200] == pytest.approx(1.3e-3)
    t = np.arange(0.0, 2.0, 0.01)
    assert laws.late(3.0 * t, t, 0.1)[-1] == pytest.approx(3.0 * (t[-1] - 0.1), abs=1e-6)


def simulated(folder, drive, rig):
    """Run `tssgeom simulate` on files of a folder and return its columns."""
    (folder / "rig.toml").write_text(toml(rig))
    names = list(drive)
    rows = [
        ",".join(names),
        *(",".join(f"{v:.10g}" for v in row) for row in zip(*drive.values(), strict=True)),
    ]
    (folder / "drive.csv").write_text("\n".join(rows) + "\n")
    call = ["simulate", folder / "shape.csv", "--drive", folder / "drive.csv", "--rig", folder / "rig.toml"]
    with pytest.raises(SystemExit) as ended:
        main([*map(str, call), "--out", str(folder / "out"), "--quiet"])
    assert ended.value.code == 0
    table = pq.read_table(folder / "out" / "simulate.parquet")
    return {name: table[name].to_numpy() for name in table.column_names}


def bend(folder):
    """Write the shape of an even bend of 4 rad and return the sheath."""
    sheath = sheath_of(np.tile([8.0, 0.0], (1601, 1)), 0.5)
    write_shape(folder / "shape.csv", sheath.s[::10], sheath.points[::10], millimetres=True)
    return sheath


def test_model_and_generator_agree_on_a_tendon(tmp_path):
    sheath = bend(tmp_path)
    rig = Rig(0.15, 3e-4, 3.0, 800.0, [sheath])
    t = np.arange(1, 301) / 50.0
    drive = np.interp(t, [0.0, 2.0, 2.5, 4.0, 6.0], [0.0, 9e-3, 9e-3, 3e-3, 7e-3])
    true = run(rig, sheath, t, drive, laws.Acts())
    model = simulated(
        tmp_path,
        {"time_s": t, "displacement_in_m": drive},
        {
            "tendon": {"compliance_per_N": 3e-4, "pretension_N": 3.0},
            "friction": {"coefficient": 0.15},
            "load": {"stiffness_N_per_m": 800.0},
            "shape": {"noise_mm": 0.001},
        },
    )
    for name, most in (("tension_in_N", 2e-3), ("tension_out_N", 1e-4), ("displacement_out_m", 1e-7)):
        difference = model[name] - true[name.rpartition("_")[0]]
        assert np.sqrt(np.mean(difference**2)) < most


def test_model_and_generator_agree_on_a_pair(tmp_path):
    sheath = bend(tmp_path)
    pair = random_pair(generator(1, "development", ""))
    t = np.arange(1, 301) / 50.0
    motor = np.interp(t, [0.0, 1.5, 4.0, 4.5, 6.0], [0.0, 0.4, -0.4, -0.4, 0.2])
    true = run_pair(pair, sheath, t, motor)
    model = simulated(
        tmp_path,
        {"time_s": t, "motor_angle_rad": motor},
        {
            "drive": {"kind": "pair", "radius_m": pair.pulley},
            "end": {"kind": "joint", "radius_m": pair.arm, "stiffness_Nm_per_rad": pair.stiffness},
            "tendon": {"compliance_per_N": pair.compliance, "pretension_N": pair.pretension},
            "friction": {"coefficient": pair.friction},
            "shape": {"noise_mm": 0.001},
        },
    )
    bounds = {
        "joint_angle_rad": 1e-5,
        "tension_in_1_N": 0.01,
        "tension_in_2_N": 0.01,
        "tension_out_1_N": 0.01,
    }
    for name, most in bounds.items():
        difference = model[name] - true[name.rpartition("_")[0]]
        assert np.sqrt(np.mean(difference**2)) < most
    assert np.min(true["tension_in_2"]) > PAIR_RANGES.slack_N


@pytest.mark.parametrize(
    ("cause", "channel", "noise"),
    [("load_play", "displacement_out_m", 2e-6), ("presliding", "tension_in_N", 0.02)],
)
def test_what_has_no_law_in_the_model_is_far_above_the_noise(tmp_path, cause, channel, noise):
    runs = []
    for size in (1.0, 1e-3):
        make_campaign(tmp_path / str(size), 6, cause, size)
        runs.append(read_campaign(tmp_path / str(size)).runs)
    changes = [a.columns[channel] - b.columns[channel] for a, b in zip(*runs, strict=True)]
    assert np.sqrt(np.nanmean(np.square(np.concatenate(changes)))) > 15.0 * noise
