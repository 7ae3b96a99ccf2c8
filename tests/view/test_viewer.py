import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tssgeom.errors import SourceError
from tssgeom.view.scene.compare.reading import read_side
from tssgeom.view.scene.viewer import moment_of_greatest_tension, open_viewer, screenshot

ICD_FOLDERS = [Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d")]
needs_vulkan = pytest.mark.skipif(
    not any(folder.glob("*.json") for folder in ICD_FOLDERS if folder.is_dir()),
    reason="no Vulkan driver: apt-get install mesa-vulkan-drivers",
)


@needs_vulkan
def test_screenshot_needs_no_display_and_shows_the_route_in_colour(
    moving_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    (temporary := tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    screenshot(moving_file, tmp_path / "new" / "picture.png", (1200, 700))
    assert [*temporary.iterdir()] == []
    with Image.open(tmp_path / "new" / "picture.png") as picture:
        assert picture.size == (1200, 700)
        colours = picture.convert("RGB").getcolors(maxcolors=1 << 20)
    screenshot(moving_file, tmp_path / "clean.png", (1200, 700), clean=True)
    with Image.open(tmp_path / "new" / "picture.png") as whole, Image.open(tmp_path / "clean.png") as clean:
        assert clean.size == (1200, 700 - 37 - 30)
        assert np.mean(np.asarray(clean.convert("L"))[0]) < 40 < np.max(np.asarray(whole.convert("L"))[:37])
    yellow = sum(count for count, (r, g, b) in colours or [] if r > 200 and g > 200 and b < 80)
    assert yellow > 100  # T_in of the last peak is the brightest colour


@pytest.mark.skipif(sys.platform != "linux", reason="names the hint of Linux")
def test_missing_graphics_driver_is_named_with_its_hint(
    still_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    with pytest.raises(SourceError, match="apt-get install mesa-vulkan-drivers"):
        screenshot(still_file, tmp_path / "picture.png")


@pytest.mark.skipif(sys.platform != "linux", reason="names the hint of Linux")
def test_a_picture_that_cannot_be_taken_leaves_the_last_one(
    still_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "picture.png").write_bytes(b"the last one")
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    with pytest.raises(SourceError):
        screenshot(still_file, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").read_bytes() == b"the last one"


@pytest.mark.skipif(sys.platform != "linux", reason="windows elsewhere need no DISPLAY")
@pytest.mark.parametrize("display", [None, ":4321"])
def test_a_window_without_a_display_is_one_line_with_what_works(
    still_file: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], display: str | None
) -> None:
    for name in ("WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if display is not None:
        monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(SourceError, match=r"no display for a window: --screenshot .* --web"):
        open_viewer([still_file])
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(sys.platform != "linux", reason="ends a process group")
def test_web_viewer_answers_at_the_address_it_prints(still_file: Path) -> None:
    program = "import sys, pathlib; from tssgeom.view.scene.viewer import open_viewer; "
    program += "open_viewer([pathlib.Path(sys.argv[1])], web=True)"
    server = subprocess.Popen(
        [sys.executable, "-c", program, still_file],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "CI": "true"},
        text=True,
    )
    try:
        assert server.stdout is not None
        address = server.stdout.readline().split()[1]
        assert address.startswith("http://127.0.0.1:")
        assert "<html" in page_at(address)
    finally:
        os.killpg(server.pid, signal.SIGTERM)
        server.communicate()


def page_at(address: str, limit: float = 20.0) -> str:
    """What a local server answers, once it does [s]."""
    end = time.monotonic() + limit
    while True:
        try:
            with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(address) as answer:
                return answer.read().decode()
        except urllib.error.URLError:
            assert time.monotonic() < end
            time.sleep(0.1)


@pytest.mark.parametrize("content", [None, b"", b"x_mm,y_mm,z_mm\n"])
def test_file_that_is_no_recording_is_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "shape.rrd"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SourceError, match=r"shape\.rrd"):
        screenshot(path, tmp_path / "picture.png")
    with pytest.raises(SourceError, match=r"shape\.rrd"):
        open_viewer([path])


@pytest.mark.parametrize("size", [3, 12, 3000])
@pytest.mark.filterwarnings("error")
def test_a_recording_that_is_cut_short_is_one_line(moving_file: Path, tmp_path: Path, size: int) -> None:
    cut, png = tmp_path / "cut.rrd", tmp_path / "picture.png"
    cut.write_bytes(moving_file.read_bytes()[:size])
    png.touch()
    for read in (lambda: screenshot(cut, png), lambda: read_side(cut)):
        with pytest.raises(SourceError, match=r"cut\.rrd: .* cut short or damaged .*: write it anew"):
            read()
    assert png.exists()


def test_picture_of_a_run_shows_the_moment_of_greatest_tension(moving_file: Path, still_file: Path) -> None:
    assert moment_of_greatest_tension(moving_file) == ("time", pytest.approx(0.75))
    assert moment_of_greatest_tension(still_file) is None
