"""`tssgeom remedy`: a table with its price, a recommendation, and a figure."""

import json
import math

import pytest

QUICK = ("--trials", "20", "--most-beta-deg", "720")


def reported_by(run, half, *options):
    outcome = run("remedy", "--shape", half, *QUICK, *options, "--json")
    assert outcome.status == 0
    return json.loads(outcome.out)


def test_the_table_has_the_scaling_its_price_and_the_release(run, half):
    output = reported_by(run, half)
    with_curve = output["cases"]["same_tension_in"]
    assert with_curve["scaling_factor"] == pytest.approx(math.exp(-0.145 * 2 * math.pi), rel=1e-12)
    assert with_curve["release_amplification"] == pytest.approx(2.487, abs=0.0005)  # as printed
    assert with_curve["own_elongation_m"] == pytest.approx(0.489e-3, abs=0.5e-6)
    assert output["cases"]["same_tension_out"]["tension_out_N"] == pytest.approx(
        output["cases"]["without"]["tension_out_N"], rel=1e-9
    )
    assert "gains nothing" in " ".join(output["words"])
    assert output["recommendation"] is None


@pytest.mark.parametrize(
    ("percent", "verdict"), [("50", "none needed"), ("4", "curve"), ("0.01", "out of reach")]
)
def test_the_recommendation_keeps_the_tolerance_or_reports_that_none_can(run, half, percent, verdict):
    output = reported_by(run, half, "--tolerance-percent", percent)
    recommended = output["recommendation"]
    assert recommended["verdict"] == verdict
    if verdict == "curve":
        assert recommended["worst_elongation_change_m"] <= output["tolerance_m"]
        assert 0 < recommended["beta_rad"] <= 4 * math.pi


def test_figure_and_table_are_written(run, half, tmp_path):
    outcome = run(
        "remedy", "--shape", half, *QUICK, "--tolerance-mm", "0.1", "--out", tmp_path / "out", "--quiet"
    )
    assert outcome.status == 0
    assert outcome.out == ""
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["remedy.json", "remedy.md", "remedy.pdf", "remedy.png", "remedy.svg"]
    assert "same T_out" in (tmp_path / "out" / "remedy.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--release-to", "20"), "--release-to is 20 N"),
        (("--tolerance-mm", "1", "--tolerance-percent", "1"), "give one"),
        (("--bend-sd-deg", "0"), "angle of the bends"),
    ],
)
def test_options_that_make_no_sense_are_one_line(run, half, options, expected):
    outcome = run("remedy", "--shape", half, *QUICK, *options)
    assert outcome.status == 2
    assert len(outcome.errors) == 1
    assert expected in outcome.errors[0]
