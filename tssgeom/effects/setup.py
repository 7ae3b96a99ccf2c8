"""One run's physics as numbers: the rig's own and what its effects add. Each effect changes a few of them."""

from dataclasses import dataclass

from tssgeom.effects.kinds import Channel


@dataclass(frozen=True, slots=True)
class Setup:
    """Tendon, sheath, ends and sensors of a run; the defaults are the base model.

    Source: docs/model.md (50)-(62).
    """

    friction: float
    """Coulomb coefficient μ [1]."""
    compliance: float
    """Strain per tension ρ [1/N]."""
    pretension: float
    """Tension before the run T_0 [N]."""
    load_stiffness: float
    """Distal spring; 0 is a dead weight, inf a fixed end [N/m]."""

    # friction
    load_exponent: float = 0.0
    load_reference_N: float = 10.0
    speed_gain: float = 0.0
    speed_reference_m_per_s: float = 1e-3
    drag_Ns_per_m2: float = 0.0
    straight_friction_N_per_m: float = 0.0
    curvature_gain_m: float = 0.0
    asymmetry: float = 0.0
    wear_gain: float = 0.0
    wear_travel_m: float = 0.05
    fitting_in_N: float = 0.0
    fitting_out_N: float = 0.0
    fitting_in_exponent: float = 0.0
    fitting_out_exponent: float = 0.0

    # route
    bends: tuple[tuple[float, float, float], ...] = ()
    """Middle [m], angle [rad] and width [m] of each bend that the sensed route does not show."""
    clearance_m_per_rad: float = 0.0
    clearance_scale_N: float = 2.0

    # elasticity
    take_up_in_m: float = 0.0
    take_up_in_scale_N: float = 2.0
    take_up_out_m: float = 0.0
    take_up_out_scale_N: float = 2.0
    toe_strain: float = 0.0
    toe_scale_N: float = 2.0
    creep_ratio: float = 0.0
    creep_time_s: float = 20.0
    series_in_m_per_N: float = 0.0
    series_out_m_per_N: float = 0.0
    expansion_per_K: float = 0.0

    # boundary
    backlash_m: float = 0.0

    # sensors
    tension_in_gain: float = 1.0
    tension_out_gain: float = 1.0
    tension_in_offset_N: float = 0.0
    tension_out_offset_N: float = 0.0
    crosstalk: float = 0.0
    lags: tuple[tuple[Channel, float], ...] = ()
    """Channel and time constant [s] of each lag."""
