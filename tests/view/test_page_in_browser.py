"""The page of a batch in a real browser: nothing wider than the window, no text on another, all on paper."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tssgeom.rig import Rig
from tssgeom.stream import FrameResult
from tssgeom.view.report.entry import ReportEntry
from tssgeom.view.report.report import rendered, write_report

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here to open the page in")

LISTEN = """<script>
addEventListener("error", (event) => { document.title = "error: " + event.message; });
</script>"""
"""Stands before the page, so that it gets every error of the page's own scripts."""
MEASURE = """<script>
document.querySelectorAll("details.input").forEach((part) => { part.open = true; });
const wide = [...document.querySelectorAll("body *")].filter((part) => !part.closest("svg"))
  .filter((part) => part.getBoundingClientRect().right > document.documentElement.clientWidth + 1)
  .map((part) => part.tagName + " " + part.textContent.slice(0, 30));
const scrolled = [...document.querySelectorAll(".wide")]
  .filter((part) => part.scrollWidth > part.clientWidth + 1);
const covered = [];
for (const chart of document.querySelectorAll("svg.chart")) {
  const texts = [...chart.querySelectorAll("text")]
    .map((text) => [text.textContent, text.getBoundingClientRect()]);
  texts.forEach(([a, one], i) => texts.slice(i + 1).forEach(([b, other]) => {
    const across = Math.min(one.right, other.right) - Math.max(one.left, other.left);
    const up = Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top);
    if (across > 1 && up > 3) covered.push(a + " | " + b);
  }));
}
const values = { wide, covered, scrolled: scrolled.length, title: document.title };
document.body.dataset.measured = JSON.stringify(values);
</script>"""


@pytest.fixture(scope="module")
def page(
    still: list[FrameResult], moving: list[FrameResult], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    entries = [ReportEntry.of(f"a_shape_with_a_long_name_{k}", still, timed=False) for k in range(5)]
    entries.append(ReportEntry.of("moving", moving, timed=True, recording="moving.rrd"))
    write_report(path, [rendered(entry) for entry in entries], rig=Rig(), tension_in=15.0)
    return path


def chromium(folder: Path, *options: str) -> str:
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}/user"]
    return subprocess.run(
        [*command, *options], capture_output=True, text=True, check=True, timeout=120
    ).stdout


@pytest.mark.parametrize("width", [1280, 1920])
def test_nothing_is_cut_or_covered_and_no_script_fails(page: Path, tmp_path: Path, width: int) -> None:
    copy = tmp_path / "report.html"
    copy.write_text(page.read_text("utf-8").replace("<head>", f"<head>{LISTEN}") + MEASURE, "utf-8")
    text = chromium(tmp_path, f"--window-size={width},900", "--dump-dom", copy.as_uri())
    measured = re.search(r'data-measured="([^"]*)"', text)
    assert measured is not None
    values = json.loads(measured[1].replace("&quot;", '"').replace("&amp;", "&").replace("&lt;", "<"))
    assert values == {
        "wide": [],
        "covered": [],
        "scrolled": 0,
        "title": "Tension along the sensed routes",
    }


def test_paper_has_the_charts_of_inputs_that_are_closed_in_the_page(page: Path, tmp_path: Path) -> None:
    closed = page.read_text("utf-8")
    assert "<details open" not in closed
    pages = []
    for name, text in (("whole", closed), ("bare", re.sub(r"<svg.*?</svg>", "", closed, flags=re.DOTALL))):
        (tmp_path / f"{name}.html").write_text(text, "utf-8")
        paper = tmp_path / f"{name}.pdf"
        chromium(tmp_path, f"--print-to-pdf={paper}", (tmp_path / f"{name}.html").as_uri())
        pages.append(len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes())))
    assert pages[0] > pages[1]
