import dataclasses
import html
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.view.page import Page
from tssgeom.errors import SourceError
from tssgeom.rig import Rig
from tssgeom.stream import FrameResult, Rejected
from tssgeom.view.report.chart import WIDTH, Chart
from tssgeom.view.report.kinds import kinds
from tssgeom.view.report.outlying_inputs import outlying_inputs
from tssgeom.view.report.report import ReportEntry, rendered, section, write_report
from tssgeom.view.wording import with_error


@pytest.fixture(scope="module")
def entries(still: list[FrameResult], moving: list[FrameResult]) -> list[ReportEntry]:
    lost = [
        Rejected(3, 0.1, "2 distinct points: a route needs 4"),
        Rejected(5, 0.2, "2 distinct points: a route needs 4"),
    ]
    return [
        ReportEntry.of("still", still, timed=False, recording="still.rrd"),
        ReportEntry.of("moving run", moving, timed=True, rejected=lost, recording="moving run.rrd"),
        ReportEntry.refused("bad <script>", "bad.csv: no unit: give --unit mm"),
    ]


@pytest.fixture(scope="module")
def path(entries: list[ReportEntry], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, [rendered(entry) for entry in entries], rig=Rig(), tension_in=15.0)
    return path


@pytest.fixture(scope="module")
def page(path: Path) -> Page:
    return Page(path.read_text("utf-8"))


def test_page_loads_nothing_from_elsewhere(page: Page) -> None:
    assert page.tags.keys().isdisjoint({"link", "img", "iframe", "object"})
    assert page.values("src") == []
    addresses = page.values("href", "xlink:href")
    assert not [address for address in addresses if "//" in address]
    assert "@import" not in page.text


def test_tags_match_and_every_inner_link_has_its_target(page: Page) -> None:
    assert page.open == []
    ids = page.values("id")
    links = [address[1:] for address in page.values("href") if address.startswith("#")]
    assert set(links) <= set(ids)
    assert {"input-still", "input-moving%20run"} <= set(ids)


def test_each_input_has_a_row_and_each_good_one_its_figures(page: Page) -> None:
    rows = [value for tag, name, value in page.attributes if tag == "td" and name == "data-value"]
    assert len(rows) == 2 * 12 + 2  # a rejected input has its reason in its row
    assert page.tags["svg"] == 5 + 10  # those of a frame, and of the run those of its history too


def test_counts_and_rejections_come_first_and_give_the_reason(page: Page) -> None:
    text = " ".join(page.text.split())
    assert "1 shape and 1 recording were analysed, 8 frames in all." in text
    assert "1 input and 2 single frames" in text
    assert "moving run2 frames from frame 32 distinct points" in text  # cells of one row
    assert text.index("bad <script>all") < text.index("All inputs") < text.index("rejected: bad.csv: no unit")


def test_numbers_in_the_table_are_those_of_the_results(page: Page, still: list[FrameResult]) -> None:
    ends = still[0].transmission
    assert f"{ends.tension_out:.2f}" in page.text
    assert with_error(1e3 * ends.elongation, 1e3 * ends.elongation_se, 3) in page.text


def test_warnings_of_all_frames_are_counted_and_written_out(
    page: Page, moving: list[FrameResult], still: list[FrameResult]
) -> None:
    assert f"⚠ {still[0].warnings[0]}" in page.text
    warned = [
        dataclasses.replace(result, warnings=("one point missing, bridged",) if result.seq < 3 else ())
        for result in moving
    ]
    entry = ReportEntry.of("warned", warned, timed=True)
    assert entry.warnings == (("one point missing, bridged", 3),)
    assert "(3 of 7 frames)" in section(entry, warned[-1])


def test_recordings_are_linked_by_their_relative_address(page: Page) -> None:
    assert {"still.rrd", "moving%20run.rrd"} <= set(page.values("href"))


def test_run_is_drawn_at_the_last_peak_of_its_tension(page: Page, entries: list[ReportEntry]) -> None:
    result = entries[1].representative
    assert result is not None
    assert result.transmission.tension_in == 12.0
    assert f"at {result.frame.time:.2f} s" in page.text


def test_names_are_text_and_never_markup(path: Path) -> None:
    assert "bad <script>" not in path.read_text("utf-8")


def test_page_is_small(path: Path) -> None:
    assert path.stat().st_size < 130_000


def glance(page: Path, names: list[str], still: FrameResult, **parts: Any) -> str:
    """The text of a page with these inputs, of which all have the same result."""
    entries = [rendered(ReportEntry.of(name, [still], timed=False), figures=False) for name in names]
    write_report(page, entries, rig=Rig(), tension_in=15.0, **parts)
    return page.read_text("utf-8")


def summary(name: str, **differing: float) -> dict[str, Any]:
    row = {"total_angle_rad": 1.0, "total_angle_se_rad": 0.01, "length_m": 0.3, "noise_m": 1e-4, "frames": 1}
    row |= {"tension_out_N": 9.0, "tension_out_se_N": 0.01, "noise_rms_m": 1e-4, "rejected": 0, "warned": 0}
    return row | {"name": name, "timed": False} | differing


