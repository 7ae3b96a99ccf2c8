"""Files and folders of files are whole or as they were."""

import os
import stat
from pathlib import Path

import pytest

from tssgeom.atomic import replacing_all, write_text
from tssgeom.errors import SourceError


def written(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_files_of_a_folder_arrive_together(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a").write_text("old")
    (tmp_path / "out" / "other").write_text("kept")
    with replacing_all(tmp_path / "out") as draft:
        (draft / "a").write_text("new")
        (draft / "b").write_text("new")
        assert (tmp_path / "out" / "a").read_text() == "old"
    assert written(tmp_path / "out") == {"a": "new", "b": "new", "other": "kept"}


def write_half(folder: Path, stop: type[BaseException]) -> None:
    with replacing_all(folder) as draft:
        (draft / "a").write_text("half")
        raise stop


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
def test_an_interruption_leaves_the_folder_as_it_was(tmp_path, stop):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "a").write_text("old")
    for folder in (tmp_path / "old", tmp_path / "fresh"):
        with pytest.raises(stop):
            write_half(folder, stop)
    assert written(tmp_path / "old") == {"a": "old"}
    assert not (tmp_path / "fresh").exists()


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SourceError, match="check the folder"), replacing_all(tmp_path / "file"):
        pass


def write_all(folder: Path, name: str) -> None:
    with replacing_all(folder) as draft:
        (draft / "a").write_text("new")
        (draft / name).write_text("new")


def test_what_is_no_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    for name in ("pipe", "link"):
        with pytest.raises(SourceError, match=rf"{name}: is no file.*name another file"):
            write_text(tmp_path / name, "text")
        with pytest.raises(SourceError, match=rf"{name}: is no file.*name another file"):
            write_all(tmp_path, name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "pipe"]
    assert stat.S_ISFIFO((tmp_path / "link").stat().st_mode)


def test_a_link_to_a_file_is_replaced(tmp_path):
    (tmp_path / "file").write_text("old")
    (tmp_path / "link").symlink_to("file")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").read_text() == "new"
