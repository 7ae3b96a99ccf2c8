"""Limits of plausibility, each with its origin."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tssgeom.core.constants import CHANCE

STANDARD_GRAVITY = 9.80665
"""Newtons a kilogram-force [N/kgf]. Source: the third General Conference on Weights and Measures, 1901."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Chosen: wide enough for every run of tests/campaigns and tests/lumped; each field has its own reason.

    `tests/plausibility` counts the false warnings that they give.
    """

    largest_strain: float = 0.5
    """Chosen: no tendon recovers from more. Strain of the tendon at a tension [1]."""
    slight: float = 0.05
    """Chosen: more than noise or a reading or two make, twice what a cell's zero may be off, and a usual
    error of a gain; less is no motion, no bend, no work, and no length beside the whole. Of a range [1]."""
    negligible: float = 0.01
    """Chosen: less is invisible in a picture, and meshes, drives and batches differ by as much; a
    noise that changes by less has converged. Share of a
    quantity by which it has to differ before anything is said or done about it [1]."""
    usual_strain: float = 0.1
    """Chosen: steel yields at 0.01, polymers are used to 0.05. Strain that is worth a warning [1]."""
    weakest_N: float = 0.05
    """Chosen: the noise of a common load cell. Least range of a tension [N]."""
    strongest_N: float = 2000.0
    """Chosen: a steel cable of 1.5 mm breaks there. Greatest tension without a rig [N]."""
    hottest_C: float = 150.0
    """Chosen: no plastic sheath is so hot, and no room so cold in kelvin. Temperature [°C]."""
    warmest_C: float = 60.0
    """Chosen: rooms and bodies are colder, and warmer in degrees Fahrenheit; no laboratory is so far below
    zero. Temperature [°C]."""
    largest_stroke: float = 2.0
    """Chosen: a tendon is not pulled out of its sheath. Travel of a drive over the length of the
    route [1]."""
    usual_stretch: float = 6.0
    """Chosen: a compliance may be wrong by 3; kgf for N make 9.8. Measured stretch over that of compliance
    and tension, or its inverse, from which a warning is due [1]."""
    negative: float = 0.02
    """Chosen: the zero of a cheap cell. Tension below zero, of its range [1]."""
    share_of_rows: float = 0.3
    """Chosen: more than an episode. Share of these rows that break a rule [1]."""
    largest_friction: float = 0.4
    """Chosen: polymer liners have 0.05 to 0.2, dry steel 0.3. Friction coefficient from T_in, T_out
    and Φ [1]."""
    fitting_share: float = 0.5
    """Chosen: end fittings and straight parts take less. T_in that is lost without any bend [1]."""
    opposite: float = -0.5
    """Chosen: hysteresis alone leaves a positive correlation, and a lag a smaller one. Correlation of two
    channels of one motion, and of the motor's torque with its direction, beside angle and load [1]."""
    explained: float = 0.8
    """Chosen: hysteresis and other tendons leave the rest. Bending that the pulls of a segment explain, of
    its size [1]."""
    lag_share: float = 0.07
    """Chosen: the lags of sound runs are below it. Lag over the time of a leg of the drive [1]."""
    lag_rows: float = 3.0
    """Chosen: a turn between two rows is known to one. Lag over the time of a row, or of a mean of
    rows [1]."""
    turn_share: float = 0.1
    """Chosen: more than ripple. Way back from which a drive has turned, of its range [1]."""
    clipped_rows: int = 5
    """Chosen: digits alone make fewer equal rows beside a drive that moves on. Equal rows at an
    extreme [1]."""
    repeated_rows: int = 10
    """Chosen: with noise in two channels the chance is below 10⁻¹⁰. Rows that occur twice in a
    row, and fewest rows or frames that show how much something varies [1]."""
    pause: float = 50.0
    """Chosen: longer than a lost packet, and no recorder varies so much. Time between rows over a usual one,
    or its inverse [1]."""
    spike: float = 0.3
    """Chosen: no drive moves so far in one row and back. Reading off both neighbours, of the range [1]."""
    most_rig_friction: float = 1.0
    """Chosen: no pair of materials of a sheath has it. Friction coefficient of a rig [1]."""
    frozen_frames: int = 100
    """Chosen: one second of a usual sensor. Frames that repeat a reading which varied before [1]."""
    fastest_m_per_s: float = 10.0
    """Chosen: an arm that swings is slower. Speed of half of the points of a route [m/s]."""
    largest_noise: float = 0.1
    """Chosen: a sensor with more shows no bend; sensors of routes have 10⁻⁴ to 10⁻². Stated noise of a
    coordinate over the length of the route [1]."""
    least_turn_rad: float = 0.035
    """Chosen: two degrees, and a radian or two that stand for as many degrees. Least range of a joint that
    moves [rad]."""
    fewest_rows: int = 20
    """Chosen: a fit needs more than its parameters. Rows with both drive and response [1]."""
    judged_N: float = 1.0
    """Chosen: the tension at which a rig's own strain is judged [N]."""

    @property
    def usual_error(self) -> float:
        """What errors of gain or zero can make, of a range [1]."""
        return CHANCE.clear * self.slight

    @property
    def along(self) -> float:
        """Half-way to a sixth of a turn off. Bending along the rig's directions, of what any explain [1]."""
        return math.cos(math.pi / 6.0)

    @property
    def gross(self) -> float:
        """Half-way between right and kgf for N. Reading over full scale, or T_out over T_in [1]."""
        return math.sqrt(STANDARD_GRAVITY)

    @property
    def stretch_ratio(self) -> float:
        """Half-way between right and mm for m: measured stretch over that of compliance and tension [1]."""
        return math.sqrt(1000.0)


LIMITS = Limits()
