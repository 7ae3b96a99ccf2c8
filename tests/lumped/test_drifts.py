"""Properties that change during a run, by what is known of them without the model of this project."""

import math
import time

import numpy as np
import pytest

from tests.lumped import Change, Distal, Drive, Physics, Sensor, from_pieces, measure, simulate

PI, LENGTH = math.pi, 0.5
SPRING = Distal("spring", 2000.0)
PHYSICS = Physics(friction=0.15, compliance_per_N=3e-4, pretension_N=3.0)
RATIO = 1e-3  # of a capstan ratio at 64 cells: the polygon is second order, (π/64)²/12 of an exponent of 0.5


def path(cells=64):
    return from_pieces([LENGTH], [PI], cells)


def strokes(times, values):
    return Drive("displacement", np.array(times, dtype=float), np.array(values, dtype=float))


def forced(times, values):
    return Drive("force", np.array(times, dtype=float), np.array(values, dtype=float))


def run(drive, changes=(), physics=PHYSICS, distal=SPRING, step=0.05, **options):
    times = np.arange(drive.times[0], drive.times[-1] + 0.5 * step, step)
    return simulate(path(), physics, drive, distal, times, changes=changes, **options)


SAW = strokes([0, 10, 20, 30, 40], [0, 5e-3, 1e-3, 6e-3, 1e-3])


def test_a_full_slide_has_the_friction_of_its_time():
    drift = Change("friction", [0, 40], [1.0, 1.4])
    result = run(SAW, [drift])
    for time_s, way in ((10, -1), (20, 1), (30, -1), (40, 1)):
        at = np.searchsorted(result.times, time_s - 1e-6)
        mu = 0.15 * (1.0 + 0.4 * time_s / 40)
        ratio = result.tension_out[at] / result.tension_in[at]
        assert ratio == pytest.approx(math.exp(way * mu * PI), rel=RATIO)


def test_a_wet_stretch_lowers_the_loss_of_its_own_angle():
    wet = Change("friction", [4, 6], [1.0, 0.3], start_m=0.2, stop_m=0.3)
    result = run(strokes([0, 10], [0, 5e-3]), [wet])
    exponent = 0.15 * PI * (0.8 + 0.2 * 0.3)
    assert result.tension_out[-1] / result.tension_in[-1] == pytest.approx(math.exp(-exponent), rel=RATIO)


def test_a_tendon_that_sticks_keeps_its_tension_whatever_the_friction_gains():
    held = strokes([0, 10, 12, 40], [0, 5e-3, 4.5e-3, 4.5e-3])
    result = run(held, [Change("friction", [12, 40], [1.0, 3.0])])
    after = result.tension[result.times >= 12.0]
    assert np.abs(after - after[0]).max() < 1e-6  # rounding


def test_friction_that_falls_in_a_hold_lets_the_tendon_slip_to_the_new_limit():
    held = forced([0, 10, 20], [3, 20, 20])
    result = run(held, [Change("friction", [12, 13], [1.0, 0.4])])
    before, after = (result.tension_out[np.searchsorted(result.times, t)] for t in (11.0, 20.0))
    assert before / 20.0 == pytest.approx(math.exp(-0.15 * PI), rel=RATIO)
    assert after / 20.0 == pytest.approx(math.exp(-0.06 * PI), rel=RATIO)
    assert np.ptp(result.tension_out[result.times >= 13.0]) < 1e-6


def test_a_kink_costs_its_angle_after_a_full_slide():
    kink = Change("bend", [15, 15.5], [0.0, 0.8], start_m=0.24, stop_m=0.26)
    result = run(SAW, [kink])
    before, pulled, released = (np.searchsorted(result.times, t - 1e-6) for t in (10, 30, 40))
    ratio = result.tension_out / result.tension_in
    assert ratio[before] == pytest.approx(math.exp(-0.15 * PI), rel=RATIO)
    # three vertices of 0.3 rad: each holds θ²/12 more than a curve of that turn
    assert ratio[pulled] / ratio[before] == pytest.approx(math.exp(-0.15 * 0.8), rel=2 * RATIO)
    assert ratio[released] == pytest.approx(math.exp(0.15 * (PI + 0.8)), rel=2 * RATIO)


def test_a_frayed_tendon_is_softer_by_its_factor_and_longer_by_its_length():
    physics = Physics(friction=0.0, compliance_per_N=3e-4, pretension_N=3.0)
    there_and_back = strokes([0, 10, 20, 30], [0, 2e-3, 1e-3, 2e-3])
    frays = [
        Change("compliance", [15, 15.1], [1.0, 1.6]),
        Change("length", [15, 15.1], [0.0, 4e-4], 0.3, 0.31),
    ]
    result = run(there_and_back, frays, physics, Distal("blocked"))
    x, pull = result.displacement_in, result.tension_in
    slopes = [np.polyfit(x[part], pull[part], 1)[0] for part in (result.times < 9.9, result.times > 20.1)]
    assert slopes[0] == pytest.approx(1.0 / (3e-4 * LENGTH), rel=1e-5)  # and 1e-5 of the stiff ends
    assert slopes[0] / slopes[1] == pytest.approx(1.6, rel=1e-5)
    at_rest = 3.0 * 3e-4 * LENGTH  # stretch under the pretension
    assert pull[-1] == pytest.approx((at_rest + 2e-3 - 4e-4) / (1.6 * 3e-4 * LENGTH), rel=1e-4)


