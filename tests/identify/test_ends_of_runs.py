"""Ends of a tendon in campaigns of the second generator, and where along it something is, in words."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.bristle import make_campaign
from tssgeom.effects import HiddenBend, SensorLaw
from tssgeom.identify.assumptions import assumed
from tssgeom.identify.finding import LawCurve
from tssgeom.identify.uneven_friction import uneven_words
from tssgeom.identify.workflow import discover
from tssgeom.io.formats.campaigns import read_campaign


def discovered(folder, cause, seed, plan=""):
    """What `discover` reports in a campaign, and its truth."""
    truth = make_campaign(folder, seed, cause, plan=plan)
    return discover(read_campaign(folder)), truth


def test_a_load_that_rubs_is_no_friction_of_a_fitting_and_no_error_of_the_cell(tmp_path):
    finding, truth = discovered(tmp_path / "runs", "load_friction", 2)
    (one,) = finding.effects
    assert (finding.verdict, one.names) == ("effect", ("load_friction",))
    (effect,) = finding.rig.effects
    assert effect.force_N == pytest.approx(truth.parameters["load_friction"]["force_N"], rel=0.02)


@pytest.mark.parametrize(
    ("cause", "name"), [("drive_play_inside", "backlash"), ("load_play_inside", "load_play")]
)
def test_a_play_that_runs_start_inside_of_is_that_play_alone(tmp_path, cause, name):
    finding, truth = discovered(tmp_path / "runs", cause, 1)
    (one,) = finding.effects
    assert (finding.verdict, one.names) == ("effect", (name,))
    (effect,) = finding.rig.effects
    width, share = (truth.parameters[name][key] for key in ("play_m", "open_share"))
    assert effect.width_m == pytest.approx(width, abs=3e-6)
    assert effect.open_m == pytest.approx(share * width, abs=5e-6)
    assert "All runs are taken to start with the same part of the play" in finding.sentence


def test_friction_of_a_rough_and_a_smooth_stretch_is_said_with_their_ends():
    s = np.linspace(0.0, 0.5, 51)
    friction = 0.15 * np.where((s > 0.3) & (s < 0.36), 2.1, np.where((s > 0.1) & (s < 0.15), 0.5, 1.0))
    law = LawCurve("arc_length_m", s, friction, friction - 0.01, friction + 0.01, "1")
    assert uneven_words(law) == (
        "2.1 times as great between 305 and 355 mm and 0.5 times as great between 106 and 145 mm"
    )
    wide = LawCurve("arc_length_m", s, friction, friction - 0.2, friction + 0.2, "1")
    assert uneven_words(wide) == ""


def test_a_bend_is_said_to_be_at_one_arc_length_and_which_routes_end_before_it():
    def run(name, length):
        arcs = SimpleNamespace(total_length=length)
        return SimpleNamespace(route=SimpleNamespace(name=name, arcs=arcs))

    bend = (SimpleNamespace(effects=(HiddenBend(at_m=0.41, angle_rad=0.5),)),)
    runs = [run("one.csv", 0.6), run("two.csv", 0.38)]
    assert assumed(bend, runs) == (
        "The bend is taken to be at one arc length on all routes; two.csv ends at 380 mm, before the bend at "
        "410 mm, so that it does not act there."
    )
    assert assumed(bend, runs[:1]) == ""
    assert assumed((), runs) == ""


def test_a_gain_that_drifts_in_time_is_no_curve_over_the_reading(tmp_path):
    finding, truth = discovered(tmp_path / "runs", "gain_drifting_out", 1)
    (one,) = finding.effects
    assert (finding.verdict, one.names) == ("law", ("sensor_gain_drift",))
    (law,) = finding.rig.effects
    assert isinstance(law, SensorLaw)
    assert (law.channel, law.over) == ("tension_out_N", "time_gain")
    true = np.interp(law.x, truth.law["x"], truth.law["value"])
    off = np.array(law.error) - true
    assert np.abs(off - off.mean()).max() < 4e-3  # a gain that stays is friction to this cell
