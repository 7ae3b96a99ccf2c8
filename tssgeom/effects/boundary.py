"""Effects of the boundary: how the run starts, and what lies between the drive and its scale."""

from dataclasses import replace
from typing import ClassVar

from tssgeom.effects.kinds import PATHS, Channel, Effect, Hook, Parameter, Setup, Tie


class PretensionError(Effect, frozen=True):
    """The tendon starts at another tension than the rig says; docs/model.md (59).

    Source: paper, eq. (4); what is left below zero counts as zero.
    """

    error_N: float
    """True pretension less that of the rig [N]."""

    hook: ClassVar[Hook] = "boundary"
    parameters: ClassVar[dict[str, Parameter]] = {"error_N": Parameter("N", -50.0, 50.0, 0.6, 1.0)}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G1",
            ("zero of displacement in each run",),
            "the first pull is not in the data",
            "record from rest, or print the tension of rest",
        ),
    )

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(setup, pretension=max(setup.pretension + self.error_N, 0.0))


class Backlash(Effect, frozen=True):
    """Motion that the drive loses when it turns back: a play of its width; docs/model.md (59).

    It starts engaged for pulling. Source: M. Nordin, P.-O. Gutman, Controlling mechanical systems with
    backlash, Automatica 38 (2002).
    """

    width_m: float
    """Motion lost at each turn [m]."""

    hook: ClassVar[Hook] = "boundary"
    by_force: ClassVar[tuple[Channel, ...]] = PATHS
    parameters: ClassVar[dict[str, Parameter]] = {"width_m": Parameter("m", 0.0, 0.02, 2e-4, 3e-4)}
    ties: ClassVar[tuple[Tie, ...]] = ()

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(setup, backlash_m=setup.backlash_m + self.width_m)
