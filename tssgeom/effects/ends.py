"""Effects at both ends of a run: its pretension, the backlash of the drive, and the sensors.

Source: docs/model.md (59), (61), (62), (353).
"""

from dataclasses import replace
from typing import ClassVar, Literal

from tssgeom.effects.kinds import ANSWERS, LOSSES, PATHS, Channel, Effect, Hook, Parameter, Setup, Tie
from tssgeom.errors import SettingsError

_GAIN = Parameter("1", -0.5, 1.0, 0.03, 0.03)
_OFFSET = Parameter("N", -20.0, 20.0, 0.25, 0.3)
_PLAY = {
    "width_m": Parameter("m", 0.0, 0.02, 2e-4, 3e-4),
    "open_m": Parameter("m", 0.0, 0.02, 0.0, 3e-4),  # 0 is a run that starts engaged
}
_WEIGHT = "hang a known weight on each load cell"
_ONE_WAY = "only tensions were measured, and the whole tendon slides in one direction"
_NO_LOSS = "a sheath without friction, the zero of displacement unknown"


def _scale_of_force(other: str) -> tuple[Tie, ...]:
    partners = (other, "rig.tendon.compliance_per_N")
    return (
        Tie("G1", partners, "pretension and load stiffness are known through the same cells", _WEIGHT),
        Tie("G8", (other, "rig.friction.coefficient"), _ONE_WAY, _WEIGHT),
    )


