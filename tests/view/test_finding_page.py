"""The report of discover: the answer first, everything in it, nothing from elsewhere."""

from dataclasses import replace
from math import inf
from pathlib import Path

import pytest

from tests.view.page import Page
from tests.worked_finding import without_held_out, worked_finding
from tssgeom.errors import SourceError
from tssgeom.identify.finding import Experiment, RigNumber
from tssgeom.view.finding_wording import candidate, is_selected, next_steps, significant
from tssgeom.view.report.finding import write_finding_report

VERDICTS = ("none", "effect", "tie", "unknown")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page for each verdict."""
    folder = tmp_path_factory.mktemp("finding")
    for verdict in VERDICTS:
        write_finding_report(folder / f"{verdict}.html", worked_finding(verdict))
    return folder


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[str, Page]:
    return {verdict: Page((folder / f"{verdict}.html").read_text("utf-8")) for verdict in VERDICTS}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_verdict_comes_before_every_heading(pages: dict[str, Page], verdict: str) -> None:
    page = pages[verdict]
    sentence = page.text.index(worked_finding(verdict).sentence)
    assert sentence < page.text.index(page.headings[0])


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_page_needs_nothing_beside_itself(pages: dict[str, Page], verdict: str) -> None:
    page = pages[verdict]
    assert page.tags.keys().isdisjoint({"link", "img", "iframe", "script"})
    assert not [address for address in page.values("href", "src", "xlink:href") if "//" in address]


def test_a_detected_effect_has_its_interval_evidence_and_misfit(pages: dict[str, Page]) -> None:
    text = pages["effect"].text
    assert "angle = 0.598 [0.571, 0.627] rad" in text
    assert "at = 210.4 [206.1, 214.9] mm" in text
    assert "width = 20 mm (held)" in text
    assert "412 (42)" in text
    finding = worked_finding()
    for when in (finding.misfit.before, finding.misfit.after):
        assert f"{1e3 * when['held_out']['elongation_m']:.3g}" in text


def test_runners_up_say_why_not_and_blind_spots_why(pages: dict[str, Page]) -> None:
    text = pages["effect"].text
    assert "it leaves 2.1 times the gap" in text
    assert "no run has temperature_C" in text
    assert "half_slow: tension_out_N is missing in 4 of 240 rows" in text


def test_a_tie_says_what_it_is_and_how_to_break_it(pages: dict[str, Page]) -> None:
    text = pages["tie"].text
    assert "These data cannot separate hidden bend and load dependent friction (G4)" in text
    assert "A second route of other radii: it separates hidden bend, load dependent friction" in text


def test_the_next_step_follows_from_what_was_identified() -> None:
    steps = {verdict: next_steps(worked_finding(verdict)) for verdict in VERDICTS}
    assert len({tuple(each) for each in steps.values()}) == 4
    assert "Repeat chain" in steps["none"][0]  # its held-out run is not explained
    quiet = {"held_out": worked_finding("none").misfit.noise}
    fits = replace(worked_finding("none").misfit, before=quiet, after=quiet)
    assert "Measure nothing more" in next_steps(replace(worked_finding("none"), misfit=fits))[0]
    unknown = worked_finding("unknown")
    assert unknown.where[0].run in steps["unknown"][1]
    explained = max(one.explains for one in unknown.missing_shapes)
    assert f"{100 * explained:.0f} % of the misfit" in steps["unknown"][0]
    misfit = replace(unknown.misfit, after={**unknown.misfit.after, "fitted": unknown.misfit.noise})
    assert "Fit chain too (held_out = false)" in next_steps(replace(unknown, misfit=misfit))[0]
    refit = Experiment("measure a route with another sensor", 0.0, ("rig.friction.coefficient", "angle gain"))
    asked = replace(worked_finding(), breaks_tie=(refit,))
    assert next_steps(asked) == steps["effect"]  # what a refit stands for is stated beside the refit
    assert "one more run" in next_steps(without_held_out(worked_finding()))[-1]
    grown = replace(worked_finding().misfit, after=worked_finding().misfit.before)
    assert "Repeat" in next_steps(replace(worked_finding(), misfit=grown))[-1]


def test_a_new_rig_that_leaves_much_is_not_said_to_be_the_end() -> None:
    finding = worked_finding()
    noise = finding.misfit.noise
    before, after, little = ({"held_out": {key: x * noise[key] for key in noise}} for x in (20.0, 8.0, 1.2))
    phases = {key: {"pull": (20.0, 3.0), "release_to_pull": (20.0, 8.0)} for key in noise}
    left = replace(finding.misfit, before=before, after=after, by_phase=phases)
    (step,) = next_steps(replace(finding, misfit=left))
    assert "helps, but something remains: 7.9 times the noise on runs that were not fitted" in step
    assert "release to pull" in step
    (step,) = next_steps(replace(finding, misfit=replace(left, after=little)))
    assert "use the new rig" in step
    tied = replace(worked_finding("tie"), breaks_tie=(), misfit=replace(left, after=little))
    assert "separates hidden bend from load dependent friction: --propose designs it" in next_steps(tied)[-1]


def test_the_order_of_candidates_is_that_of_the_numbers_beside_them(tmp_path: Path) -> None:
    finding, page = worked_finding(), tmp_path / "page.html"
    falls = (-300.0, 200.0, -inf)
    changed = [
        replace(each, evidence=replace(each.evidence, held_out_fall=fall))
        for each, fall in zip(finding.ranking, falls, strict=True)
    ]
    assert [each.evidence.total for each in changed] == pytest.approx([112.3, 231.0, -inf])
    write_finding_report(page, replace(finding, ranking=tuple(changed)))
    text = page.read_text("utf-8")
    assert "<td>112</td>" in text
    assert "<td>231</td>" in text
    assert "<td>contradicted</td>" in text


def test_only_what_is_unknown_shows_a_shape(pages: dict[str, Page]) -> None:
    title = "The shape of what is missing"
    assert [verdict for verdict in VERDICTS if title in pages[verdict].headings] == ["unknown"]


def test_without_an_effect_the_page_has_no_before_and_after(pages: dict[str, Page]) -> None:
    assert "The misfit" in pages["none"].headings
    assert "What acts" not in pages["none"].headings
    assert pages["none"].tags["svg"] == pages["effect"].tags["svg"]


def test_where_nothing_was_held_out_the_fitted_runs_judge(tmp_path: Path) -> None:
    write_finding_report(tmp_path / "report.html", without_held_out(worked_finding()))
    text = Page((tmp_path / "report.html").read_text("utf-8")).text
    assert "none held out" in text
    assert "none was held out, what is left" in text


def test_numbers_of_one_table_have_the_same_digits_and_a_minus_is_no_hyphen(tmp_path: Path) -> None:
    assert [significant(value, 3) for value in (0.26, 0.0287, 112.0, 1.0)] == [
        "0.260",
        "0.0287",
        "112",
        "1.00",
    ]
    finding = worked_finding()
    worse = replace(finding.ranking[-1], evidence=replace(finding.ranking[-1].evidence, delta_bic=-35.2))
    write_finding_report(tmp_path / "page.html", replace(finding, ranking=(worse,)))
    assert "<td>\N{MINUS SIGN}35</td>" in (tmp_path / "page.html").read_text("utf-8")


def test_effects_whose_evidence_differs_when_tried_alone_say_so(tmp_path: Path) -> None:
    finding = worked_finding()
    (chosen,), page = finding.effects, tmp_path / "page.html"
    changed = replace(chosen, evidence=replace(chosen.evidence, delta_bic=1.0 + chosen.evidence.delta_bic))
    for effect, differs in ((chosen, False), (changed, True)):
        write_finding_report(page, replace(finding, effects=(effect,)))
        assert ("Each is tried alone" in page.read_text("utf-8")) == differs


def test_a_page_is_the_same_for_the_same_finding(folder: Path, tmp_path: Path) -> None:
    write_finding_report(tmp_path / "again.html", worked_finding())
    assert (tmp_path / "again.html").read_bytes() == (folder / "effect.html").read_bytes()


def test_a_page_that_cannot_be_written_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(SourceError, match="check the folder"):
        write_finding_report(tmp_path / "file" / "report.html", worked_finding())
    (tmp_path / "report.html").mkdir()
    with pytest.raises(SourceError, match="name another file"):
        write_finding_report(tmp_path / "report.html", worked_finding())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "report.html"]


def test_a_gain_of_one_channel_that_is_selected_marks_no_gain_of_another() -> None:
    finding = worked_finding()
    of_joint, of_torque = (
        replace(
            finding.effects[0],
            names=("channel_gain",),
            effects=(RigNumber(key=f"sensors.{channel}.gain"),),
            parameters=({},),
        )
        for channel in ("joint_angle_rad", "motor_torque_Nm")
    )
    finding = replace(finding, effects=(of_joint,))
    assert is_selected(finding, of_joint)
    assert not is_selected(finding, of_torque)
    assert candidate(of_torque) == "channel gain of motor torque"
