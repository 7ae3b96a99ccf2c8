"""The sentence of a verdict never contradicts the numbers beside it."""

import math

import pytest

from tests.worked_finding import worked_finding
from tssgeom.identify.finding import Estimate, Misfit
from tssgeom.identify.misfit import held_out_change
from tssgeom.identify.verdict import Judgement, closes_little, number, sentence, times, why_unknown


def misfit(before: float, after: float) -> Misfit:
    """One channel with a noise of 1, and this much beyond it on the held-out runs; NaN for none."""
    groups = [{} if math.isnan(gap) else {"held_out": {"a": math.hypot(1.0, gap)}} for gap in (before, after)]
    return Misfit({"a": 1.0}, groups[0], groups[1], {})


def words(verdict, before: float, after: float) -> str:
    finding = worked_finding()
    effects = finding.effects if verdict == "effect" else ()
    judged = Judgement(verdict, "", bent=False)
    return sentence(judged, effects, finding.base, (), misfit(before, after))


def test_the_numbers_are_those_of_the_table():
    assert held_out_change(misfit(3.0, 1.0)) == pytest.approx((3.0, 1.0))


NOT_FITTED = "of the disagreement on runs that were not fitted"


@pytest.mark.parametrize(
    ("before", "after", "end"),
    [
        (3.0, 1.0, f"it closes 66 % {NOT_FITTED} (from 3 to 1 times the noise)."),
        (1.5, 2.6, "but with it the misfit on held-out runs grows, from 1.5 to 2.6 times the noise."),
        (2.0, 2.0, "but with it the misfit on held-out runs stays, from 2 to 2 times the noise."),
        (0.2, 0.4, "the held-out runs have no misfit, with it or without."),
    ],
)
def test_a_misfit_falls_only_where_it_falls(before: float, after: float, end: str):
    assert words("effect", before, after).endswith(f"; {end}")


@pytest.mark.parametrize(
    ("before", "after", "unknown"),
    [
        ((7.5, 6.0), (1.5, 1.4), True),
        ((7.5, 6.0), (0.7, 1.4), False),  # a tenth of what it was
        ((7.5, 6.0), (1.5, 0.3), False),  # the held-out runs agree
        ((7.5,), (1.5,), True),
    ],
)
def test_parts_that_leave_much_on_fitted_and_on_held_out_runs_are_no_name(before, after, unknown):
    reason = why_unknown(["creep", "backlash"], before, after)
    assert bool(reason) == unknown
    assert not unknown or reason.startswith("creep and backlash help, but 1.5 times the detection limit")


def test_without_a_part_it_is_unknown_what_the_sensors_do_not_explain():
    assert why_unknown([], (1.7, 0.1), (1.7, 0.1)).startswith("1.7 times the detection limit")
    assert why_unknown([], (0.9, 3.0), (0.9, 3.0)) == ""


@pytest.mark.parametrize(
    ("before", "after", "little"),
    [(1.65, 1.55, True), (9.0, 4.0, False), (1.2, 0.7, False), (0.6, 0.6, False)],
)
def test_parts_that_close_less_than_half_of_what_held_out_runs_show_close_little(before, after, little):
    assert closes_little(before, after) == little


def test_what_the_held_out_runs_alone_show_is_not_said_to_be_outside_the_library():
    noise, much = {"a": 1.0}, {"a": 9.0}
    judged = Judgement("unknown", "9 times the noise is left", bent=False)
    base = worked_finding().base
    text = sentence(judged, (), base, (), Misfit(noise, {}, {"fitted": noise, "held_out": much}, {}))
    assert text == "What is missing shows on the held-out runs alone, by 8.9 times the noise."
    text = sentence(judged, (), base, (), Misfit(noise, {}, {"fitted": much, "held_out": much}, {}))
    assert text.startswith("No effect of the library explains it")


def test_without_held_out_runs_the_sentence_has_nothing_on_them():
    assert "held-out" not in words("effect", math.nan, math.nan)


def test_nothing_is_missing_only_as_far_as_the_held_out_runs_agree():
    assert words("none", 0.3, 0.3).endswith("leave no more than the sensors explain.")
    assert words("none", 3.2, 3.2).endswith(
        "leave no more than the sensors explain there, but 3.2 times the noise on the held-out runs."
    )


def test_a_number_without_an_interval_is_written_alone():
    assert number(Estimate(0.0021, "m", -math.inf, math.inf)) == "2.1 mm"
    assert number(Estimate(602e-6, "s", -317e-6, 1521e-6)) == "602 ± 919 µs"


@pytest.mark.parametrize(
    ("ratio", "written"), [(213.4, "210 times"), (6.93, "6.9 times"), (0.512, "0.51 times")]
)
def test_a_misfit_is_written_without_a_power_of_ten(ratio: float, written: str):
    assert times(ratio) == written
