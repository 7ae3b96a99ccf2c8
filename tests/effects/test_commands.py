"""Commands with effects: carried out, they bring the distal end to its target."""

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests.effects.rig import ARCS, RIG, TEMPERATURE, TIME
from tssgeom.effects import KINDS, StraightSectionFriction, TensionInGain, TensionInOffset, with_size
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.command import compensate
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.simulation import commands, simulate
from tssgeom.tendon.state import pretensioned, step

SOME = slice(None, None, 4)
TARGETS = (
    2.0 + np.interp(TIME, [0, 4, 6, 9, 12, 15, 18, 20, 22, 24], [0, 6, 6, 1.5, 4, 2, 6.5, 6.5, 1.5, 3])[SOME]
)
ROUTES = {
    "stands": MovingRoute(np.zeros(1), [ARCS]),
    "moves": MovingRoute(
        np.linspace(0.0, 24.0, 13),
        [Arcs.exact(ARCS.length, ARCS.angle * (1.0 + 0.3 * np.sin(k + np.arange(4)))) for k in range(13)],
    ),
}
BY_SPEED = ("velocity_dependent_friction", "viscous_drag")


def with_effect(name):
    return changed(RIG, effects=(with_size(KINDS[name]),))


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("name", KINDS)
def test_the_model_carries_out_its_inverse(name, route):
    rig, path = with_effect(name), ROUTES[route]
    warm = TEMPERATURE[SOME]
    result = list(commands(TIME[SOME], path, rig, tension_out=TARGETS, temperature=warm))
    drives = {"displacement_in": np.array([one.displacement_in for one in result])}
    if name not in BY_SPEED:  # between two samples a position and a tension cannot both run straight
        drives["tension_in"] = np.array([one.reading_in for one in result])
    for drive, values in drives.items():
        done = simulate(TIME[SOME], path, rig, temperature=warm, **{drive: values})
        reached = [moment.transmission.tension_out for moment in done]
        assert reached == pytest.approx(TARGETS, rel=1e-9)  # ten times what the inverse takes for reached


def test_a_sensor_that_errs_does_not_change_the_command_but_its_reading():
    spoilt = changed(RIG, effects=(TensionInGain(gain_error=0.1), TensionInOffset(offset_N=0.3)))
    reported = compensate(pretensioned(spoilt), ARCS, spoilt, tension_out=9.0)
    plain = compensate(pretensioned(RIG), ARCS, RIG, tension_out=9.0)
    assert reported.tension_in == pytest.approx(plain.tension_in, rel=1e-9)
    assert reported.reading_in == pytest.approx(1.1 * plain.tension_in + 0.3, rel=1e-9)
    assert plain.reading_in == plain.tension_in


def test_a_displacement_of_the_load_counts_from_the_true_pretension():
    rig = with_effect("pretension_error")
    reported = compensate(pretensioned(rig), ARCS, rig, displacement_out=1e-3)
    assert reported.state.tension_out == pytest.approx(2.6 + 3.0, rel=1e-9)


def test_where_friction_holds_more_than_the_target_without_any_pull_the_drive_lets_go_and_says_so():
    rig = changed(RIG, effects=(StraightSectionFriction(force_N_per_m=4.0),))
    pulled = step(pretensioned(rig), ARCS, rig, tension_in=20.0)
    near = compensate(pulled, ARCS, rig, tension_out=0.5)
    assert (near.lets_go, near.limited, near.tension_in) == (True, "tension_N", 0.0)
    assert near.tension_reached == step(pulled, ARCS, rig, tension_in=0.0).tension_out > 0.5
    again = compensate(near.state, ARCS, rig, tension_out=0.4)
    assert (again.lets_go, again.tension_reached) == (True, near.tension_reached)
    after = compensate(again.state, ARCS, rig, tension_out=9.0)
    assert (after.lets_go, after.limited, after.tension_reached) == (False, "", pytest.approx(9.0, rel=1e-9))


@pytest.mark.parametrize("name", BY_SPEED)
def test_with_friction_by_speed_a_drive_that_lets_go_is_commanded_by_position_and_the_run_goes_on(name):
    rig = with_effect(name)
    rig = changed(rig, effects=(*rig.effects, StraightSectionFriction(force_N_per_m=4.0)))
    state, reached = pretensioned(rig), list[float]()
    targets, flags = (6.0, 0.3, 0.2, 5.0), list[bool]()
    for second, target in enumerate(targets):
        command = compensate(state, ARCS, rig, tension_out=target, time=float(second))
        state = command.state
        reached.append(command.tension_reached)
        flags.append(command.lets_go)
    assert flags == [False, True, True, False]
    assert reached[0::3] == pytest.approx(targets[0::3], rel=1e-9)
    assert min(reached[1:3]) > 0.3
