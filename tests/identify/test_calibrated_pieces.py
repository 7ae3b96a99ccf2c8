"""Friction that drifts in a long log of an independent chain, calibrated in pieces."""

import numpy as np
import pytest

from tests.twins import drifting_friction
from tssgeom.errors import SettingsError
from tssgeom.identify.calibrated_pieces import calibrate_pieces, piece_edges
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.route.pieces import Arcs

HOURS, PIECE = 0.25, 300.0
CHANNELS = ("tension_in_N", "displacement_in_m")


def rig_of(machine):
    return Rig(
        tendon=Tendon(compliance_per_N=machine.compliance_per_N, pretension_N=machine.pretension_N),
        friction=Friction(coefficient=machine.friction),
        load=Load(stiffness_N_per_m=machine.stiffness_N_per_m),
    )


def columns_of(scenario):
    return {"time_s": scenario.times, **{name: scenario.readings[name] for name in CHANNELS}}


def truth(scenario, piece):
    during = (scenario.times >= piece.start) & (scenario.times <= piece.end)
    return float(scenario.truth["friction"][during].mean())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_drifting_friction_is_followed_piece_by_piece(seed):
    scenario = drifting_friction(seed=seed, hours=HOURS)
    machine = scenario.machine
    route = Arcs.exact(machine.lengths_m, machine.angles_rad)
    pieces = list(calibrate_pieces("log", columns_of(scenario), [route], rig_of(machine), every=PIECE))
    time = scenario.times
    of_pieces = [time[(time >= begin) & (time < begin + PIECE)] for begin in (0.0, 300.0, 600.0)]
    assert [(piece.start, piece.end) for piece in pieces] == [(each[0], each[-1]) for each in of_pieces]
    for piece in pieces:
        friction, compliance = (
            next(each for each in piece.fitted.estimates if each.key == key)
            for key in ("friction.coefficient", "tendon.compliance_per_N")
        )
        true = truth(scenario, piece)
        assert friction.identified
        assert friction.value == pytest.approx(true, rel=0.06)
        half = 0.5 * (friction.high - friction.low)
        assert abs(friction.value - true) < 1.5 * half  # within 3 standard errors
        assert compliance.value == pytest.approx(machine.compliance_per_N, rel=0.03)


def test_a_piece_without_motion_is_said_and_takes_nothing_else_down():
    scenario = drifting_friction(seed=1, hours=HOURS)
    machine = scenario.machine
    columns = {name: values.copy() for name, values in columns_of(scenario).items()}
    still = (scenario.times >= 150.0) & (scenario.times < 600.0)
    for name in CHANNELS:
        columns[name][still] = np.nan
    route = Arcs.exact(machine.lengths_m, machine.angles_rad)
    first, second, third = calibrate_pieces("log", columns, [route], rig_of(machine), every=PIECE)
    assert not first.failures
    assert second.fitted is None
    assert "samples with displacement_in_m" in second.failures[0]
    assert not third.failures


def test_pieces_need_a_length_above_zero_and_a_short_rest_joins_the_last_one():
    time = np.arange(0.0, 1000.0)
    assert piece_edges(time, 300.0).tolist() == [0.0, 300.0, 600.0, 999.0]
    assert piece_edges(time, 5000.0).tolist() == [0.0, 999.0]
    for every in (0.0, -1.0, 1e-3, float("nan")):
        with pytest.raises(SettingsError, match="greater --every"):
            piece_edges(time, every)
