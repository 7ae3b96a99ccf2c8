"""Effects of friction: each changes the cone that bounds the tension from contact to contact."""

import math
from dataclasses import replace
from typing import ClassVar, Literal

from tssgeom.effects.kinds import Effect, Hook, Parameter, Setup, Tie

_ONE_RATE = Tie(
    "G5",
    ("straight_section_friction", "velocity_dependent_friction", "rig.friction.coefficient"),
    "all runs slide at one speed",
    "repeat a run ten times faster",
)


class LoadDependentFriction(Effect, frozen=True):
    """Friction that is not proportional to load: μ(T) = μ (T/T_ref)^exponent; docs/model.md (52).

    −1/3 is a Hertzian contact. Source: H. G. Howell, The general case of friction of a string round a
    cylinder, J. Textile Inst. 44 (1953).
    """

    exponent: float
    """Exponent of the tension [1]."""
    reference_N: float = 10.0
    """Tension at which the coefficient is the rig's [N]."""

    hook: ClassVar[Hook] = "friction cone"
    sets: ClassVar[dict[str, str]] = {"load_exponent": "exponent", "load_reference_N": "reference_N"}
    parameters: ClassVar[dict[str, Parameter]] = {
        "exponent": Parameter("1", -0.9, 0.9, -0.2, 0.3),
        "reference_N": Parameter("N", 0.1, 1000.0, 10.0, 10.0, centre=10.0, switch=False, fitted=False),
    }
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G7",
            ("rig.friction.coefficient",),
            "the tension is the same all along and in all runs",
            "a run at three times the tension",
        ),
    )


class VelocityDependentFriction(Effect, frozen=True):
    """Friction that changes with the logarithm of sliding speed: μ(v) = μ (1 + gain ln(1 + v/v_ref)).

    Equation: docs/model.md (52).

    v is the speed of each contact in the sheath. Source: J. H. Dieterich, Modeling of rock friction, J.
    Geophys. Res. 84 (1979); B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994).
    """

    gain: float
    """Relative change of μ for each e-fold of speed beyond the reference [1]."""
    reference_m_per_s: float = 1e-3
    """Speed below which the change levels off [m/s]."""

    hook: ClassVar[Hook] = "friction cone"
    sets: ClassVar[dict[str, str]] = {"speed_gain": "gain", "speed_reference_m_per_s": "reference_m_per_s"}
    parameters: ClassVar[dict[str, Parameter]] = {
        "gain": Parameter("1", -0.2, 1.0, 0.08, 0.15),
        "reference_m_per_s": Parameter("m/s", 1e-6, 1.0, 1e-3, 1e-3, centre=1e-3, switch=False, fitted=False),
    }
    ties: ClassVar[tuple[Tie, ...]] = (
        replace(
            _ONE_RATE, partners=("viscous_drag", "straight_section_friction", "rig.friction.coefficient")
        ),
    )


class ViscousDrag(Effect, frozen=True):
    """A lubricant film drags with the local sliding speed: dT/ds = −c v; docs/model.md (55).

    Zero where the tendon sticks. Source: Newton's law of viscosity for the film between tendon and sheath.
    """

    coefficient_Ns_per_m2: float
    """Force per length and speed [N·s/m²]."""

    hook: ClassVar[Hook] = "friction cone"
    adds: ClassVar[dict[str, str]] = {"drag_Ns_per_m2": "coefficient_Ns_per_m2"}
    parameters: ClassVar[dict[str, Parameter]] = {
        "coefficient_Ns_per_m2": Parameter("N·s/m²", 0.0, 1e6, 300.0, 600.0)
    }
    ties: ClassVar[tuple[Tie, ...]] = (_ONE_RATE,)


class StraightSectionFriction(Effect, frozen=True):
    """Friction per length of sheath, curved or not: dT/ds = ∓f_0; docs/model.md (54).

    Coulomb friction under a normal force that the curve does not make: weight, a tight liner, a stiff tendon.
    Source: C. A. Coulomb's law with a given normal force per length.
    """

    force_N_per_m: float
    """Friction force per length f_0 [N/m]."""

    hook: ClassVar[Hook] = "friction cone"
    adds: ClassVar[dict[str, str]] = {"straight_friction_N_per_m": "force_N_per_m"}
    parameters: ClassVar[dict[str, Parameter]] = {"force_N_per_m": Parameter("N/m", 0.0, 50.0, 0.6, 1.0)}
    ties: ClassVar[tuple[Tie, ...]] = (replace(_ONE_RATE, partners=("viscous_drag",)),)


class CurvatureDependentFriction(Effect, frozen=True):
    """Sharper bends rub more for each radian: μ(κ) = μ (1 + gain κ); docs/model.md (53).

    Source: J. H. Jung, N. Pan, T. J. Kang, Capstan equation including bending rigidity and non-linear
    frictional behavior, Mech. Mach. Theory 43 (2008), to first order in κ.
    """

    gain_m: float
    """Relative change of μ for each 1/m of curvature [m]."""

    hook: ClassVar[Hook] = "friction cone"
    sets: ClassVar[dict[str, str]] = {"curvature_gain_m": "gain_m"}
    parameters: ClassVar[dict[str, Parameter]] = {"gain_m": Parameter("m", -0.02, 0.5, 0.012, 0.02)}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G6",
            ("rig.friction.coefficient",),
            "one route of one curvature; nearly so for any one route",
            "a second route of the same angle and other radii",
        ),
    )


