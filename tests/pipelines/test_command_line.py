"""The console script: help, usage errors, exit status, one line for each error."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.text import Text

from pipelines.cli import COMMANDS, command

ROOT = Path(__file__).parents[2]


def console(*arguments, **options) -> subprocess.CompletedProcess[str]:
    code = "from pipelines.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


def test_the_readme_has_a_row_for_every_command_and_every_command_a_file():
    table = (ROOT / "README.md").read_text("utf-8").partition("## Commands")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `tssgeom (\w+)", table, re.MULTILINE)) == set(COMMANDS)
    functions = [command(name) for name in COMMANDS]
    assert [(each.__module__, each.__name__) for each in functions] == [
        (f"pipelines.{name}", name) for name in COMMANDS
    ]


def test_help_has_the_first_sentence_of_every_command_whole(run):
    listed = " ".join(run("--help").out.split())
    sentences = [(inspect.getdoc(command(name)) or "").partition("\n\n")[0] for name in COMMANDS]
    assert [
        text for text in sentences if not text.endswith(".") or " ".join(text.split()) not in listed
    ] == []


def test_the_name_alone_prints_the_help_and_is_no_success(run):
    outcome = run()
    assert outcome.status == 2
    assert outcome.out == run("--help").out
    assert outcome.errors == []


def test_a_misspelt_command_is_refused_with_the_one_that_is_meant(run):
    outcome = run("analyze", "a.csv")
    assert outcome.status == 2
    assert "Did you mean 'analyse'?" in outcome.errors[0]


def test_a_wrong_option_is_refused_with_the_help_of_its_command(run):
    outcome = run("analyse", "a.csv", "--ouut", "b")
    assert outcome.status == 2
    assert outcome.errors[0].endswith(": see tssgeom analyse --help")


def test_version_is_printed(run):
    outcome = run("--version")
    assert outcome.status == 0
    assert outcome.out.startswith("tssgeom ")


@pytest.mark.parametrize("words", [["analyse", ""], ["check", ""], ["analyse", "x.csv", "--out", ""]])
def test_an_empty_argument_is_no_path_to_where_one_happens_to_be(run, words):
    outcome = run(*words)
    assert outcome.status == 2
    assert outcome.errors == ["tssgeom: an argument is empty: is a variable of the shell not set?"]


def test_no_help_has_a_unit_that_the_terminal_takes_for_a_style():
    helps = [
        str(parameter.annotation.__metadata__[0].help)
        for name in COMMANDS
        for parameter in inspect.signature(command(name), eval_str=True).parameters.values()
    ]
    assert len(helps) > 100
    assert [text for text in helps if Text.from_markup(text).plain != text] == []


def test_documents_state_the_version_and_its_date_alike():
    cited = dict(re.findall(r"^(version|date-released): (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M))
    (newest, day), *_ = re.findall(
        r"^## (\d\S+) \((\S+)\)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M
    )
    assert (newest, day) == (cited["version"], cited["date-released"])
    (mended,) = re.findall(r"^\| (\S+) \| yes \|$", (ROOT / "SECURITY.md").read_text("utf-8"), re.M)
    assert mended == newest.rpartition(".")[0]


def test_help_of_analyse_has_the_default_tension(run):
    outcome = run("analyse", "--help")
    assert outcome.status == 0
    assert "15" in outcome.out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["no-such-command"], "no-such-command"),
        (["analyse"], "Missing argument"),
        (["analyse", "a.csv", "--unit", "inch"], "--unit"),
        (["analyse", "a.csv", "--tension-in", "-1"], "--tension-in"),
        (["analyse", "a.csv", "--tension-in", "nan"], "--tension-in"),
        (["analyse", "a.csv", "--tension-in", "inf"], "finite"),
        (["analyse", "a.csv", "--no-such-option"], "--no-such-option"),
        (["analyse", "a.csv", "--rig", "missing.toml"], "missing.toml: cannot read the rig file"),
        (["analyse", "a.csv", "--tube-mm", "-1"], "--tube-mm is -1 mm"),
        (["analyse", "a.csv", "--figures", "--out", "o"], "--figures has no value: --out follows it"),
        (["analyse", "missing.csv"], "missing.csv: no such file: check the path"),
        (["batch", "a.csv"], "--out"),
        (["check", "missing.csv"], "missing.csv: no such file"),
        (["view", "missing"], "missing: no such file or folder"),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(run, arguments, expected):
    outcome = run(*arguments)
    assert outcome.status == 2
    assert len(outcome.errors) == 1
    assert expected in outcome.errors[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "[tendon]\nstiffness = 3",
            "unknown field `stiffness` - at `$.tendon`; there are compliance_per_N, ",
        ),
        ("[end]\nradius_mm = 8", "at `$.end`; did you mean radius_m?"),
        ("[frction]\ncoefficient = 0.1", "did you mean friction?"),
        ('[drive]\nkind = "pairs"', "at `$.drive.kind`; did you mean pair?"),
        ('[shape]\nsource = "centerline"', "at `$.shape.source`; did you mean centreline?"),
        ('[shape]\nsource = "optical"', "there are markers, em, fbg, centreline, smoothed"),
        ('[friction]\ncoeficient = "unknown"', "did you mean friction.coefficient?"),
        ("[sensors.tension_in_N]\nnoize = 1", "unknown field `noize`"),
    ],
)
def test_a_rig_with_an_unknown_key_is_refused_with_its_path_and_the_nearest_one(
    run, half, tmp_path, text, expected
):
    (tmp_path / "rig.toml").write_text(text)
    outcome = run("analyse", half, "--rig", tmp_path / "rig.toml")
    assert outcome.status == 2
    assert "rig.toml" in outcome.errors[0]
    assert expected in outcome.errors[0]


def test_an_empty_folder_is_refused(run, tmp_path):
    outcome = run("analyse", tmp_path)
    assert outcome.status == 2
    assert "no shape file in this folder" in outcome.errors[0]


def test_stdout_holds_only_json_and_stderr_no_traceback(half, tmp_path):
    ended = console("analyse", half, tmp_path / "missing.csv", "--json")
    assert ended.returncode == 1
    assert ended.stdout.startswith("[")
    assert ended.stderr.splitlines() == [f"tssgeom: {tmp_path / 'missing.csv'}: no such file: check the path"]


def test_a_reader_that_stops_early_is_no_error(half):
    code = "from pipelines.cli import main; main()"
    command = f"{sys.executable} -c '{code}' check {half} | true"
    ended = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False
    )
    assert ended.returncode in (0, 1)
    assert "Traceback" not in ended.stderr
