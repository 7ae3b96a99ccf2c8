"""What the rig's instruments make of a run: faults of the instrument first, then those of the day."""

from dataclasses import replace

import numpy as np

from tests.campaigns.causes import Change
from tests.lumped import Sensor, measure
from tests.lumped.simulate import Run

SPECIFIED: dict[str, Sensor] = {
    "tension_in_N": Sensor(noise=0.02, resolution=0.01, full_scale=30.0, nonlinearity=1e-3),
    "tension_out_N": Sensor(noise=0.02, resolution=0.01, full_scale=30.0, nonlinearity=1e-3),
    "elongation_m": Sensor(noise=3e-6, resolution=1e-6, full_scale=0.05),
    "displacement_in_m": Sensor(noise=1e-6, resolution=5e-7, full_scale=0.05),
    "displacement_out_m": Sensor(noise=2e-6, resolution=1e-6, full_scale=0.05),
    "temperature_C": Sensor(noise=0.05, resolution=0.01, full_scale=100.0),
}
"""As the rig file states it."""
_DRIFT = {"tension_in_N": 0.004, "tension_out_N": 0.004}
_ZERO = {"tension_in_N": 0.004, "tension_out_N": 0.004, "elongation_m": 2e-6, "displacement_out_m": 2e-6}
# Zeros and drifts of the day: a fifth of the noise in tension; positions are zeroed by one reading.


def observed(
    run: Run, changes: list[Change], columns: list[str], seed: int, day: int
) -> dict[str, np.ndarray]:
    """Return the columns of a measured file; `seed` is the instruments', `day` the run's."""
    built = measure(run, _built(changes, seed), seed)
    marred = replace(
        run,
        tension_in=built["tension_in_N"],
        tension_out=built["tension_out_N"] + _warmth(run, changes),
        elongation=built["elongation_m"] - _jump(run, changes, day),
        displacement_out=built["displacement_out_m"] + _jump(run, changes, day),
    )
    rng = np.random.default_rng((seed, day))
    today = {name: _today(name, rng) for name in SPECIFIED}
    read = measure(marred, today, seed + 1000 * (day + 1))
    return {name: read[name] for name in ("time_s", *columns)}


def _built(changes: list[Change], seed: int) -> dict[str, Sensor]:
    """Sensors with their bends, a third of what is specified or more, and their faults."""
    rng = np.random.default_rng((seed, 77))
    share = rng.uniform(0.3, 1.0, len(SPECIFIED))
    sensors = {
        name: Sensor(nonlinearity=part * reported.nonlinearity, full_scale=reported.full_scale)
        for part, (name, reported) in zip(share, SPECIFIED.items(), strict=True)
    }
    for change in changes:
        for name, faults in change.sensors.items():
            sensors[name] = replace(sensors[name], **faults)
    return sensors


def _today(name: str, rng: np.random.Generator) -> Sensor:
    reported, zero = SPECIFIED[name], _ZERO.get(name, 0.0)
    return replace(
        reported,
        nonlinearity=0.0,
        offset=zero * rng.standard_normal(),
        drift=_DRIFT.get(name, 0.0),
        drift_time_s=rng.uniform(100.0, 400.0),
    )


def _warmth(run: Run, changes: list[Change]) -> np.ndarray:
    return sum(change.warm_N_per_K2 for change in changes) * (run.temperature - run.temperature[0]) ** 2


def _jump(run: Run, changes: list[Change], day: int) -> np.ndarray:
    """What the distal encoder has lost, from a moment in the middle half of the run on [m]."""
    share = np.random.default_rng(day).uniform(0.25, 0.75)
    late = run.times > run.times[0] + share * (run.times[-1] - run.times[0])
    return sum(change.slip_m for change in changes) * late
