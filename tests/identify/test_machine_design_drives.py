"""Designed experiments of machines with several drives, or driven by force, on an independent segment."""

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np

from tests import lumped
from tssgeom.identify.machine_candidates import candidates_of
from tssgeom.identify.machine_design import proposed_of_machine
from tssgeom.identify.machine_discovery import machine_work, parted_runs
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_run import machine_run
from tssgeom.identify.proposal import Asked
from tssgeom.identify.waveform import Reach, Waveform, course_of
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain

AROUND = (0.0, 120.0, 240.0)
LENGTH, ANGLE, ARM, STIFF = 0.5, 3.7, 0.0045, 0.05
PRETENSION, MU, RHO = 6.0, 0.06, 2.5e-4
NOISE = 1e-3  # rad
UNIT = {"tension": "N", "displacement": "m"}
KIND: dict[str, Literal["force", "displacement"]] = {"tension": "force", "displacement": "displacement"}
PULLS = np.column_stack([np.cos(np.radians(AROUND)), np.sin(np.radians(AROUND))])


def rig():
    return Rig(
        tendon=Tendon(pretension_N=PRETENSION, compliance_per_N=RHO),
        friction=Friction(coefficient=MU),
        drive=Drive(kind="tendons"),
        end=End(
            kind="segment",
            radius_m=ARM,
            stiffness_Nm_per_rad=STIFF,
            tendon_angles_deg=AROUND,
            length_m=0.06,
            marker_m=0.008,
        ),
        route=GivenRoute(length_m=LENGTH, angle_rad=ANGLE),
    )


def planned(by, samples=241):
    """Time [n] and the drives [n, 3] of a campaign: two triangles round the backbone at one rate."""
    time = np.linspace(0.0, 48.0, samples)
    lags = np.array([0.0, 1.2])
    ways = 2.0 / np.pi * (np.arcsin(np.sin(2.0 * np.pi * time[:, None] / 24.0 + lags)) - lags)
    return time, (2.5e-3 * ways if by == "displacement" else 1.5 * ways) @ PULLS.T + rest(by)


def rest(by):
    return PRETENSION if by == "tension" else 0.0


def measured(by, time, drives, seed, **cause):
    """What a laboratory would read of a segment whose tendons are driven so."""
    path = lumped.from_pieces([LENGTH], [ANGLE], cells=60)
    physics = lumped.Physics(pretension_N=PRETENSION, friction=MU, compliance_per_N=RHO, **cause)
    segment = lumped.Segment(ARM, tuple(np.radians(AROUND)), STIFF, 0.06, 0.008)
    each = [lumped.Drive(KIND[by], time, values) for values in drives.T]
    run = lumped.simulate_machine([(path, physics)] * 3, each, segment, time)
    rng = np.random.default_rng(seed)
    given = {f"{by}_in_{k + 1}_{UNIT[by]}": values for k, values in enumerate(drives.T)}
    assert run.bending is not None
    read = run.bending + NOISE * rng.standard_normal((len(time), 2))
    return {"time_s": time, **given, "bending_x_rad": read[:, 0], "bending_y_rad": read[:, 1]}


def made(*columns, in_cycles="run 0"):
    runs = [machine_run(f"run {k}", each, [route_of_rig(rig())], rig()) for k, each in enumerate(columns)]
    uncertain = (Uncertain(key := "end.stiffness_Nm_per_rad", UNKNOWNS[key], stated=False),)
    return MachineCampaign("bench", rig(), uncertain, tuple(runs), in_cycles=in_cycles)


FALLING = {"load_exponent": -0.4, "load_reference": 6.0}
NAMES = ("load_dependent_friction", "straight_section_friction")
"""At low tension friction that falls with it does nearly what friction of straight sheaths does."""


@cache
def campaign_of(by, cause):
    """A campaign with a cause that it hides, and what the steps of the workflow leave of it."""
    columns = measured(by, *planned(by), 2, **dict(cause))
    return columns, machine_work(made(columns))[0]


def apart(work, cause, other):
    """ΔBIC by which the cause exceeds the other one, on top of the base model; 0 of what is not refitted."""
    tried = {one.part.label: one.delta_bic for one in work.chosen.steps[0].tried}
    return tried[cause] - tried.get(other, 0.0)


def test_the_proposed_run_of_three_forces_separates_what_the_campaign_leaves_alike():
    columns, work = campaign_of("tension", tuple(FALLING.items()))
    assert {candidate.name for candidate in candidates_of(work)} == set(NAMES)
    limits = {"tension_N": 16.0, "travel_mm": 5.0, "speed_mm_per_s": 3.0}
    proposal = proposed_of_machine(work, Asked(1, limits), 0)
    (run,) = proposal.runs
    assert run.drives == tuple(f"tension_in_{k}_N" for k in (1, 2, 3))
    assert run.values.shape == (len(run.time), 3)
    np.testing.assert_array_equal(run.values[0], PRETENSION)
    assert 14.0 < run.values.max() <= 16.0 * 1.02  # nearly as high as is allowed: load is what counts
    assert run.values.min() >= proposal.limits["least_tension_N"] / 1.02
    (words,) = run.outcomes
    assert "in the move to" in words
    new = measured("tension", run.time, run.values, 4, **FALLING)
    after = machine_work(made(columns, new))[0]
    assert abs(apart(work, *NAMES)) < 20.0  # both are left
    assert min(apart(after, *NAMES), *(each.delta_bic for each in run.expected)) > 100.0


def test_drives_go_together_and_no_farther_than_they_were_together():
    points = np.array([[2.0, -1.0], [-1.0, 3.0]])
    reach = Reach(np.zeros(2), points, speed=1.0, duration=60.0, interval=0.02, samples=300)
    there = Waveform((1.0, 0.5), (1.0, 0.5), (0.0, 0.1), 2, ways=(0.0, 0.99))
    course = course_of(there, reach)
    assert course is not None
    np.testing.assert_allclose(course.corner[2], points[0])
    np.testing.assert_allclose(course.corner[3], 0.5 * points[1])
    assert np.abs(np.diff(course.drive, axis=0) / np.diff(course.time)[:, None]).max() <= 1.0 + 1e-9
    leg = (course.time >= course.corner_time[2]) & (course.time <= course.corner_time[3])
    assert np.linalg.matrix_rank(np.diff(course.drive[leg], axis=0), tol=1e-9) == 1  # a straight line


def test_new_runs_beside_one_are_fitted_and_its_cycles_stay_held_out():
    columns = measured("displacement", *planned("displacement"), 1)
    fitted, kept, said = parted_runs(made(columns, columns))
    assert [run.held_out.any() for run in fitted] == [True, False]
    assert (kept, len(said)) == ((), 1)
    _, kept, _ = parted_runs(replace(made(columns, columns), held_out=("run 1",)))
    assert [run.name for run in kept] == ["run 1"]
