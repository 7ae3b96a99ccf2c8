"""The built site and a report, in Chromium: no error, nothing from the network, no overflow or overlap.

    sphinx-build -W --keep-going -n docs docs/_build/html && pytest -n0 tests/site

Skipped where the site is not built or Chromium is missing; `.ci/run` has both.
"""

import base64
import re
from pathlib import Path

import pytest

import tssgeom
from pipelines.cli import main
from tests.site.browser import CHROMIUM, Browser

ROOT = Path(__file__).parents[2]
SITE = ROOT / "docs" / "_build" / "html"
LAYOUT = (Path(__file__).parent / "layout.js").read_text("utf-8")
PAGES = sorted(
    path.relative_to(SITE).as_posix()
    for path in SITE.rglob("*.html")
    if not path.relative_to(SITE).as_posix().startswith((".doctrees", "_static", "_downloads"))
)
WIDTHS = (1280, 1920)
built = pytest.mark.skipif(not PAGES, reason="the site is not built: sphinx-build docs docs/_build/html")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")


@pytest.fixture(scope="module")
def browser():
    with Browser() as one:
        yield one


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """The page of a batch, and that of a finding."""
    out = tmp_path_factory.mktemp("results")
    shapes = [str(ROOT / "sample_shapes" / f"{name}.csv") for name in ("helix", "setup_a", "colon_markers")]
    with pytest.raises(SystemExit) as end:
        main(["batch", *shapes, "--out", str(out), "--quiet"])
    assert end.value.code == 0
    with pytest.raises(SystemExit) as end:
        main(
            [
                "discover",
                str(ROOT / "sample_shapes/campaign_hidden_bend"),
                "--out",
                str(out / "finding"),
                "--quiet",
            ]
        )
    assert end.value.code == 0
    return {"batch": out / "report.html", "finding": out / "finding" / "report.html"}


@built
@needs_chromium
@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_no_error_and_no_text_that_is_cut_or_covered(browser, page):
    for width in WIDTHS:
        for dark in (False, True):
            browser.open(SITE / page, width, dark=dark)
            assert browser.problems == []
            assert browser.run(LAYOUT) == []


@needs_chromium
@pytest.mark.parametrize("name", ["batch", "finding"])
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS)
def test_a_report_has_no_error_and_no_text_that_is_cut_or_covered(browser, reports, name, width, dark):
    browser.open(reports[name], width, dark=dark)
    browser.run("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    assert browser.problems == []
    assert browser.run(LAYOUT) == []
    ground = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") != dark


@needs_chromium
def test_a_heat_map_has_the_same_colours_in_dark_mode(browser, reports):
    shades = "[...document.querySelectorAll('[id=\"fixed colour\"] *')].map((e) => getComputedStyle(e).fill)"
    light, dark = [], []
    for fills, is_dark in ((light, False), (dark, True)):
        browser.open(reports["finding"], 1280, dark=is_dark)
        fills += browser.run(shades)
    assert len(set(light)) > 20
    assert light == dark


@needs_chromium
def test_two_inputs_fit_a_printed_page(browser, reports):
    half_page, width = (297 - 28) / 2, 210 - 28  # of A4, 14 mm less at each side [mm]
    browser.open(reports["batch"], round(width * 96 / 25.4))
    browser.call("Emulation.setEmulatedMedia", media="print")
    try:
        browser.run("document.querySelectorAll('details.input').forEach((each) => { each.open = true; })")
        heights = browser.run(
            "[...document.querySelectorAll('details.input')].map((e) => e.getBoundingClientRect().height)"
        )
        assert len(heights) == 3
        assert max(heights) * 25.4 / 96 < half_page
    finally:
        browser.call("Emulation.setEmulatedMedia", media="")


@needs_chromium
def test_a_printed_finding_has_no_page_for_a_short_section(browser, reports):
    browser.open(reports["finding"], 1280)
    pages = base64.b64decode(browser.call("Page.printToPDF", preferCSSPageSize=True)["data"])
    assert len(re.findall(rb"/Type\s*/Page\b", pages)) <= 4  # six where no section was broken


@needs_chromium
def test_rotated_labels_collide_by_their_own_boxes(browser, tmp_path):
    label = "<text font-size='12' transform='translate({},90) rotate(-35)'>a long label</text>"
    for apart, collide in ((30, False), (5, True)):
        page = tmp_path / f"{apart}.html"
        page.write_text(f"<svg width='200' height='120'>{label.format(20)}{label.format(20 + apart)}</svg>")
        browser.open(page, 1280)
        assert bool(browser.run(LAYOUT)) == collide


@needs_chromium
def test_errors_overflow_and_overlap_are_detected(browser, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text(
        "<p style='width:3000px'>wide</p><p style='position:absolute;top:90px'>one two</p>"
        "<p style='position:absolute;top:92px'>three four</p>"
        "<img src='http://127.0.0.1:9/none.png'><script>console.error('no')</script>"
    )
    browser.open(page, 1280)
    assert any("from the network" in each for each in browser.problems)
    assert any("no" in each for each in browser.problems)
    faults = browser.run(LAYOUT)
    assert any("wider than the window" in each for each in faults)
    assert any("one two" in each and "three four" in each for each in faults)


@built
def test_every_public_name_has_its_entry_in_the_reference():
    pages = "".join(path.read_text("utf-8") for path in (SITE / "reference").glob("python_*.html"))
    entries = set(re.findall(r'id="tssgeom\.(\w+)"', pages))
    assert set(tssgeom.__all__) - {"__version__"} <= entries


@built
def test_no_page_loads_anything_from_the_network():
    loading = re.compile(
        r'<(?:script|img|iframe)[^>]*src="(?:https?:)?//|<link[^>]*href="(?:https?:)?//[^"]*css'
    )
    assert [page for page in PAGES if loading.search((SITE / page).read_text("utf-8"))] == []
