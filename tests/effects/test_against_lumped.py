"""Each effect against the independent simulator with the same physics switched on."""

import functools

import numpy as np
import pytest

from tests.effects.rig import FORCE, PHYSICS, POSITION, STEP, modelled, refereed
from tssgeom.effects import (
    KINDS,
    EndFittingFrictionDistal,
    EndFittingFrictionProximal,
    FrictionLaw,
    with_size,
)

LEAST = {"N": 5e-3, "m": 1e-6}  # below it a signature is not above the errors of both sides
SHARE = 0.035  # of the signature, rms; 30 bars, 80 cells and steps of 0.01 s leave up to 0.029
ENDED = {
    "end_fitting_friction_proximal": EndFittingFrictionProximal(force_N=0.3),
    "end_fitting_friction_distal": EndFittingFrictionDistal(force_N=0.3),
}


BY_RATE = 0.01  # s; drag lets go within 0.05 s of a turn, which both sides have to see


@functools.cache
def base(drive):
    return refereed(drive), modelled(drive)


def differences(drive, effect, step=STEP, **physics):
    """Return for each channel the rms of the referee's signature and of what the model's misses of it."""
    (plain, ours), observed = base(drive), refereed(drive, step, **physics)
    mine = modelled(drive, effect, longest_step_s=step)
    result = {}
    for channel in ours:
        if channel != drive:
            wanted = observed[channel] - plain[channel]
            missed = mine[channel] - ours[channel] - wanted
            result[channel] = np.sqrt(np.mean(wanted**2)), np.sqrt(np.mean(missed**2))
    return result


@pytest.mark.parametrize("drive", [FORCE, POSITION])
@pytest.mark.parametrize("name", PHYSICS)
def test_the_signature_is_the_referees(name, drive):
    physics = {key: value for key, value in PHYSICS[name].items() if "ratio" not in key or name == "creep"}
    effect = ENDED.get(name, with_size(KINDS[name]))
    step = BY_RATE if name in ("viscous_drag", "velocity_dependent_friction") else STEP
    compared = 0
    for channel, (wanted, missed) in differences(drive, effect, step, **physics).items():
        if wanted > LEAST[channel[-1]]:
            compared += 1
            assert missed < SHARE * wanted, channel
        else:
            assert missed < LEAST[channel[-1]], channel
    assert compared


@pytest.mark.parametrize("end", ["in", "out"])
def test_a_fitting_that_holds_a_share_of_the_tension_is_the_referees(end):
    kind = EndFittingFrictionProximal if end == "in" else EndFittingFrictionDistal
    result = differences(FORCE, kind(ratio=0.05), **{f"fitting_{end}_ratio": 0.05})
    wanted, missed = result["tension_out_N"]
    assert missed < SHARE * wanted


SLOW = 1e-3  # m/s
FALLING = {"stribeck_gain": 0.3, "stribeck_speed_m_per_s": SLOW, "speed_lag_s": 0.5}


def test_friction_that_falls_with_speed_within_a_time_is_the_referees():
    speed = np.array([0.0, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 2.7, 3.5, 5.0, 7.0, 10.0]) * SLOW
    factor = 1.0 + 0.3 * np.exp(-speed / SLOW)
    law = {"over": "speed", "x": tuple(speed), "factor": tuple(factor)}
    result = differences(POSITION, FrictionLaw(**law, memory_s=0.5), BY_RATE, **FALLING)
    wanted, missed = result["tension_out_N"]
    assert missed < SHARE * wanted
    _, forgetful = differences(POSITION, FrictionLaw(**law), BY_RATE, **FALLING)["tension_out_N"]
    assert forgetful > 3.0 * missed


def test_the_base_is_the_referees():
    for drive in (FORCE, POSITION):
        plain, ours = base(drive)
        for channel in ours:
            size = {"N": 0.01, "m": 1e-6}[channel[-1]]  # what 80 cells promise
            assert np.abs(plain[channel] - ours[channel]).max() < size
