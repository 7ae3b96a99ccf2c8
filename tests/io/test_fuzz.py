"""Any bytes give frames, or an error of one line that names the file."""

import shutil
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.io.damage import damage, damaged, quick
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.files import READERS, open_recording
from tssgeom.io.formats.paths import ending
from tssgeom.stream import Frame, Rejected

CORPUS = Path(__file__).parent / "corpus"
FILES = sorted(path.name for path in CORPUS.iterdir() if path.is_file() and path.suffix != ".md")
PLAIN = {"lines_ascii.vtp", "lines_binary.vtp", "lines_appended.vtp", "shape.mcap", "shape.db3"}
SAME_READER = {".ndjson", ".dat", ".tsv.gz", ".txt.gz", ".dat.gz", ".xls", ".ods", ".arrow"}
MOST_FRAMES = 1000  # what a few kilobytes can hold; beyond it a reader would be making frames up


def survives(path: Path) -> None:
    """Open a file with and without a unit, and read each frame."""
    for unit in ("mm", None):
        try:
            items = list(open_recording(path, unit).frames)
        except TssgeomError as error:
            reported = str(error)
            assert path.name.partition("#")[0] in reported
            assert len(reported.splitlines()) == 1
        else:
            assert 0 < len(items) <= MOST_FRAMES
            assert all(isinstance(item, Frame | Rejected) for item in items)
            assert all(len(item.reason.splitlines()) == 1 for item in items if isinstance(item, Rejected))


def test_the_corpus_has_a_file_for_each_ending():
    assert {ending(Path(name)) for name in FILES} == {*READERS} - SAME_READER


@pytest.mark.parametrize("name", FILES)
def test_a_sound_file_is_read(name):
    part = "#1" if name.endswith(".vtp") else ""
    assert all(
        isinstance(item, Frame)
        for item in open_recording(f"{CORPUS / name}{part}", None if name not in PLAIN else "mm").frames
    )


@pytest.mark.parametrize("name", sorted(path.name for path in (CORPUS / "broken").iterdir()))
def test_a_broken_file_is_refused_in_one_line(name):
    """Each of these once raised what it should not, or stands for a kind of damage."""
    with pytest.raises(TssgeomError) as caught:
        open_recording(CORPUS / "broken" / name, "mm")
    assert name in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_read_or_refused(name, tmp_path):
    raw = (CORPUS / name).read_bytes()
    part = "#1" if name.endswith(".vtp") else ""

    @quick
    @given(where=damage())
    @example(where=(0.0, 0.999999, b""))
    @example(where=(0.5, 0.999999, b""))
    @example(where=(0.9, 0.999999, b""))
    def holds(where):
        (tmp_path / name).write_bytes(damaged(raw, where))
        survives(Path(f"{tmp_path / name}{part}"))

    holds()


@pytest.mark.parametrize("kind", sorted(READERS))
def test_any_bytes_are_read_or_refused(kind, tmp_path):
    path = tmp_path / f"any{kind}"

    @quick
    @given(raw=st.binary(max_size=200))
    @example(raw=b"")
    @example(raw=b"\n")
    @example(raw=b"[" * 100_000)
    @example(raw=b'{"markups":' + b"[" * 100_000)
    def holds(raw):
        path.write_bytes(raw)
        survives(path)

    holds()


@pytest.mark.parametrize("name", ["X.txt", "Y.txt", "Z.txt", "T.txt"])
def test_a_folder_with_a_damaged_file_is_read_or_refused(name, tmp_path):
    folder = Path(shutil.copytree(CORPUS / "colonoscope", tmp_path / "case"))
    raw = (CORPUS / "colonoscope" / name).read_bytes()

    @quick
    @given(where=damage())
    def holds(where):
        (folder / name).write_bytes(damaged(raw, where))
        survives(folder)

    holds()


@quick
@given(raw=st.binary(max_size=200))
@example(raw=b"rosbag2_bagfile_information:")
@example(raw=b"rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths: [../../../etc/passwd]\n")
def test_a_bag_with_any_metadata_is_read_or_refused(tmp_path, raw):
    (tmp_path / "metadata.yaml").write_bytes(raw)
    shutil.copy(CORPUS / "shape.mcap", tmp_path / "shape.mcap")
    survives(tmp_path)
