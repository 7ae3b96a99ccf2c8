"""Effects of stretch: the tendon and what it hangs on are no straight line, and no line for ever."""

from dataclasses import replace
from typing import ClassVar, Literal

from tssgeom.effects.kinds import PATHS, Channel, Effect, Hook, Parameter, Setup, Tie

_SCALE = Parameter("N", 0.05, 100.0, 2.0, 2.0, centre=2.0, switch=False)
_SERIES = Parameter("m/N", 0.0, 1e-2, 2e-5, 4e-5)
_STRAIGHT = "the tension is the same all along: no friction, or a straight sheath"
_BENT = "a run on a bent route, pulled and released"


class SlackTakeUp(Effect, frozen=True):
    """Slack outside of the sheath is taken up by the first newtons: d (1 − e^(−T/scale)); docs/model.md (50).

    Source: paper, Fig. 5: measured minus simulated elongation is 1.69 mm, not linear below 4 N.
    """

    slack_m: float
    """Length that is taken up in the end [m]."""
    scale_N: float = 2.0
    """Tension over which it is taken up [N]."""
    end: Literal["proximal", "distal"] = "proximal"
    """Where the slack is."""

    hook: ClassVar[Hook] = "bar law"
    by_force: ClassVar[tuple[Channel, ...]] = PATHS
    parameters: ClassVar[dict[str, Parameter]] = {
        "slack_m": Parameter("m", 0.0, 0.05, 5e-4, 1e-3),
        "scale_N": _SCALE,
    }
    ties: ClassVar[tuple[Tie, ...]] = (Tie("G10", ("toe_region",), _STRAIGHT, _BENT),)

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        if self.end == "proximal":
            return replace(setup, take_up_in_m=self.slack_m, take_up_in_scale_N=self.scale_N)
        return replace(setup, take_up_out_m=self.slack_m, take_up_out_scale_N=self.scale_N)


class ToeRegion(Effect, frozen=True):
    """The tendon itself is soft at first: strain e (1 − e^(−T/scale)) beside the linear one.

    Equation: docs/model.md (50).

    Strands are compacted before they stretch. Source: Y. C. Fung, Elasticity of soft tissues in simple
    elongation, Am. J. Physiol. 213 (1967), for the exponential.
    """

    strain: float
    """Strain of the toe in the end [1]."""
    scale_N: float = 2.0
    """Tension over which it is stretched out [N]."""

    hook: ClassVar[Hook] = "bar law"
    sets: ClassVar[dict[str, str]] = {"toe_strain": "strain", "toe_scale_N": "scale_N"}
    by_force: ClassVar[tuple[Channel, ...]] = PATHS
    parameters: ClassVar[dict[str, Parameter]] = {
        "strain": Parameter("1", 0.0, 0.05, 8e-4, 1.5e-3),
        "scale_N": _SCALE,
    }
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie("G10", ("slack_take_up",), _STRAIGHT, _BENT),
        Tie("G10", ("sheath_clearance",), "one route of one curvature", "a second route of another angle"),
    )


class Creep(Effect, frozen=True):
    """Strain that follows the tension late: a Kelvin-Voigt element beside the spring; docs/model.md (57).

    At rest under the pretension. Source: W. N. Findley, J. S. Lai, K. Onaran, Creep and Relaxation of
    Nonlinear Viscoelastic Materials (1976), linear part.
    """

    ratio: float
    """Creep in the end over elastic strain [1]."""
    time_s: float = 20.0
    """Time constant [s]."""

    hook: ClassVar[Hook] = "eigenstrain"
    sets: ClassVar[dict[str, str]] = {"creep_ratio": "ratio", "creep_time_s": "time_s"}
    parameters: ClassVar[dict[str, Parameter]] = {
        "ratio": Parameter("1", 0.0, 2.0, 0.06, 0.1),
        "time_s": Parameter("s", 1e-3, 1e5, 20.0, 20.0, centre=20.0, switch=False),
    }
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G2",
            ("rig.tendon.compliance_per_N",),
            "time_s is much shorter than a sample, or much longer than the run",
            "a hold of several time constants after a fast pull",
        ),
    )


class SeriesComplianceProximal(Effect, frozen=True):
    """What lies between drive and sheath gives way with T_in; docs/model.md (50).

    Exposed tendon, shafts, the drive's mount. Source: Hooke's law.
    """

    compliance_m_per_N: float
    """Stretch per proximal tension [m/N]."""

    hook: ClassVar[Hook] = "bar law"
    adds: ClassVar[dict[str, str]] = {"series_in_m_per_N": "compliance_m_per_N"}
    by_force: ClassVar[tuple[Channel, ...]] = PATHS
    parameters: ClassVar[dict[str, Parameter]] = {"compliance_m_per_N": _SERIES}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie("G2", ("series_compliance_distal", "rig.tendon.compliance_per_N"), _STRAIGHT, _BENT),
    )


class SeriesComplianceDistal(Effect, frozen=True):
    """What lies between sheath and load gives way with T_out; docs/model.md (50).

    Source: Hooke's law.
    """

    compliance_m_per_N: float
    """Stretch per distal tension [m/N]."""

    hook: ClassVar[Hook] = "bar law"
    adds: ClassVar[dict[str, str]] = {"series_out_m_per_N": "compliance_m_per_N"}
    by_force: ClassVar[tuple[Channel, ...]] = PATHS
    parameters: ClassVar[dict[str, Parameter]] = {"compliance_m_per_N": _SERIES}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie("G2", ("series_compliance_proximal", "rig.tendon.compliance_per_N"), _STRAIGHT, _BENT),
        Tie(
            "G2",
            ("rig.load.stiffness_N_per_m",),
            "neither displacement_out nor elongation was measured",
            "measure the distal displacement",
        ),
    )


class ThermalDrift(Effect, frozen=True):
    """The tendon grows against its sheath with the temperature since the run began: strain α ΔT.

    Equation: docs/model.md (58).

    Source: linear thermal expansion.
    """

    expansion_per_K: float
    """Expansion of the tendon less that of the sheath α [1/K]."""

    hook: ClassVar[Hook] = "eigenstrain"
    adds: ClassVar[dict[str, str]] = {"expansion_per_K": "expansion_per_K"}
    needs: ClassVar[tuple[str, ...]] = ("temperature_C",)
    parameters: ClassVar[dict[str, Parameter]] = {
        "expansion_per_K": Parameter("1/K", -1e-3, 1e-3, 1.5e-5, 3e-5)
    }