def test_the_page_opens_with_distributions_then_outlying_inputs_then_the_rows(still, tmp_path: Path) -> None:
    names = [f"s{k}" for k in range(12)]
    rows = [summary(name) for name in names[:5]] + [summary(name, total_angle_rad=2.0) for name in names[5:]]
    rows[2] = summary("s2", noise_rms_m=5e-4)
    outlying = outlying_inputs(rows)
    text = glance(tmp_path / "a.html", names, still[0], summary=rows, outlying=outlying)
    order = ["Curve angle Φ", "Distal tension T_out", "Outlying inputs (", "All inputs", "Settings"]
    assert [text.index(word) for word in order] == sorted(text.index(word) for word in order)


@pytest.mark.filterwarnings("error")
def test_every_outlying_input_is_listed_with_both_distances() -> None:
    rows = [summary(f"s{k}", total_angle_rad=1.0 + 0.01 * (k % 3)) for k in range(30)]
    assert outlying_inputs(rows) == []
    for k in range(7):
        rows[k] = summary(f"s{k}", total_angle_rad=1.5 + 0.1 * k)
    rows[8] = summary("s8", total_angle_rad=1.5, total_angle_se_rad=0.4)  # its own noise explains it
    rows[9] = summary("s9", noise_rms_m=4e-4, total_angle_rad=0.2)
    listed = outlying_inputs(rows)
    assert [one.name for one in listed] == ["s6", "s5", "s4", "s9", "s3", "s2", "s1", "s0"]
    assert listed[0].own == pytest.approx((2.1 - 1.01) / 0.01, abs=1.0)  # the median lies about there
    assert "Φ 11.5°, the others about 58.2°; noise 0.4 mm, the others about 0.1 mm" in listed[3].words


def test_distributions_have_the_range_of_the_inputs_that_are_not_outlying(still, tmp_path: Path) -> None:
    names = [f"s{k}" for k in range(30)]
    rows = [summary(name, length_m=0.3 + 0.001 * k) for k, name in enumerate(names)]
    rows[4] = summary("s4", length_m=9.0)
    outlying = outlying_inputs(rows)
    assert [one.name for one in outlying] == ["s4"]
    text = glance(tmp_path / "a.html", names, still[0], summary=rows, outlying=outlying)
    chart = text[text.index("Length L") : text.index("Noise of a coordinate")]
    labels = [float(label) for label in re.findall(r">(\d+)</text>", chart)]
    assert max(labels) < 400  # with that of 9 m all others had been one bar


def test_a_long_name_keeps_both_ends_in_the_tables_and_is_whole_where_the_pointer_rests(
    still, tmp_path
) -> None:
    name = "a_long_name_of_a_file_of_a_laboratory_2024-03-01_trial_017_left_arm"
    text = glance(tmp_path / "a.html", [name, "short"], still[0])
    body = text[text.index("<tbody>", text.index("All inputs")) :]
    cell = re.sub(r"<wbr>", "", body[: body.index("</td>")])
    assert f'<span title="{name}">a_long_name_of_a…y_2024-03-01_trial_017_left_arm</span>' in cell
    assert f'data-value="{name}"' in cell  # by which it is sought and sorted


def mixed() -> list[dict[str, Any]]:
    """Three instruments in one folder: needles, catheters that bend more, and half as many long colons."""
    rows, random = list[dict[str, Any]](), np.random.default_rng(3).uniform
    for name, count, length, angle, noise in (
        ("needle", 40, 0.15, 0.2, 1e-4),
        ("catheter", 40, 0.5, 2.0, 3e-4),
        ("colon", 20, 1.3, 9.0, 5e-4),
    ):
        for k in range(count):
            of = {
                "length_m": length * (1 + random(-0.002, 0.002)),
                "total_angle_rad": angle * (1 + random(-0.1, 0.1)),
            }
            out = 15 * np.exp(-0.145 * of["total_angle_rad"])
            noises = {"noise_rms_m": noise * np.exp(random(-0.1, 0.1)), "noise_m": noise}
            rows.append(summary(f"{name}{k}", **of, tension_out_N=out, **noises))
    return rows


def test_in_a_folder_of_several_kinds_no_kind_hides_what_is_wrong_in_another() -> None:
    rows = mixed()
    assert [len(kind.members) for kind in kinds(rows)] == [40, 40, 20]
    assert outlying_inputs(rows) == []
    rows[3] |= {"noise_rms_m": 5e-4}  # as that of a colon
    rows[45] |= {"total_angle_rad": 3.4}
    rows[50] |= {"length_m": 0.36}
    rows[60] |= {"warned": 1, "warnings": ["12 points missing, bridged"]}
    listed = outlying_inputs(rows)
    assert {one.name for one in listed[:3]} == {"needle3", "catheter5", "catheter10"}
    assert [(one.name, one.words) for one in listed[3:]] == [
        ("catheter20", "warning: 12 points missing, bridged")
    ]


