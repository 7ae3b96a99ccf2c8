"""Which files are inputs, what their outputs are called, and that a write is whole or not at all."""

import os
from pathlib import Path

import pytest

from tssgeom.atomic import replacing, write_text
from tssgeom.errors import SourceError
from tssgeom.io.formats.files import find_inputs, left_out_of, open_recording, output_names


def touch(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_a_folder_gives_its_shapes_in_depth_and_in_order(tmp_path):
    touch(tmp_path, "b.csv", "a.jsonl", "deep/er/c.NPZ", "d.parquet")
    outcome = [path.relative_to(tmp_path).as_posix() for path in find_inputs([tmp_path])]
    assert outcome == ["a.jsonl", "b.csv", "d.parquet", "deep/er/c.NPZ"]


def test_what_is_no_shape_is_left_out(tmp_path):
    touch(tmp_path, "a.csv", "README.md", "rig.toml", "a_lumen.ply", ".hidden.csv", ".git/b.csv", "notes.txt")
    assert [path.name for path in find_inputs([tmp_path])] == ["a.csv"]


def test_files_that_no_reader_takes_are_counted_but_not_those_beside_data(tmp_path):
    touch(
        tmp_path, "a.csv", "README.md", "rig.toml", "a_lumen.ply", ".hidden.json", "notes.txt", "b/noending"
    )
    touch(tmp_path, "c.json", "b/d.json", "e.obj", "old/run.json", "old/f.json", "out/g.json")
    expected = {".json": 2, ".obj": 1, ".txt": 1, "noending": 1}
    assert left_out_of([tmp_path, tmp_path / "b", tmp_path / "c.json"], [tmp_path / "out"]) == expected


def test_results_are_no_inputs(tmp_path):
    touch(tmp_path, "a.csv", "old/run.json", "old/summary.parquet", "old/frames/a.parquet", "new/x.parquet")
    assert [path.name for path in find_inputs([tmp_path], besides=[tmp_path / "new"])] == ["a.csv"]


def test_each_file_is_listed_once(tmp_path):
    touch(tmp_path, "a.csv")
    assert len(find_inputs([tmp_path, tmp_path / "a.csv", tmp_path / "." / "a.csv"])) == 1


def test_a_folder_without_shapes_is_refused(tmp_path):
    with pytest.raises(SourceError, match="no shape file in this folder"):
        find_inputs([tmp_path])


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("missing.csv", "no such file: check the path"),
        (300 * "a" + ".csv", "no such file: check the path"),
        (300 * "a" + ".csv#1", "no such file: check the path"),
        ("", "a folder, not a file"),
        ("notes.doc", "no reader takes '.doc': use .csv"),
        ("lines.json", "no reader takes '.json': one JSON object a line is .jsonl"),
        ("run.json.gz", "no reader takes '.json.gz': one JSON object a line is .jsonl"),
        ("wall.stl", "a mesh is the wall of a lumen, no route: give it as --lumen"),
        ("noending", "no reader takes 'a file without ending'"),
    ],
)
def test_a_path_that_is_no_shape_file_is_refused(tmp_path, name, says):
    touch(tmp_path, "notes.doc", "noending", "lines.json", "run.json.gz", "wall.stl")
    with pytest.raises(SourceError) as caught:
        open_recording(tmp_path / name)
    assert says in str(caught.value)


def test_outputs_are_called_by_the_stem():
    assert output_names([Path("a/one.csv"), Path("b/two.csv")]) == {
        Path("a/one.csv"): "one",
        Path("b/two.csv"): "two",
    }


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["a/one.csv", "a/one.npz"], ["one-csv", "one-npz"]),
        (["a/one.csv", "b/One.csv"], ["a-one", "b-One"]),
        (["a/one.csv", "a/one.npz", "b/one.csv"], ["a-one-csv", "a-one-npz", "b-one-csv"]),
        (["x/a/one.csv", "y/a/one.csv"], ["a-one-csv", "a-one-csv-2"]),
        (["a/one.csv", "a/one.npz", "b/one-csv.csv"], ["one-csv", "one-npz", "one-csv-2"]),
    ],
)
def test_files_of_one_stem_get_different_names(paths, names):
    given = [Path(path) for path in paths]
    assert list(output_names(given).values()) == names


def test_a_write_replaces_the_file(tmp_path):
    write_text(tmp_path / "new" / "a.json", "one")
    write_text(tmp_path / "new" / "a.json", "two")
    assert (tmp_path / "new" / "a.json").read_text() == "two"
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.json"]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ValueError, MemoryError])
def test_an_interrupted_write_leaves_the_old_file(tmp_path, interruption):
    path = tmp_path / "a.json"
    path.write_text("old")

    def write_half() -> None:
        with replacing(path) as draft:
            draft.write_text("half")
            raise interruption

    with pytest.raises(interruption):
        write_half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_that_the_disk_refuses_is_one_line(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(SourceError, match="cannot be written"):
        write_text(tmp_path / "file" / "a.json", "text")


def test_a_pipe_is_refused_instead_of_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(SourceError, match="a pipe or a device"):
        open_recording(tmp_path / "pipe.csv")


def test_a_name_that_no_disk_takes_is_an_input_that_cannot_be_opened(tmp_path):
    path = tmp_path / (5000 * "a" + ".csv")
    assert find_inputs([path]) == [path]
    with pytest.raises(SourceError, match="no such file") as caught:
        open_recording(path)
    assert len(str(caught.value)) < 2048


def test_links_that_go_in_a_circle_are_no_file(tmp_path):
    (tmp_path / "a.csv").symlink_to("b.csv")
    (tmp_path / "b.csv").symlink_to("a.csv")
    (tmp_path / "self").symlink_to(".")
    (outcome, *_) = find_inputs([tmp_path / "a.csv", tmp_path])
    with pytest.raises(SourceError, match="no such file"):
        open_recording(outcome)


def test_a_file_and_a_link_to_it_are_one_input_by_the_name_of_the_file(tmp_path):
    (tmp_path / "scan_7.csv").write_text("x_mm,y_mm,z_mm\n0,0,0\n")
    (tmp_path / "latest.csv").symlink_to("scan_7.csv")
    assert find_inputs([tmp_path]) == [tmp_path / "scan_7.csv"]
