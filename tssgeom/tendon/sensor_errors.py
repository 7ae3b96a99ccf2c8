"""What effects make sensors read: the true proximal tension from a reading, and a reading of it."""

from __future__ import annotations

import numpy as np

from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.tendon.bars import with_effects
from tssgeom.tendon.bars.sensors import bend, err, unbent
from tssgeom.tendon.bars.with_effects import effective_setup
from tssgeom.tendon.capstan import Corners
from tssgeom.tendon.state import TendonState, required_setup


def true_tension(rig: Rig, reading: float) -> float:
    """Return the proximal tension [N] behind a reading of its sensor [N]; docs/model.md (61)."""
    setup = effective_setup(rig)
    if setup is None or not err(setup):
        return reading
    true = (reading - setup.tension_in_offset_N) / setup.tension_in_gain
    return max(float(unbent(setup, "tension_in_N", np.array([true]))[0]), 0.0)


def reading_of(rig: Rig, tension_in: float) -> float:
    """Return what the sensor of the proximal tension reads [N] of a tension [N]; docs/model.md (61)."""
    setup = effective_setup(rig)
    if setup is None:
        return tension_in
    bent = float(bend(setup, "tension_in_N", np.array([tension_in]))[0]) if setup.curves else 0.0
    return tension_in * setup.tension_in_gain + setup.tension_in_offset_N + bent


def sensors_err(rig: Rig) -> bool:
    """Whether effects make any sensor read another value than the true one."""
    setup = effective_setup(rig)
    return setup is not None and err(setup)


def readings(state: TendonState, rig: Rig) -> dict[str, float]:
    """Return what the sensors read after a step with effects, by the names of `sensors.CHANNELS` [N, m].

    Raises SettingsError where no effect acted in the last step.
    """
    if isinstance(state.along, Corners) or not state.along.has_effects:
        raise SettingsError("no effect acted in the last step: sensors read what `transmit` returns")
    return with_effects.readings(state.along, required_setup(rig))
