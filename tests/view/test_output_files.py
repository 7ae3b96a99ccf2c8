"""Pictures and pages replace files, and nothing else."""

import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.worked_finding import worked_finding
from tssgeom.atomic import write_text
from tssgeom.errors import SourceError
from tssgeom.stream import FrameResult
from tssgeom.view.scene.finding.recording import write_finding_recording
from tssgeom.view.scene.recording import write_recording
from tssgeom.view.scene.viewer import screenshot
from tssgeom.view.scene.writer import GrowingFile


def test_what_is_no_file_is_not_replaced(still: list[FrameResult], still_file: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writers: list[Callable[[], object]] = [
        lambda: GrowingFile(pipe),
        lambda: write_recording(pipe, "still", still, timed=False),
        lambda: write_finding_recording(pipe, worked_finding()),
        lambda: write_text(pipe, "page"),
        lambda: screenshot(still_file, pipe),
    ]
    for write in writers:
        with pytest.raises(SourceError, match=r"is no file.*name another file"):
            write()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_recording_that_is_removed_while_it_grows_is_reported_as_such(tmp_path: Path) -> None:
    file = GrowingFile(tmp_path / "run.rrd")
    file.write()
    (tmp_path / ".run.part.rrd").unlink()
    with pytest.raises(SourceError, match=r"run\.rrd: the recording ends here.*leave the hidden file"):
        file.finish()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="counts the threads of the process")
def test_recordings_that_are_written_keep_no_thread(still: list[FrameResult], tmp_path: Path) -> None:
    counts = list[int]()
    for number in range(8):
        write_recording(tmp_path / f"{number}.rrd", "still", still, timed=False)
        counts.append(len(os.listdir("/proc/self/task")))
    assert counts[-1] <= counts[1]
