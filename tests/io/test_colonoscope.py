"""Folders of a colonoscope's coil coordinates."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.files import find_inputs, open_recording
from tssgeom.stream import Frame, Rejected

SOURCE = Path(__file__).parent / "corpus" / "colonoscope"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(SOURCE, tmp_path / "case 7"))


def test_a_folder_is_a_recording_from_the_far_coil_to_the_tip(folder):
    recording = open_recording(folder, "mm")
    outcome = [item for item in recording.frames if isinstance(item, Frame)]
    assert (recording.name, recording.kind, recording.timed, recording.frame_count) == (
        "case 7",
        "colonoscope",
        True,
        4,
    )
    k = np.arange(6.0)  # counted from the proximal end
    expected = np.column_stack([20 * k, 0.4 * k**2, np.full(6, 250.0)]) / 1000
    np.testing.assert_allclose(outcome[0].points, expected, atol=5.1e-6)  # two digits of a millimetre
    assert [frame.time for frame in outcome] == [0.0, 0.1, 0.2, 0.3]


def test_an_empty_cell_is_a_missing_coil(folder):
    outcome = [item for item in open_recording(folder, "mm").frames if isinstance(item, Frame)]
    assert np.isnan(outcome[2].points).all(axis=1).tolist() == [False, False, True, False, False, False]


def test_the_unit_has_to_be_said(folder):
    with pytest.raises(ShapeError, match=r"states no unit of length: give --unit mm\|m"):
        open_recording(folder)


def test_a_search_finds_the_folder_and_none_of_its_files(folder):
    (folder / "LogFile_P.txt").write_text("0;Endoscopy started;\n")
    (folder / "notes.csv").write_text("a\n")
    assert find_inputs([folder.parent]) == [folder]
    assert find_inputs([folder]) == [folder]


@pytest.mark.parametrize(
    ("name", "line", "text", "says"),
    [
        ("Y.txt", 1, b"1;2;\n", "line 2: different numbers of coils, 6 in X.txt, 2 in Y.txt, 6 in Z.txt"),
        ("Z.txt", 1, b"1;2;3;4;5;far;\n", "line 2: Z.txt: could not convert string to float: b'far'"),
        ("T.txt", 1, b"\n", "line 2: T.txt has no time"),
        ("T.txt", 2, b"50;50;\n", "time 0.05 s comes after 0.1 s"),
    ],
)
def test_a_bad_line_rejects_its_frame_only(folder, name, line, text, says):
    lines = (folder / name).read_bytes().splitlines(keepends=True)
    lines[line] = text
    (folder / name).write_bytes(b"".join(lines))
    rejected = [item for item in open_recording(folder, "mm").frames if isinstance(item, Rejected)]
    assert [item.seq for item in rejected] == [line]
    assert says in rejected[0].reason


def test_a_file_that_ends_early_rejects_the_frames_behind_it(folder):
    lines = (folder / "X.txt").read_bytes().splitlines(keepends=True)
    (folder / "X.txt").write_bytes(b"".join(lines[:2]) + b"\n\n\n\n")
    outcome = [isinstance(item, Frame) for item in open_recording(folder, "mm").frames]
    assert outcome == [True, True, False, False]


def test_a_folder_that_lost_a_file_is_refused(folder):
    (folder / "T.txt").unlink()
    assert find_inputs([folder.parent]) == [folder]
    with pytest.raises(SourceError, match=r"no T\.txt in it: a recording has X\.txt, Y\.txt, Z\.txt, T\.txt"):
        open_recording(folder, "mm")


def test_one_of_the_files_is_no_recording_by_itself(folder):
    with pytest.raises(SourceError, match="a part of a recording: name the folder"):
        open_recording(folder / "X.txt", "mm")


def test_empty_files_are_refused(folder):
    for name in ("X.txt", "Y.txt", "Z.txt", "T.txt"):
        (folder / name).write_text("\n\n")
    with pytest.raises(ShapeError, match=r"no line in X\.txt"):
        open_recording(folder, "mm")
