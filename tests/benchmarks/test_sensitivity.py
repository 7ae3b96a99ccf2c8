"""The sensitivity benchmark lists every tuned constant, changes it in its module, and names what moves."""

from pathlib import Path

import pytest

from benchmarks import sensitivity
from benchmarks.changed import edit
from benchmarks.sensitivity import ABSENT, ROOT, changes, constants, listing

WITHOUT_ORIGIN = 0
"""Constants without an origin today; lower this as origins are written. The goal is 0."""

LIMITS = '''"""Where points are outliers: Größe."""

from dataclasses import dataclass
from typing import NamedTuple

WIDTH = 3.0


@dataclass(frozen=True, slots=True)
class OutlierLimits:
    """Limits of a point."""

    quantile: float = 0.9999
    """Of the chance of a false alarm [1]; derived: one in ten thousand."""
    neighbours: int = 3
    """Points beside it [1]. Fitted: on chains of 30 points."""
    scales: tuple[float, ...] = (1.0, 2.0**3)
    """Without a unit or a reason."""
    name: str = "ü"; floor: float = 1e-3
    """Least spacing [m]; chosen."""


class Moves(NamedTuple):
    """Moves of a chain. All are cited from a book."""

    rounds: int = 1
    """Most moves [1]."""


@dataclass
class Loose:
    size: float = 1.0


@dataclass(frozen=True)
class Result:
    size: float = 1.0


_MOVES: Moves = Moves()
LIMITS = OutlierLimits()
LOOSE = Loose()
RESULT = Result(size=2.0)
'''


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    files = {
        "tssgeom/route/limits.py": LIMITS,
        "tssgeom/route/kernels.py": "from tssgeom.route.limits import LIMITS\n",
        "tssgeom/stream.py": "from tssgeom.route import kernels\n",
        "tssgeom/rig.py": "SIZE = 1.0\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def by_field(tree: Path) -> dict[str, sensitivity.Constant]:
    return {each.field: each for each in constants(tree)}


def test_fields_of_frozen_containers_with_one_instance_are_constants(tree):
    assert list(by_field(tree)) == ["quantile", "neighbours", "scales", "name", "floor", "rounds"]
    assert by_field(tree)["rounds"].name == "tssgeom.route.limits.Moves.rounds"


def test_unit_and_origin_are_those_of_the_documentation(tree):
    fields = by_field(tree)
    assert [fields[name].unit for name in ("quantile", "floor", "scales")] == ["1", "m", ABSENT]
    assert [each.origin for each in fields.values()] == [
        "derived",
        "fitted",
        ABSENT,
        ABSENT,
        "chosen",
        "cited",
    ]
    counts = "6 tuned constants and 0 limits of input, 2 without an origin"
    assert listing(list(fields.values()), markdown=False).endswith(counts)


def test_limits_of_files_and_queues_are_counted_apart_from_tuned_constants(tree):
    queue = tree / "tssgeom/io/network/queue.py"
    queue.parent.mkdir(parents=True)
    queue.write_text(LIMITS, encoding="utf-8")
    counts = "6 tuned constants and 6 limits of input, 4 without an origin"
    assert listing(constants(tree), markdown=False).endswith(counts)


def test_halves_and_doubles_keep_the_type_and_what_is_no_number_stays(tree):
    fields = by_field(tree)
    new = {name: [each.scaled(factor) for factor in sensitivity.FACTORS] for name, each in fields.items()}
    assert new == {
        "quantile": [0.49995, 1.9998],
        "neighbours": [1, 6],
        "scales": [(0.5, 4.0), (2.0, 16.0)],
        "name": [None, None],
        "floor": [0.0005, 0.002],
        "rounds": [None, 2],  # half of one move is one move
    }


@pytest.mark.parametrize("field", ["quantile", "neighbours", "scales", "floor", "rounds"])
def test_an_edit_changes_one_default_and_nothing_else(tree, field):
    constant = by_field(tree)[field]
    before = {name: each.source for name, each in by_field(tree).items()}
    edit(tree / constant.file, constant.span, "7.0")
    assert {name: each.source for name, each in by_field(tree).items()} == before | {field: "7.0"}
    text = (tree / constant.file).read_text(encoding="utf-8")
    assert len(text) == len(LIMITS) - len(constant.source) + len("7.0")


def test_every_tuned_constant_of_the_core_has_an_area():
    of_core = [each for each in constants(sensitivity.ROOT) if each.file.startswith("tssgeom/core/")]
    assert {each.area for each in of_core if "lumen" not in each.file} == {
        "route",
        "tendon",
    }


def test_what_moves_is_named_the_most_moved_first_and_nothing_is_said_to_be_nothing():
    before = {"rms": 1.0, "coverage": 95.0, "processor time [s]": 1.0}
    assert changes(before, dict(before)) == "NOTHING"
    assert changes(before, before | {"processor time [s]": 1.4}) == "NOTHING"
    assert changes(before, before | {"rms": 1.004}) == "below 1%"
    assert changes(before, before | {"rms": 2.0, "coverage": 80.0}) == "rms 1.00 → 2.00; coverage 95.0 → 80.0"


def test_rows_that_are_done_are_kept_until_the_code_changes(tree, monkeypatch):
    monkeypatch.setattr(sensitivity, "ROOT", tree)
    kept = tree / "results" / "rows.json"
    sensitivity._Rows(kept, fresh=False).add("one", {"rms": 1.0})
    assert sensitivity._Rows(kept, fresh=False).done == {"one": {"rms": 1.0}}
    assert sensitivity._Rows(kept, fresh=True).done == {}
    (tree / "tssgeom" / "rig.py").write_text("SIZE = 2.0\n", encoding="utf-8")
    assert sensitivity._Rows(kept, fresh=False).done == {}


CASES = """
from tssgeom.route import kernels
from tssgeom.route.limits import LIMITS

def prepare():
    pass

def route(take, *, quick):
    assert LIMITS.scales[0] < 2.0, "too wide"
    take(kernels.ROUNDS)
    take(LIMITS.floor, 3.0 * LIMITS.neighbours)
    return {"rounds": kernels.ROUNDS, "outliers": 3.0 * LIMITS.neighbours}

CASES = {"route": route}
"""


@pytest.fixture
def runnable(tree: Path, monkeypatch) -> Path:
    for name in ("pipelines", "tests", "sample_shapes", "benchmarks"):
        (tree / name).mkdir()
    for name in ("pyproject.toml", "CITATION.cff", "tssgeom/__init__.py", "benchmarks/__init__.py"):
        (tree / name).touch()
    (tree / "tssgeom" / "route" / "__init__.py").touch()
    kernels = "from tssgeom.route.limits import _MOVES\nROUNDS = _MOVES.rounds\n"
    (tree / "tssgeom" / "route" / "kernels.py").write_text(kernels, encoding="utf-8")
    (tree / "benchmarks" / "changed.py").write_bytes((ROOT / "benchmarks" / "changed.py").read_bytes())
    (tree / "benchmarks" / "sensitivity_cases.py").write_text(CASES, encoding="utf-8")
    monkeypatch.setattr(sensitivity, "ROOT", tree)
    monkeypatch.setattr(sensitivity, "_ROWS", tree / "results" / "sensitivity.json")
    return tree


def row(printed: str, field: str) -> str:
    return next(line for line in printed.splitlines() if f".{field} " in line)


def test_each_constant_is_changed_in_a_copy_and_a_run_that_was_stopped_goes_on(runnable, capsys):
    assert sensitivity.main(["neighbours", "scales"]) == 0
    printed = capsys.readouterr()
    assert "outliers 9.00 → 3.00  outliers 9.00 → 18.0" in row(printed.out, "neighbours")
    assert "NOTHING" in row(printed.out, "scales")
    assert "fails: AssertionError: too wide" in row(printed.out, "scales")
    assert "4 of 4" in printed.err
    assert sensitivity.main(["neighbours", "scales", "quantile"]) == 0
    again = capsys.readouterr()
    assert "2 of 2" in again.err
    assert "neighbours" not in again.err
    assert "outliers 9.00 → 18.0" in again.out
    assert (runnable / "tssgeom" / "route" / "limits.py").read_text(encoding="utf-8") == LIMITS


def test_a_constant_that_no_case_reads_is_not_said_to_move_nothing(runnable, capsys):
    assert sensitivity.main(["quantile"]) == 0
    assert row(capsys.readouterr().out, "quantile").split()[-4:] == ["not", "reached", "not", "reached"]


def test_a_constant_that_is_read_while_a_module_is_imported_moves_what_the_module_made_of_it(
    runnable, capsys
):
    assert sensitivity.main(["rounds"]) == 0
    assert "rounds 1.00 → 2.00" in row(capsys.readouterr().out, "rounds")


def test_a_search_for_idle_constants_ends_at_the_first_number_that_moves(runnable, capsys):
    assert sensitivity.main(["--idle", "floor", "neighbours"]) == 0
    printed = capsys.readouterr().out
    assert row(printed, "floor").split()[-2:] == ["moves", ABSENT]  # though its summary has no floor
    assert row(printed, "neighbours").split()[-2:] == ["moves", ABSENT]


def test_every_constant_of_the_code_has_an_origin():
    without = [each.name for each in constants(ROOT) if each.origin == ABSENT]
    assert len(without) <= WITHOUT_ORIGIN, without