def test_a_tendon_frayed_on_a_stretch_is_softer_there_alone():
    physics = Physics(friction=0.0, compliance_per_N=3e-4, pretension_N=3.0)
    fray = Change("compliance", [0, 1], [1.0, 3.0], start_m=0.0, stop_m=0.1)
    result = run(strokes([0, 1, 10], [0, 0, 2e-3]), [fray], physics, Distal("blocked"))
    slope = np.ptp(result.tension_in[result.times >= 1.0]) / 2e-3
    assert slope == pytest.approx(1.0 / (3e-4 * (0.1 * 3.0 + 0.4)), rel=1e-4)


def test_a_play_that_grows_shifts_what_is_let_out_by_its_width():
    wide = Change("play", [0, 40], [0.0, 4e-4])
    without, result = run(SAW), run(SAW, [wide])
    pulled = np.searchsorted(result.times, 30 - 1e-6)
    assert result.tension_in[pulled] == pytest.approx(without.tension_in[pulled], abs=1e-6)
    behind = SAW.values.copy()
    behind[-1] += 4e-4  # engaged for letting out, the tendon is where the drive is and the play
    knots = strokes([0, 10, 20, 30, 40], behind)
    assert result.tension_in[-1] == pytest.approx(run(knots).tension_in[-1], abs=1e-6)
    assert result.displacement_in[-1] == SAW.values[-1]


def test_what_changes_makes_no_energy():
    """The work of the drive is heat and stored energy; only a tendon that softens loses some of that."""
    frays = [
        Change("compliance", [15, 15.1], [1.0, 1.6]),
        Change("length", [15, 15.1], [0.0, 4e-4], 0.2, 0.3),
        Change("friction", [0, 40], [0.7, 1.3]),
    ]
    result = run(SAW, frays, step=0.005)
    bars, mu = path().bars[0], np.interp(result.times, [15, 15.1], [3e-4, 4.8e-4])
    stored = 0.5 * mu * (result.tension**2 @ bars) + 0.5 * result.tension_out**2 / 2000.0
    work = np.concatenate(
        [
            [0.0],
            np.cumsum(
                0.5 * (result.tension_in[1:] + result.tension_in[:-1]) * np.diff(result.displacement_in)
            ),
        ]
    )
    lost = work - (stored - stored[0]) - result.heat
    # 3e-9 J in the step after a reversal, where the trapezoid of a vertex starts from the other side
    assert np.all(np.diff(result.heat) >= -1e-8)
    frays_now = (result.times[1:] > 15.0) & (result.times[1:] <= 15.1)
    assert np.all(np.diff(lost)[frays_now] > 0.0)
    assert np.abs(np.diff(lost)[~frays_now]).max() < 1e-9  # of 0.08 J


def test_a_change_that_does_nothing_changes_nothing():
    nothing = [Change("friction", [3, 4], [1, 1]), Change("compliance", [3, 4], [1, 1], 0.1, 0.2)]
    nothing += [
        Change("bend", [3, 4], [0, 0]),
        Change("length", [3, 4], [0, 0]),
        Change("play", [3, 4], [0, 0]),
    ]
    plain, result = run(SAW), run(SAW, nothing)
    assert np.abs(plain.tension - result.tension).max() < 1e-9


def test_the_ends_of_a_run_do_not_depend_on_what_is_kept_of_it():
    drift = [Change("friction", [0, 40], [1.0, 1.4])]
    whole, ends = run(SAW, drift), run(SAW, drift, ends_only=True)
    for name in ("tension_in", "tension_out", "displacement_out", "stretch", "heat"):
        assert np.array_equal(getattr(whole, name), getattr(ends, name))
    assert ends.tension.shape == (len(ends.times), 0)
    assert ends.position.shape == (len(ends.times), 2)


@pytest.mark.parametrize(
    ("said", "arguments"),
    [
        ("increasing", ("friction", [0, 0], [1, 1])),
        ("keep it > 0", ("compliance", [0, 1], [1, 0])),
        ("give a stretch", ("bend", [0, 1], [0, 1], 0.2, 0.2)),
    ],
)
def test_a_change_that_makes_no_sense_is_refused(said, arguments):
    with pytest.raises(ValueError, match=said):
        Change(*arguments)


def test_two_minutes_at_100_hz_take_seconds_at_most():
    times = np.arange(0.0, 120.0, 0.01)
    drive = strokes(times, 4e-3 + 3e-3 * np.sin(times))
    before = time.process_time()
    simulate(
        path(), PHYSICS, drive, SPRING, times, changes=[Change("friction", [0, 60], [1, 1.3])], ends_only=True
    )
    assert time.process_time() - before < 5.0  # measured: 0.5 s, that is 15 s for an hour


def observed(result, **faults):
    return measure(result, {"tension_in_N": Sensor(**faults)}, 1)["tension_in_N"]


def test_a_zero_follows_its_knots():
    result = run(SAW)
    read = observed(result, zero=([0, 20, 40], [0.0, 0.3, -0.1]))
    assert read - result.tension_in == pytest.approx(
        np.interp(result.times, [0, 20, 40], [0.0, 0.3, -0.1]), abs=1e-12
    )


def test_an_unplugged_sensor_reads_zero_or_its_last_value_or_noise():
    result = run(SAW)
    gone = result.times >= 25.0
    whole = observed(result, noise=0.05)
    for kind in ("zero", "hold", "noise"):
        read = observed(result, noise=0.05, unplugged_s=25.0, unplugged=kind)
        assert np.array_equal(read[~gone], whole[~gone])
        if kind == "noise":
            assert abs(read[gone].mean()) < 0.02  # 0.05/√300 = 0.003 is one standard error
            assert read[gone].std() == pytest.approx(0.05, rel=0.2)
        else:
            assert np.all(read[gone] == (whole[~gone][-1] if kind == "hold" else 0.0))