def test_what_many_inputs_lack_makes_none_of_them_outlying() -> None:
    lacks = "directions are not used: the rig lacks [shape] direction_noise_deg: give it, or 'estimate'"
    rows = mixed()
    for k in range(10):
        rows[4 * k] |= {"warned": 1, "warnings": ["no time column", lacks]}
    rows[81] |= {"warned": 9, "frames": 9, "warnings": [f"{lacks} (9 of 9 frames)"]}
    rows[1] |= {"warned": 1, "warnings": [lacks, "1 point missing, bridged"]}
    assert [one.name for one in outlying_inputs(rows)] == ["needle1"]
    for k in range(5):
        rows[4 * k] |= {"warnings": ["1 point missing, bridged"]}
    assert len(outlying_inputs(rows)) == 6


def test_inputs_that_are_wrong_in_one_way_are_a_kind_of_their_own(still, tmp_path: Path) -> None:
    rows = mixed()
    for row in rows[:6]:
        row["length_m"] *= 25.4
    assert [len(kind.members) for kind in kinds(rows)] == [40, 34, 20, 6]
    text = glance(tmp_path / "a.html", ["a"], still[0], summary=rows)
    assert "6 inputs such as needle0: L 3810 mm" in re.sub(r"38\d\d mm", "3810 mm", text)


def test_where_many_differ_none_is_outlying() -> None:
    lengths = (0.5, 0.5, 0.5, 0.51, 0.43, 1.2, 1.29, 1.3)  # as in a folder of examples
    rows = [summary(f"s{k}", length_m=length) for k, length in enumerate(lengths)]
    assert outlying_inputs(rows) == []
    assert [one.name for one in outlying_inputs(rows[:6])] == ["s5", "s4"]


def test_of_two_lengths_that_are_no_kinds_one_a_thousand_times_too_long_or_short_is_outlying() -> None:
    rows = [summary(f"s{k}", length_m=0.392 - 0.005 * (k % 5 < 2) + 1e-6 * k) for k in range(50)]
    assert outlying_inputs(rows) == []  # two fifths of them are 1.2 % shorter
    rows[7] |= {"length_m": 391.0}
    rows[20] |= {"length_m": 0.00039}
    assert [one.words.partition(",")[0] for one in outlying_inputs(rows)] == ["L 391000.0 mm", "L 0.4 mm"]


@pytest.mark.filterwarnings("error")
def test_single_shapes_that_are_alike_have_no_outlying_input() -> None:
    assert outlying_inputs([summary(f"s{k}") for k in range(6)]) == []


def test_same_results_give_the_same_page(path: Path, entries: list[ReportEntry], tmp_path: Path) -> None:
    again = tmp_path / "again.html"
    write_report(again, [rendered(entry) for entry in entries], rig=Rig(), tension_in=15.0)
    assert again.read_bytes() == path.read_bytes()


def test_folder_that_cannot_be_made_is_an_error_with_its_path(tmp_path: Path) -> None:
    (tmp_path / "nowhere").touch()
    with pytest.raises(SourceError, match=r"nowhere.*cannot be written"):
        write_report(tmp_path / "nowhere" / "report.html", [], rig=Rig(), tension_in=15.0)


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CLICK = "<script>document.querySelectorAll('.overview th button')[1].click()</script>"


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here to open the page in")
def test_a_real_browser_sorts_the_table_both_ways_by_clicks(path: Path, tmp_path: Path) -> None:
    by_frames = ["bad <script>", "still", "moving run"]
    for clicks, order in ((1, by_frames), (2, by_frames[::-1])):
        page = tmp_path / f"{clicks}.html"
        page.write_text(path.read_text("utf-8") + clicks * CLICK, "utf-8")
        rows = re.findall(r'<tr><td data-value="([^"]*)">', browsed(page, tmp_path))
        assert [html.unescape(row) for row in rows] == order


def browsed(page: Path, profile: Path) -> str:
    """Return the document as the browser holds it once its scripts have run."""
    command = [
        str(CHROMIUM),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={profile}/user",
    ]
    done = subprocess.run([*command, "--dump-dom", page.as_uri()], capture_output=True, text=True, check=True)
    return done.stdout


def test_the_number_at_the_right_end_of_an_axis_stays_inside_its_chart() -> None:
    chart = Chart("", (0.0, 4000.0), (0.0, 1.0))
    chart.axes("L [mm]", "inputs")
    (last,) = re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="(\w+)">4000<', chart.svg())
    assert last == (f"{WIDTH - 1:.1f}", "end")


def test_names_of_lines_stand_above_the_box_of_a_chart(moving: list[FrameResult], tmp_path: Path) -> None:
    chart = Chart("title", (0.0, 1.0), (0.0, 1.0))
    chart.legend([("pulling", "#0072b2"), ("releasing", "#d55e00")])
    (up,) = re.findall(r'<text class="n" x="[\d.]+" y="([\d.]+)"', chart.svg())
    assert float(up) < chart.box[1]
    page = tmp_path / "report.html"
    write_report(page, [rendered(ReportEntry.of("moving", moving, timed=True))], rig=Rig(), tension_in=15.0)
    assert (
        re.findall(r"<tspan[^>]*>(pulling|releasing)", page.read_text("utf-8"))
        == ["pulling", "releasing"] * 2
    )