class PretensionError(Effect, frozen=True):
    """The tendon starts at another tension than that of the rig; docs/model.md (59).

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
    """Motion that the drive loses when it turns back: a play of its width; docs/model.md (59), (334).

    Each run starts with `open_m` of it to be taken up for pulling: engaged where that is 0.
    Source: M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash, Automatica 38 (2002).
    """

    width_m: float
    """Motion lost at each turn [m]."""
    open_m: float = 0.0
    """Motion that pulls nothing when a run begins, at most the width [m]."""

    hook: ClassVar[Hook] = "boundary"
    by_force: ClassVar[tuple[Channel, ...]] = PATHS
    parameters: ClassVar[dict[str, Parameter]] = _PLAY
    ties: ClassVar[tuple[Tie, ...]] = ()

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(setup, backlash_m=self.width_m, backlash_open_m=min(self.open_m, self.width_m))


class LoadFriction(Effect, frozen=True):
    """The load itself rubs, a slider on its bench: it moves after T_out has changed by twice this.

    T_out is that of the tendon, before the load. Equation: docs/model.md (333). Source: Coulomb friction.
    """

    force_N: float
    """Friction force of the load [N]."""

    hook: ClassVar[Hook] = "boundary"
    adds: ClassVar[dict[str, str]] = {"load_friction_N": "force_N"}
    by_force: ClassVar[tuple[Channel, ...]] = ("displacement_in_m", "displacement_out_m")
    parameters: ClassVar[dict[str, Parameter]] = {"force_N": Parameter("N", 0.0, 20.0, 0.3, 0.5)}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie("G4", ("end_fitting_friction_distal",), "T_out is not measured", "a cell before the load"),
    )


class LoadPlay(Effect, frozen=True):
    """Play between the load and what measures its way; docs/model.md (319), (334).

    It begins as that of `Backlash`, and acts on a measured elongation too. Source: as there.
    """

    width_m: float
    """Motion that is not read after each turn [m]."""
    open_m: float = 0.0
    """Motion towards the tendon that is not read when a run begins, at most the width [m]."""

    hook: ClassVar[Hook] = "observation"
    by_force: ClassVar[tuple[Channel, ...]] = ("displacement_out_m", "elongation_m")
    by_position: ClassVar[tuple[Channel, ...]] = ("displacement_out_m", "elongation_m")
    parameters: ClassVar[dict[str, Parameter]] = _PLAY
    ties: ClassVar[tuple[Tie, ...]] = ()

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(setup, load_play_m=self.width_m, load_play_open_m=min(self.open_m, self.width_m))


class TensionInGain(Effect, frozen=True):
    """The proximal load cell reads (1 + e) T.

    Equation: docs/model.md (61). Source: calibration error of a load cell.
    """

    gain_error: float
    """Relative error e [1]."""

    hook: ClassVar[Hook] = "observation"
    by_position: ClassVar[tuple[Channel, ...]] = ("tension_in_N",)
    parameters: ClassVar[dict[str, Parameter]] = {"gain_error": _GAIN}
    ties: ClassVar[tuple[Tie, ...]] = _scale_of_force("tension_out_gain")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(setup, tension_in_gain=setup.tension_in_gain * (1.0 + self.gain_error))


class TensionOutGain(Effect, frozen=True):
    """The distal load cell reads (1 + e) T; docs/model.md (61). Source: calibration error of a load cell."""

    gain_error: float
    """Relative error e [1]."""

    hook: ClassVar[Hook] = "observation"
    by_force: ClassVar[tuple[Channel, ...]] = ("tension_out_N",)
    by_position: ClassVar[tuple[Channel, ...]] = ("tension_out_N",)
    parameters: ClassVar[dict[str, Parameter]] = {"gain_error": _GAIN}
    ties: ClassVar[tuple[Tie, ...]] = _scale_of_force("tension_in_gain")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(setup, tension_out_gain=setup.tension_out_gain * (1.0 + self.gain_error))


class TensionInOffset(Effect, frozen=True):
    """The proximal load cell reads T plus a constant.

    Equation: docs/model.md (61). Source: zero drift of a load cell.
    """

    offset_N: float
    """What it reads at no load [N]."""

    hook: ClassVar[Hook] = "observation"
    adds: ClassVar[dict[str, str]] = {"tension_in_offset_N": "offset_N"}
    by_position: ClassVar[tuple[Channel, ...]] = ("tension_in_N",)
    parameters: ClassVar[dict[str, Parameter]] = {"offset_N": _OFFSET}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie("G1", ("tension_out_offset",), _NO_LOSS, "read both cells unloaded"),
    )


class TensionOutOffset(Effect, frozen=True):
    """The distal load cell reads T plus a constant; docs/model.md (61). Source: zero drift of a load cell."""

    offset_N: float
    """What it reads at no load [N]."""

    hook: ClassVar[Hook] = "observation"
    adds: ClassVar[dict[str, str]] = {"tension_out_offset_N": "offset_N"}
    by_force: ClassVar[tuple[Channel, ...]] = ("tension_out_N",)
    by_position: ClassVar[tuple[Channel, ...]] = ("tension_out_N",)
    parameters: ClassVar[dict[str, Parameter]] = {"offset_N": _OFFSET}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie("G1", ("tension_in_offset",), _NO_LOSS, "read both cells unloaded"),
    )


class ChannelLag(Effect, frozen=True):
    """One channel passes a first-order filter before it is stored, or all distal channels are recorded late.

    Equation: docs/model.md (62), (353). Source: low-pass filter of an amplifier; two clocks. The drive's own
    channel cannot lag: what it reads is what drives.
    """

    lag_s: float
    """Time constant of the filter, or how late the recorder is [s]."""
    channel: Channel | Literal["distal"] = "tension_out_N"
    """The channel that lags; `distal`: T_out, x_out and a measured elongation are late by one time."""

    hook: ClassVar[Hook] = "observation"
    by_force: ClassVar[tuple[Channel, ...]] = LOSSES
    by_position: ClassVar[tuple[Channel, ...]] = ANSWERS
    parameters: ClassVar[dict[str, Parameter]] = {"lag_s": Parameter("s", 0.0, 100.0, 0.05, 0.1)}

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it; raises SettingsError where the channel lags already."""
        if self.channel == "distal":
            if setup.distal_delay_s > 0.0:
                raise SettingsError("effects.channel_lag: distal lags twice; give one lag_s [s]")
            return replace(setup, distal_delay_s=self.lag_s)
        if any(channel == self.channel for channel, _ in setup.lags):
            raise SettingsError(f"effects.channel_lag: {self.channel} lags twice; give one lag_s [s]")
        if self.lag_s == 0.0:
            return setup
        return replace(setup, lags=(*setup.lags, (self.channel, self.lag_s)))


class LoadCellCrosstalk(Effect, frozen=True):
    """The distal load cell reads a share of the proximal tension; docs/model.md (61).

    Source: two cells on one frame that gives way.
    """

    share: float
    """Share of T_in in the distal reading [1]."""

    hook: ClassVar[Hook] = "observation"
    adds: ClassVar[dict[str, str]] = {"crosstalk": "share"}
    by_force: ClassVar[tuple[Channel, ...]] = ("tension_out_N",)
    by_position: ClassVar[tuple[Channel, ...]] = ("tension_out_N",)
    parameters: ClassVar[dict[str, Parameter]] = {"share": Parameter("1", -0.5, 0.5, 0.02, 0.03)}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G1",
            ("tension_out_gain",),
            "there is no friction, or the whole tendon slides in one direction",
            "load one cell alone",
        ),
    )
