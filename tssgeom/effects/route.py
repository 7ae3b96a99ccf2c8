"""Effects of the route: what the tendon follows is not what was sensed."""

from dataclasses import replace
from typing import ClassVar

from tssgeom.effects.kinds import PATHS, Bend, Channel, Effect, Hook, Parameter, Setup, Tie


class HiddenBend(Effect, frozen=True):
    """A bend that the sensed route does not show, even over its width; docs/model.md (60).

    A kink at a clamp, a coil behind the last sensor. Source: paper, Theorem 1 and section II-D.
    """

    at_m: float
    """Arc length of its middle from the proximal end [m]."""
    angle_rad: float
    """Curve angle that it adds [rad]."""
    width_m: float = 0.02
    """Arc length over which it bends [m]."""

    hook: ClassVar[Hook] = "route"
    parameters: ClassVar[dict[str, Parameter]] = {
        "at_m": Parameter("m", 0.0, 100.0, 0.25, 100.0, centre=0.25, switch=False),
        "angle_rad": Parameter("rad", 0.0, 12.0, 0.6, 1.0),
        "width_m": Parameter("m", 1e-6, 1.0, 0.02, 0.02, centre=0.02, switch=False, fitted=False),
    }
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G4",
            ("end_fitting_friction_proximal", "end_fitting_friction_distal"),
            "the bend is at that end",
            "take the fitting off, or unbend that end",
        ),
        Tie(
            "G3",
            ("rig.friction.coefficient",),
            "only tensions were measured, on one route",
            "measure elongation as well, or a second route",
        ),
    )

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        if self.angle_rad == 0.0:
            return setup
        return replace(setup, bends=(*setup.bends, Bend(self.at_m, self.angle_rad, self.width_m)))


class SheathClearance(Effect, frozen=True):
    """A taut tendon lies at the inner side of a bend and saves path: c θ (1 − e^(−T/scale)).

    Equation: docs/model.md (50).

    Slack it lies anywhere in the lumen. Source: geometry of parallel curves, whose lengths differ by distance
    times angle.
    """

    clearance_m_per_rad: float
    """Path saved for each radian when taut: how far the tendon moves across the lumen [m/rad]."""
    scale_N: float = 2.0
    """Tension over which it becomes taut [N]."""

    hook: ClassVar[Hook] = "bar law"
    by_force: ClassVar[tuple[Channel, ...]] = PATHS
    parameters: ClassVar[dict[str, Parameter]] = {
        "clearance_m_per_rad": Parameter("m/rad", 0.0, 5e-3, 1e-4, 2e-4),
        "scale_N": Parameter("N", 0.05, 100.0, 2.0, 2.0, centre=2.0, switch=False),
    }
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G10",
            ("toe_region",),
            "one route of one curvature",
            "a second route of the same length and another angle",
        ),
    )

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        clearance = setup.clearance_m_per_rad + self.clearance_m_per_rad
        return replace(setup, clearance_m_per_rad=clearance, clearance_scale_N=self.scale_N)