class AsymmetricFriction(Effect, frozen=True):
    """More friction pulling than releasing: μ (1 + a) and μ (1 − a); docs/model.md (52).

    Braid, coil and wear have a grain. Source: T. N. Do et al., Hysteresis modeling and position control of
    tendon-sheath mechanism in flexible endoscopic systems, Mechatronics 24 (2014).
    """

    asymmetry: float
    """Relative difference a from the mean coefficient [1]."""

    hook: ClassVar[Hook] = "friction cone"
    sets: ClassVar[dict[str, str]] = {"asymmetry": "asymmetry"}
    parameters: ClassVar[dict[str, Parameter]] = {"asymmetry": Parameter("1", -0.9, 0.9, 0.08, 0.15)}
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G8",
            ("rig.friction.coefficient",),
            "the tendon slides in one direction only",
            "release far enough that the distal end follows",
        ),
    )


class FrictionDrift(Effect, frozen=True):
    """Wear, or run-in where the gain is negative: μ (1 + gain (1 − e^(−travel/travel_m))).

    Equation: docs/model.md (52).

    The travel is the path that each contact has slid, either way, since the run began. Source: J. F. Archard,
    Contact and rubbing of flat surfaces, J. Appl. Phys. 24 (1953): wear in proportion to the path.
    """

    gain: float
    """Relative change of μ after much travel [1]."""
    travel_m: float = 0.05
    """Travel over which the change comes [m]."""

    hook: ClassVar[Hook] = "friction cone"
    sets: ClassVar[dict[str, str]] = {"wear_gain": "gain", "wear_travel_m": "travel_m"}
    parameters: ClassVar[dict[str, Parameter]] = {
        "gain": Parameter("1", -0.8, 2.0, 0.15, 0.25),
        "travel_m": Parameter("m", 1e-4, 100.0, 0.05, 0.05, centre=0.05, switch=False),
    }
    ties: ClassVar[tuple[Tie, ...]] = (
        Tie(
            "G9",
            ("rig.friction.coefficient",),
            "the travel before the run is much longer than travel_m",
            "twenty equal cycles in one run, on a fresh tendon",
        ),
    )


_FITTING = {
    "force_N": Parameter("N", 0.0, 20.0, 0.3, 0.5),
    "ratio": Parameter("1", 0.0, 1.0, 0.05, 0.1),
}


def _tie_of_fitting(end: str) -> tuple[Tie, ...]:
    where = f"force_N is 0 and the bend is at the {end} end"
    return (Tie("G4", ("hidden_bend",), where, "take the fitting off, or unbend that end"),)


class Presliding(Effect, frozen=True):
    """Contacts give way like springs before they slide; docs/model.md (279).

    Asperities and liners shear before they let go: a tendon that turns back moves at once, and its friction
    follows over a fraction of a millimetre. By Prandtl's law all contacts slide after the same movement; by
    Dahl's one after the other, so that friction follows as 1 − exp(−x/distance).

    Source: L. Prandtl, Ein Gedankenmodell zur kinetischen Theorie der festen Körper, Z. Angew. Math. Mech. 8
    (1928); P. R. Dahl, Solid friction damping of mechanical vibrations, AIAA J. 14 (1976).
    """

    distance_m: float
    """Movement from no friction to sliding, at the reference tension; by Dahl's law to 63 % of it [m]."""
    reference_N: float = 10.0
    """That tension; at others the movement is proportional to it [N]."""
    law: Literal["prandtl", "dahl"] = "prandtl"
    """How friction builds up: in a straight line, or by 1 − exp(−x)."""

    hook: ClassVar[Hook] = "friction cone"
    sets: ClassVar[dict[str, str]] = {
        "presliding_m": "distance_m",
        "presliding_reference_N": "reference_N",
        "presliding_law": "law",
    }
    parameters: ClassVar[dict[str, Parameter]] = {
        "distance_m": Parameter("m", 0.0, 5e-3, 5e-5, 1e-4),
        "reference_N": Parameter("N", 0.1, 1000.0, 10.0, 10.0, centre=10.0, switch=False, fitted=False),
    }


class EndFittingFrictionProximal(Effect, frozen=True):
    """A guide at the proximal end holds the tendon: a play of ±(force + ratio · mean tension).

    Equation: docs/model.md (52), (54).

    Source: Coulomb friction at one position; a sign switch is wrong wherever the tendon sticks.
    """

    force_N: float = 0.0
    """Friction force whatever the tension [N]."""
    ratio: float = 0.0
    """Friction force over the mean tension of both sides [1]."""

    hook: ClassVar[Hook] = "friction cone"
    parameters: ClassVar[dict[str, Parameter]] = _FITTING
    ties: ClassVar[tuple[Tie, ...]] = _tie_of_fitting("proximal")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(setup, fitting_in_N=self.force_N, fitting_in_exponent=2.0 * math.atanh(self.ratio / 2))


class EndFittingFrictionDistal(Effect, frozen=True):
    """A guide at the distal end holds the tendon: a play of ±(force + ratio · mean tension).

    Equation: docs/model.md (52), (54).

    Source: as for the proximal end.
    """

    force_N: float = 0.0
    """Friction force whatever the tension [N]."""
    ratio: float = 0.0
    """Friction force over the mean tension of both sides [1]."""

    hook: ClassVar[Hook] = "friction cone"
    parameters: ClassVar[dict[str, Parameter]] = _FITTING
    ties: ClassVar[tuple[Tie, ...]] = _tie_of_fitting("distal")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        return replace(
            setup, fitting_out_N=self.force_N, fitting_out_exponent=2.0 * math.atanh(self.ratio / 2)
        )
