"""Effects on a route that moves under load, against the independent simulator with the same physics."""

import functools

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests import lumped
from tests.effects.rig import (
    ANGLES,
    FORCE,
    LENGTHS,
    PHYSICS,
    POSITION,
    PULLS,
    RIG,
    STROKES,
    TEMPERATURE,
    TIME,
)
from tssgeom.effects import KINDS, Creep, with_size
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.simulation import simulate

FRAMES = np.linspace(0.0, 24.0, 25)
SWAY = np.array([[a * (1.0 + 0.3 * np.sin(0.6 * k + j)) for j, a in enumerate(ANGLES)] for k in range(25)])
ROUTE = MovingRoute(FRAMES, [Arcs.exact(np.array(LENGTHS), angle) for angle in SWAY])
STEP = 0.05  # s; friction by speed needs a fifth of that where the drive turns, on both sides
ROWS = np.linspace(0.0, 24.0, 481)
LEAST = {"N": 5e-3, "m": 1e-6}  # below it a signature is not above the errors of both sides
SHARE = 0.03  # of the signature, rms; 30 bars and 60 cells leave up to 0.019
NAMES = (
    "hidden_bend",
    "load_dependent_friction",
    "slack_take_up",
    "sheath_clearance",
    "creep",
    "thermal_drift",
    "friction_drift",
)


def refereed(drive, **physics):
    kind, values = ("force", PULLS) if drive == FORCE else ("displacement", STROKES)
    run = lumped.simulate(
        lumped.from_pieces(LENGTHS, SWAY, 60, FRAMES),
        lumped.Physics(**({"pretension_N": 2.0} | physics)),
        lumped.Drive(kind, TIME, values, TEMPERATURE),
        lumped.Distal("spring", 3000.0),
        ROWS,
        STEP,
    )
    return lumped.true_channels(run)


def modelled(drive, effect):
    values = np.interp(ROWS, TIME, PULLS if drive == FORCE else STROKES)
    drives = {"tension_in" if drive == FORCE else "displacement_in": values}
    warm = np.interp(ROWS, TIME, TEMPERATURE)
    observed = [
        moment.transmission
        for moment in simulate(ROWS, ROUTE, changed(RIG, effects=(effect,)), temperature=warm, **drives)
    ]
    return {
        "tension_in_N": np.array([one.tension_in for one in observed]),
        "tension_out_N": np.array([one.tension_out for one in observed]),
        "elongation_m": np.array([one.elongation for one in observed]),
        "displacement_out_m": np.array([one.displacement_out for one in observed]),
    }


@functools.cache
def base(drive):
    return refereed(drive), modelled(drive, Creep(ratio=0.0, time_s=9.0))


@pytest.mark.parametrize("drive", [FORCE, POSITION])
@pytest.mark.parametrize("name", NAMES)
def test_the_signature_on_a_moving_route_is_the_referees(name, drive):
    plain, ours = base(drive)
    observed, mine = refereed(drive, **PHYSICS[name]), modelled(drive, with_size(KINDS[name]))
    compared = 0
    for channel in ours:
        wanted = observed[channel] - plain[channel]
        missed = np.sqrt(np.mean((mine[channel] - ours[channel] - wanted) ** 2))
        size = np.sqrt(np.mean(wanted**2))
        if channel != drive and size > LEAST[channel[-1]]:
            compared += 1
            assert missed < SHARE * size, channel
        elif channel != drive:
            assert missed < LEAST[channel[-1]], channel
    assert compared


@pytest.mark.parametrize("drive", [FORCE, POSITION])
def test_without_effects_the_march_on_a_moving_route_is_the_referees(drive):
    plain, ours = base(drive)
    for channel in ours:
        size = {"N": 0.02, "m": 2e-6}[channel[-1]]  # 60 cells and steps of 0.05 s: 0.010 N and 1.2 µm
        assert np.abs(plain[channel] - ours[channel]).max() < size
