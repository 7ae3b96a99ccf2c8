"""That the finite volumes are a reference: exact in the limit, in balance, and as good as in the table."""

import time

import numpy as np
import pytest

from benchmarks import speed as reference
from benchmarks.speed import Rod, cells_history, exact_history, step_table

ROD = Rod(length=0.5, compliance=3.16e-4, friction=0.145, pretension=2.0, load_stiffness=1000.0)


def test_finer_cells_come_to_the_exact_elongation_of_the_corner_list():
    coarse, fine = (np.abs(cells_history(n) / exact_history() - 1.0).max() for n in (60, 480))
    assert coarse < 5e-4  # where the front stands in its cell is chance, so the order shows in the mean only
    assert fine < coarse / 10
    assert fine < 1e-5


def test_a_half_circle_of_cells_passes_what_the_capstan_equation_says():
    turn = reference.turns(ROD, 200, np.array([0.5]), np.array([np.pi]))
    state = reference.pulled(ROD, reference.at_rest(ROD, turn), turn, 15.0)
    assert state.tension[-1] == pytest.approx(15.0 * np.exp(-0.145 * np.pi), rel=1e-6)  # m³/12 a face
    back = reference.pulled(ROD, state, turn, 4.0)
    assert back.tension[-1] == pytest.approx(4.0 * np.exp(0.145 * np.pi), rel=1e-6)


def test_no_face_holds_more_than_its_friction_while_the_route_moves():
    before = reference.turns(ROD, 80, np.array([0.2, 0.3]), np.array([1.0, 2.0]))
    after = reference.turns(ROD, 80, np.array([0.2, 0.3]), np.array([1.5, 1.2]))
    state = reference.at_rest(ROD, before)
    for turn, tension_in in ((before, 15.0), (before, 9.0), (after, 9.0), (after, 11.0), (before, 6.0)):
        state = reference.pulled(ROD, state, turn, tension_in)
        held, mean = -np.diff(state.tension), 0.5 * (state.tension[1:] + state.tension[:-1])
        assert np.all(np.abs(held) <= turn * mean + 1e-7)  # solved to 1e-10 of 15 N, times a few passes


def test_the_table_has_times_for_bars_and_volumes():
    lines = step_table(1, time.perf_counter, markdown=False, bars=(15, 30)).splitlines()
    assert len(lines) == 5
    assert all(float(cell) > 0.0 for line in lines[2:4] for cell in line.split())
    assert "to the power" in lines[-1]
