"""What a simulated rig is made of: the tendon and sheath with their extra effects, the drive, the far end."""

from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True, slots=True)
class Physics:
    """Tendon, sheath and ends. The defaults are a linear tendon with Coulomb friction, all else off.

    The friction coefficient of a vertex is the product

        friction · (1 ± asymmetry) · (1 + curvature_gain_m κ) · (load / load_reference)^load_exponent
        · profile(s) · (1 + wear_gain (1 − e^(−travel/wear_travel_m)))
        · (1 + speed_gain ln(1 + v/speed_reference) + stribeck_gain e^(−v/stribeck_speed))

    with κ the curvature, v the speed and `travel` the path slid so far, each of the vertex itself.
    """

    # the tendon and the sheath
    friction: float = 0.145
    """Coulomb coefficient [1]."""
    compliance_per_N: float = 3.16e-4
    """Strain per tension [1/N]."""
    pretension_N: float = 0.0
    """Tension all along, without friction, before the run [N]."""
    slack_m: float = 0.0
    """What the drive takes up before anything pulls; there is no pretension then [m]."""

    # what the friction coefficient depends on
    asymmetry: float = 0.0
    """Pulling (towards the proximal end) has 1 + asymmetry, releasing 1 − asymmetry [1]."""
    curvature_gain_m: float = 0.0
    load_exponent: float = 0.0
    """> −1; 0 is Coulomb, −1/3 a Hertzian contact [1]."""
    load_measure: Literal["tension", "normal"] = "tension"
    """The load is the tension [N] or the normal force per length [N/m]."""
    load_reference: float = 10.0
    """Load at which the coefficient is the nominal one [N or N/m]."""
    profile_s_m: tuple[float, ...] = (0.0,)
    """Arc lengths from the proximal end where `profile` is given; linear between, constant beyond [m]."""
    profile: tuple[float, ...] = (1.0,)
    wear_gain: float = 0.0
    """Relative change of the coefficient after much travel; below 0 it is a run-in [1]."""
    wear_travel_m: float = 0.1
    speed_gain: float = 0.0
    speed_reference_m_per_s: float = 1e-3
    stribeck_gain: float = 0.0
    stribeck_speed_m_per_s: float = 1e-3
    speed_lag_s: float = 0.0
    """Friction follows the speed with this lag [s]. Friction that falls with speed needs it: without,
    sliding is unstable and the quasi-static problem has no unique answer."""

    # friction that does not come from tension and turn
    straight_friction_N_per_m: float = 0.0
    """Coulomb force per length of sheath, curved or not [N/m]."""
    viscous_drag_Ns_per_m2: float = 0.0
    """Force per length and local sliding speed [N·s/m²]."""
    fitting_in_N: float = 0.0
    """Constant Coulomb force of the fitting at the proximal end [N]."""
    fitting_out_N: float = 0.0
    load_friction_N: float = 0.0
    """Of a load that slides on its bench; the distal cell stands before it [N]."""
    fitting_in_ratio: float = 0.0
    """Coulomb force of the fitting per mean tension of its two sides [1]."""
    fitting_out_ratio: float = 0.0

    # the route as the tendon sees it
    bend_at_m: float = 0.0
    """Middle of a bend that the route does not contain [m]."""
    bend_angle_rad: float = 0.0
    bend_width_m: float = 0.02
    clearance_m: float = 0.0
    """Path that a taut tendon saves per turn [m/rad]."""
    clearance_scale_N: float = 2.0
    """Tension over which it becomes taut: the path saved is clearance · turn · (1 − e^(−T/scale)) [N]."""

    # elasticity inside the sheath
    toe_strain: float = 0.0
    """Strain toe_strain (1 − e^(−T/toe_scale_N)) beside the linear one [1]."""
    toe_scale_N: float = 2.0
    creep_ratios: tuple[float, ...] = ()
    """Kelvin–Voigt elements: final creep over elastic strain [1]; at rest under the pretension."""
    creep_times_s: tuple[float, ...] = ()
    expansion_per_K: float = 0.0
    """Thermal strain of the tendon against the sheath [1/K]."""

    # outside the sheath
    series_in_m_per_N: float = 0.0
    series_out_m_per_N: float = 0.0
    take_up_in_m: float = 0.0
    """Slack taken up between drive and sheath: take_up (1 − e^(−T/take_up_scale)) [m]."""
    take_up_in_scale_N: float = 2.0
    take_up_out_m: float = 0.0
    take_up_out_scale_N: float = 2.0
    backlash_m: float = 0.0
    """Lost motion of the drive when it turns back; it starts engaged for pulling [m]."""

    def __post_init__(self) -> None:
        if len(self.creep_ratios) != len(self.creep_times_s):
            raise ValueError(
                f"{len(self.creep_ratios)} creep ratios, {len(self.creep_times_s)} times: give as many"
            )
        if self.slack_m < 0.0 or (self.slack_m > 0.0 and self.pretension_N != 0.0):
            raise ValueError(
                f"slack {self.slack_m} m with pretension {self.pretension_N} N: a slack tendon has none"
            )
        if self.load_friction_N and (self.fitting_out_N or self.fitting_out_ratio):
            raise ValueError("friction of load and distal fitting: one contact has both, give one of them")
        if self.load_exponent <= -1.0:
            raise ValueError(
                f"load exponent {self.load_exponent}: friction force would fall with load; keep it > -1"
            )


@dataclass(frozen=True, slots=True)
class Drive:
    """What the proximal end does, linear between times; displacement 0 is the pretensioned state."""

    kind: Literal["force", "displacement"]
    times: np.ndarray
    """[D] s, increasing."""
    values: np.ndarray
    """[D] N, or m towards the proximal side."""
    temperature_C: np.ndarray | None = None
    """[D] °C; none is 20 °C throughout."""


@dataclass(frozen=True, slots=True)
class Distal:
    """What the tendon does at its far end: held, on a spring, or under a dead weight of the pretension."""

    kind: Literal["blocked", "spring", "weight"]
    stiffness_N_per_m: float = 0.0
    """Of the spring; the pretension is its force at displacement 0."""
