"""The tables of the documents: what is taken from a benchmark's print, and where it goes."""

from pathlib import Path

import pytest

from benchmarks import table
from benchmarks.readme import PARTS, ROOT, Extract, Part, between, cell, done, main, short, tables, write

MACHINE = "machine: Linux x86_64, 2 cores (a processor), load 1.8, Python 3.11.7"
DOCUMENT = "before\n<!-- speed: measured -->\nold\n<!-- speed: end -->\nafter\n"
LABELS = [part.label for part in PARTS]


def rendered(header, *rows):
    return table(header, rows, text_columns=1, markdown=True)


def part(name):
    return next(each for each in PARTS if each.name == name)


ACCURACY = (
    ["cell", "estimator", "rms", "95 % Φ", "count"],
    ["half circle N 30", "bound", "0.2", "—", "—"],
    ["", "spline", "0.3", "90", "100"],
    ["", "auto", "0.25", "95", "100"],
    ["", "splprep", "1.0", "—", "—"],
    ["7 pieces    N 200", "bound", "0.2", "—", "—"],
    ["", "spline", "0.3", "90", "0"],
    ["", "auto", "0.25", "94", "99"],
    ["", "VMTK", "2.0", "—", "—"],
)


@pytest.fixture
def documents(tmp_path):
    """Return a folder with both documents as the repository has them, and nothing measured."""
    (tmp_path / "docs").mkdir()
    for name in ("README.md", "docs/benchmarks.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        for mark in ("benchmarks", *(part.name for part in PARTS)):
            if f"<!-- {mark}: measured -->" in text:
                text = between(text, mark, lambda _: "Not measured yet.")
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_tables_are_read_between_prose_without_their_rules():
    first, second = rendered(["a", "b"], ["x", "1"]), rendered(["c"], ["y"])
    assert tables(f"words\n\n{first}\nmore\n{second}\n") == [[["a", "b"], ["x", "1"]], [["c"], ["y"]]]


def test_a_row_or_column_that_is_missing_is_named():
    printed = tables(rendered(["a", "b"], ["x", "1"]))[0]
    assert cell(printed, "x", "b") == "1"
    with pytest.raises(LookupError, match="no row begins with 'z'"):
        cell(printed, "z", "b")
    with pytest.raises(LookupError, match="no column is called 'c', only a, b"):
        cell(printed, "x", "c")


def test_accuracy_shows_the_bound_this_project_and_the_best_peer():
    extract = part("accuracy").extract(f"{rendered(['rms'], ['1'])}\n\n{rendered(*ACCURACY)}")
    assert tables(extract.body)[0][1] == ["half circle N 30", "splprep", "1.0", "0.2", "0.25", "95", "100"]
    assert extract.key == ["0.25 %", "Cramér–Rao bound 0.2 %, VMTK 2.0 %", "8 ×"]


def test_discovery_leaves_out_what_was_not_measured():
    targets = rendered(
        ["metric", "target", "reached", "kept"],
        ["right name first, typical size", "≥ 95 %", "97 % (31 of 32)", "yes"],
        ["tie G1 and its experiment named", "≥ 100 %", "—", "—"],
    )
    peers = rendered(["single", "right name"], ["this workflow", "97 %"], ["pysindy", "40 %"], ["GP", "—"])
    extract = part("discovery").extract(f"{targets}\n\n{peers}")
    assert [row[0] for row in tables(extract.body)[0][1:]] == ["right name first, typical size"]
    assert extract.key == ["97 % (31 of 32)", "wanted: ≥ 95 %, pysindy 40 %", "—"]


def test_only_what_stands_between_the_marks_changes():
    assert between(DOCUMENT, "speed", lambda old: old + "er") == DOCUMENT.replace("old", "older")
    with pytest.raises(LookupError, match="there are no marks of batch"):
        between(DOCUMENT, "batch", lambda old: old)


def test_rows_stand_in_their_order_whichever_was_measured_first():
    later = short("", MACHINE, LABELS[1], ["1 µs", "peer 2 µs", "2 ×"])
    both = short(later, MACHINE.replace("1.8", "0.3"), LABELS[0], ["1 %", "peer 2 %", "2 ×"])
    assert [row[0] for row in tables(both)[0]] == ["measured", LABELS[0], LABELS[1]]
    assert both.endswith("Measured on: Linux x86_64, 2 cores (a processor), Python 3.11.7")


def test_rows_of_another_machine_go_since_one_is_named():
    old = short("", MACHINE, LABELS[1], ["1 µs", "peer 2 µs", "2 ×"])
    new = short(old, MACHINE.replace("2 cores", "8 cores"), LABELS[0], ["1 %", "peer 2 %", "2 ×"])
    assert [row[0] for row in tables(new)[0]] == ["measured", LABELS[0]]


def test_every_part_has_its_mark_in_the_documents(documents):
    for each in PARTS:
        extract = Extract(f"| {each.name} |", ["1", "2", "3"])
        write(documents, each, MACHINE, f"benchmarks.{each.name}", extract)
    printed = (documents / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    assert all(
        f"`python -m benchmarks.{each.name}`, {MACHINE}\n\n| {each.name} |\n" in printed for each in PARTS
    )
    (rows,) = (one for one in tables((documents / "README.md").read_text("utf-8")) if one[0][0] == "measured")
    assert [row[0] for row in rows[1:]] == LABELS


def test_a_benchmark_that_fails_changes_no_document(documents, capsys):
    before = {path: path.read_bytes() for path in documents.rglob("*.md")}
    broken = Part("no_such_benchmark", LABELS[0], (), (), lambda text: Extract(text, []))
    assert not done(broken, documents, quick=False)
    assert "no_such_benchmark: exit status 1" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in documents.rglob("*") if path.is_file()} == before


def test_an_unknown_part_is_a_usage_error(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["velocity"])
    assert "no part is called velocity: choose from accuracy, speed" in capsys.readouterr().err


def test_every_part_is_a_benchmark_that_can_be_run():
    for each in PARTS:
        assert "__main__" in (Path(ROOT) / "benchmarks" / f"{each.name}.py").read_text(encoding="utf-8")
