"""Paths that move while the tendon is loaded: what follows from balance alone."""

import math

import numpy as np
import pytest

from tests.lumped import Distal, Drive, Physics, from_angle, from_pieces, simulate

PI, RHO = math.pi, 3.16e-4
HELD = Distal("blocked")
# What the nearly rigid bars at the ends make of 15 N, relative to the whole tendon.
EXACT_N = 1e-5


def hold(kind, value, until=2.0):
    return Drive(kind, np.array([0.0, 1.0, until]), np.array([2.0 if kind == "force" else 0.0, value, value]))


def bent(angles, times, cells=64):
    """0.5 m whose whole bend has these angles at these times."""
    return from_pieces([0.5], np.asarray(angles, dtype=float)[:, None], cells, times)


def test_a_bend_that_straightens_under_a_held_force_passes_all_of_it():
    path = bent([PI, PI, 0.0], [0.0, 1.0, 2.0])
    run = simulate(path, Physics(pretension_N=2.0), hold("force", 15.0), HELD, [1.0, 1.5, 2.0])
    assert run.tension_out[0] == pytest.approx(15.0 * 0.6341, abs=0.005)
    assert run.tension_out[1] == pytest.approx(15.0 * math.sqrt(0.634111), abs=0.005)  # half the bend is left
    assert run.tension[2] == pytest.approx(np.full(65, 15.0), abs=EXACT_N)
    assert run.elongation[2] == pytest.approx(RHO * 0.5 * 13.0, rel=1e-6)


def test_a_bend_that_appears_on_a_tight_tendon_changes_nothing():
    path = bent([0.0, 0.0, PI], [0.0, 1.0, 2.0])
    for drive in (hold("force", 15.0), hold("displacement", 2e-3)):
        run = simulate(path, Physics(pretension_N=2.0), drive, HELD, [1.0, 2.0])
        assert run.tension[1] == pytest.approx(run.tension[0], abs=EXACT_N)
        assert not run.sliding[1].any()


def test_straightening_at_held_ends_evens_the_tension_out_and_keeps_the_stretch():
    path = bent([PI, PI, 0.0], [0.0, 1.0, 2.0])
    run = simulate(path, Physics(pretension_N=2.0), hold("displacement", 2e-3), HELD, [1.0, 2.0])
    even = 2.0 + 2e-3 / (RHO * 0.5)  # the mean tension of a tendon between fixed ends
    assert run.tension_in[0] > even > run.tension_out[0]
    assert run.tension[1] == pytest.approx(np.full(65, even), abs=EXACT_N)


def test_a_bend_that_straightens_in_the_dead_zone_lets_its_tension_through():
    times = [0.0, 2.0, 3.0]
    path = from_pieces([0.25, 0.25], [[PI / 2, PI / 2], [PI / 2, PI / 2], [0.0, PI / 2]], 64, times)
    drive = Drive("force", np.array([0.0, 1.0, 2.0, 3.0]), np.array([2.0, 15.0, 10.0, 10.0]))
    run = simulate(path, Physics(pretension_N=2.0), drive, HELD, [2.0, 3.0], 0.01)
    half = math.sqrt(0.634111)  # what a quarter turn passes on
    assert run.tension_out[0] == pytest.approx(15.0 * half**2, abs=0.005)  # as pulled: the far half is stuck
    assert run.tension[1, 32] == pytest.approx(
        10.0, abs=0.01
    )  # the near half is straight; half a cell of bend
    assert run.tension_out[1] == pytest.approx(
        15.0 * half**2, abs=0.005
    )  # less than the 10/half that it holds


def test_a_longer_path_between_held_ends_stretches_the_tendon():
    path = from_pieces([[0.5], [0.5005]], [0.0], 16, [0.0, 1.0])
    still = Drive("displacement", np.array([0.0, 1.0]), np.zeros(2))
    run = simulate(path, Physics(pretension_N=5.0), still, HELD, [1.0])
    assert run.tension[0] == pytest.approx(np.full(17, 5.0 + 5e-4 / (RHO * 0.5)), abs=EXACT_N)
    assert run.elongation[0] == 0.0
    assert run.stretch[0] == pytest.approx(5e-4, abs=1e-9)


def test_a_longer_path_under_a_held_force_draws_the_tendon_in():
    path = from_pieces([[0.5], [0.5005]], [0.0], 16, [0.0, 1.0])
    still = Drive("force", np.array([0.0, 1.0]), np.full(2, 5.0))
    run = simulate(path, Physics(pretension_N=5.0), still, HELD, [1.0])
    assert run.displacement_in[0] == pytest.approx(-5e-4, abs=1e-9)
    assert run.elongation[0] == pytest.approx(-5e-4, abs=1e-9)
    assert run.stretch[0] == pytest.approx(0.0, abs=1e-9)


def test_balance_and_limits_hold_at_every_vertex_while_bends_come_and_go():
    times = np.linspace(0.0, 10.0, 101)
    edges = np.linspace(0.0, 0.5, 65)
    wave = (
        2.0 * np.sin(times)[:, None] * np.sin(2 * PI * edges / 0.5)
        + 3.0 * edges / 0.5 * (2.0 + np.cos(times))[:, None]
    )
    path = from_angle(edges, wave, times)
    drive = Drive("displacement", times, 2e-3 * np.sin(0.8 * times) ** 2)
    run = simulate(path, Physics(pretension_N=3.0), drive, Distal("spring", 4000.0), times, 0.02)
    a, b = run.tension[:, :-1], run.tension[:, 1:]
    limit = 0.145 * (a + b) * np.sin(0.5 * path.turns)
    assert run.friction[:, 1:-1] == pytest.approx((a - b) * np.cos(0.5 * path.turns), abs=1e-12)
    assert np.all(np.abs(run.friction[:, 1:-1]) <= limit + 1e-9)  # rounding
    extension = np.diff(path.bars[0]).sum() + RHO * path.bars[0] @ (run.tension - 3.0).T
    assert run.stretch == pytest.approx(extension, abs=1e-12)
