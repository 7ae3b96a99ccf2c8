"""What no fit can distinguish: the pair gives the same data, so the tie is reported, and no name."""

import math

import msgspec
import numpy as np
import pytest

from tests.effects.rig import ANGLES, ARCS, FORCE, LENGTHS, POSITION, RIG, RUNS, modelled
from tssgeom.effects import (
    AsymmetricFriction,
    Creep,
    CurvatureDependentFriction,
    EndFittingFrictionDistal,
    EndFittingFrictionProximal,
    FrictionDrift,
    HiddenBend,
    LoadCellCrosstalk,
    LoadDependentFriction,
    LoadFriction,
    PretensionError,
    SeriesComplianceDistal,
    SeriesComplianceProximal,
    SheathClearance,
    SlackTakeUp,
    StraightSectionFriction,
    TensionInGain,
    TensionInOffset,
    TensionOutGain,
    TensionOutOffset,
    ToeRegion,
    VelocityDependentFriction,
    ViscousDrag,
)
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import CHANNELS, begin, carry_on, predict, prepare

ROUNDING = 1e-9  # of the greatest value of a channel, for ties that hold exactly
NEARLY = 1e-3  # of a signature, for ties that hold in the limit
STRAIGHT, HALF = Arcs.exact(np.array([0.5]), np.zeros(1)), Arcs.exact(np.array([0.5]), np.array([math.pi]))
SMOOTH = msgspec.structs.replace(RIG, friction=msgspec.structs.replace(RIG.friction, coefficient=0.0))


def scaled(part, key, factor, rig=RIG):
    struct = getattr(rig, part)
    changed = msgspec.structs.replace(struct, **{key: getattr(struct, key) * factor})
    return msgspec.structs.replace(rig, **{part: changed})


def rubbing(factor, rig=RIG):
    return scaled("friction", "coefficient", factor, rig)


def same(one, other, channels=CHANNELS, share=ROUNDING):
    for channel in channels:
        size = np.abs(one[channel]).max()
        assert np.abs(one[channel] - other[channel]).max() <= share * size, channel


def alike(one, other, base, channels=CHANNELS, share=NEARLY):
    """Signatures agree where they are: `share` of the greatest."""
    for channel in channels:
        size = np.abs(one[channel] - base[channel]).max()
        assert np.abs(one[channel] - other[channel]).max() <= share * size, channel


def test_g1_both_load_cells_reading_high_is_a_softer_tendon():
    a = 1.03
    rig = scaled("tendon", "compliance_per_N", 1 / a)
    rig = scaled("tendon", "pretension_N", a, scaled("load", "stiffness_N_per_m", a, rig))
    same(
        modelled(FORCE, TensionInGain(gain_error=a - 1), TensionOutGain(gain_error=a - 1)),
        modelled(FORCE, rig=rig),
    )


def test_g1_one_cell_reading_high_is_the_other_reading_low_and_another_compliance():
    a = 1.03
    rig = scaled("tendon", "compliance_per_N", 1 / a)
    rig = scaled("tendon", "pretension_N", a, scaled("load", "stiffness_N_per_m", a, rig))
    other = modelled(FORCE, TensionOutGain(gain_error=1 / a - 1), rig=rig)
    same(modelled(FORCE, TensionInGain(gain_error=a - 1)), other)


def test_g1_offsets_are_one_without_friction_but_for_the_zero_of_displacement():
    one = modelled(FORCE, TensionInOffset(offset_N=0.25), rig=SMOOTH)
    other = modelled(FORCE, TensionOutOffset(offset_N=-0.25), rig=SMOOTH)
    same(one, other, ("tension_out_N",))
    for channel in ("elongation_m", "displacement_in_m", "displacement_out_m"):
        assert np.ptp(one[channel] - other[channel]) < 1e-12


def test_g1_crosstalk_is_a_gain_without_friction():
    same(
        modelled(FORCE, LoadCellCrosstalk(share=0.02), rig=SMOOTH),
        modelled(FORCE, TensionOutGain(gain_error=0.02), rig=SMOOTH),
    )


def test_g1_pretension_is_a_zero_of_displacement_once_everything_has_slid():
    one, other = modelled(FORCE, PretensionError(error_N=0.6)), modelled(FORCE)
    later = slice(15, None)
    assert np.abs(one["tension_out_N"] - other["tension_out_N"])[later].max() < 1e-9
    assert np.ptp((one["elongation_m"] - other["elongation_m"])[later]) < 1e-12


def test_g2_compliance_is_the_length_of_the_route():
    longer = Arcs.exact(1.1 * np.array(LENGTHS), np.array(ANGLES))
    same(modelled(FORCE, rig=scaled("tendon", "compliance_per_N", 1.1)), modelled(FORCE, arcs=longer))


def test_g2_compliance_is_the_scale_of_the_encoder():
    stiff, soft = modelled(FORCE), modelled(FORCE, rig=scaled("tendon", "compliance_per_N", 1.1))
    assert soft["elongation_m"] == pytest.approx(1.1 * stiff["elongation_m"], abs=1e-12)


def test_g2_compliances_are_one_on_a_straight_sheath():
    near = modelled(FORCE, SeriesComplianceProximal(compliance_m_per_N=2e-5), arcs=STRAIGHT)
    far = modelled(FORCE, SeriesComplianceDistal(compliance_m_per_N=2e-5), arcs=STRAIGHT)
    rho = RIG.tendon.compliance_per_N
    inside = modelled(FORCE, rig=scaled("tendon", "compliance_per_N", 1 + 2e-5 / (0.5 * rho)), arcs=STRAIGHT)
    same(near, far)
    same(near, inside)


@pytest.mark.parametrize("drive", [FORCE, POSITION])
def test_g2_distal_compliance_is_the_load_unless_the_distal_displacement_is_measured(drive):
    one = modelled(drive, SeriesComplianceDistal(compliance_m_per_N=2e-5))
    other = modelled(drive, rig=scaled("load", "stiffness_N_per_m", 1 / (1 + 2e-5 * 3000.0)))
    same(one, other, ("tension_in_N", "tension_out_N", "displacement_in_m"))
    assert np.abs(one["displacement_out_m"] - other["displacement_out_m"]).max() > 1e-5


def test_g2_creep_that_is_over_within_a_sample_is_compliance():
    fast = modelled(FORCE, Creep(ratio=0.06, time_s=1e-3))
    alike(
        fast,
        modelled(FORCE, rig=scaled("tendon", "compliance_per_N", 1.06)),
        modelled(FORCE),
        ("elongation_m",),
        0.01,
    )


@pytest.mark.parametrize("drive", [FORCE, POSITION])
def test_g3_friction_is_the_angle_gain_of_the_shape_sensor(drive):
    more = Arcs.exact(np.array(LENGTHS), 1.1 * np.array(ANGLES))
    # bars are cut by length and angle, so that they differ by rounding only
    same(modelled(drive, rig=rubbing(1.1)), modelled(drive, arcs=more))


@pytest.mark.parametrize(
    ("fitting", "at"), [(EndFittingFrictionProximal, 0.0), (EndFittingFrictionDistal, 0.5)]
)
def test_g4_an_end_fitting_is_a_bend_at_that_end(fitting, at):
    angle = 2.0 * math.atanh(0.025) / RIG.friction.coefficient
    bend = HiddenBend(at_m=at, angle_rad=angle, width_m=2e-6)
    alike(
        modelled(FORCE, fitting(ratio=0.05)),
        modelled(FORCE, bend),
        modelled(FORCE),
        ("tension_out_N", "displacement_out_m"),
    )


def dragged(speed, *effects, rig=None, arcs=ARCS):
    """Drag a dead weight of 5 N along, all of it at one speed; return T_in, the start left out."""
    base = msgspec.structs.replace(
        rig or RIG,
        tendon=msgspec.structs.replace(RIG.tendon, pretension_N=5.0),
        load=msgspec.structs.replace(RIG.load, stiffness_N_per_m=0.0),
    )
    time = np.linspace(0.0, 0.02 / speed, 41)
    return predict({"time_s": time, POSITION: speed * time}, arcs, base, effects)["tension_in_N"][20:]


def test_g5_drag_is_straight_friction_at_one_speed_and_not_at_another():
    drag, dry = ViscousDrag(coefficient_Ns_per_m2=300.0), StraightSectionFriction(force_N_per_m=0.6)
    size = dragged(2e-3, drag) - dragged(2e-3)
    assert size.min() > 0.3
    assert np.abs(dragged(2e-3, drag) - dragged(2e-3, dry)).max() < NEARLY * size.max()
    assert (dragged(2e-2, drag) - dragged(2e-2, dry)).min() > 3.0


def test_g4_friction_of_the_load_is_a_fitting_to_all_but_a_cell_before_it():
    for drive in (FORCE, POSITION):
        load, fitting = (
            modelled(drive, kind(force_N=0.3)) for kind in (LoadFriction, EndFittingFrictionDistal)
        )
        others = [channel for channel in CHANNELS if channel != "tension_out_N"]
        same(load, fitting, others)
        apart = load["tension_out_N"] - fitting["tension_out_N"]
        assert np.abs(apart).max() == pytest.approx(0.3, rel=ROUNDING)


def test_g5_friction_by_speed_is_friction_at_one_speed_and_not_at_another():
    by_speed, more = VelocityDependentFriction(gain=0.08), rubbing(1.0 + 0.08 * math.log1p(2.0))
    size = dragged(2e-3, by_speed) - dragged(2e-3)
    assert np.abs(dragged(2e-3, by_speed) - dragged(2e-3, rig=more)).max() < NEARLY * size.max()
    assert (dragged(2e-2, by_speed) - dragged(2e-2, rig=more)).min() > 0.3


def test_g6_friction_by_curvature_is_friction_on_a_route_of_one_curvature():
    by_bend, more = CurvatureDependentFriction(gain_m=0.012), rubbing(1.0 + 0.012 * math.pi / 0.5)
    same(modelled(FORCE, by_bend, arcs=HALF), modelled(FORCE, rig=more, arcs=HALF))
    wider = Arcs.exact(np.array([1.0]), np.array([math.pi]))
    apart = (
        modelled(FORCE, by_bend, arcs=wider)["tension_out_N"]
        - modelled(FORCE, rig=more, arcs=wider)["tension_out_N"]
    )
    assert np.abs(apart).max() > 0.1


def test_g7_friction_by_load_is_friction_where_the_tension_is_one():
    bend = Arcs.exact(np.array([0.5]), np.array([0.02]))  # the tension rises by 0.3 %
    observed = dragged(1e-3, LoadDependentFriction(exponent=-0.2), arcs=bend) - 5.0
    assert observed == pytest.approx(dragged(1e-3, rig=rubbing(0.5**-0.2), arcs=bend) - 5.0, rel=NEARLY)


def test_g8_asymmetry_is_friction_as_long_as_all_is_pulled():
    one, other = modelled(FORCE, AsymmetricFriction(asymmetry=0.08)), modelled(FORCE, rig=rubbing(1.08))
    pulled = slice(0, 31)
    for channel in CHANNELS:
        assert np.abs(one[channel] - other[channel])[pulled].max() < 1e-12
    assert np.abs(one["tension_out_N"] - other["tension_out_N"])[31:].max() > 0.3


def test_g8_a_gain_is_friction_for_tensions_in_full_pull():
    more = rubbing(1.0 - math.log(1.03) / (RIG.friction.coefficient * ARCS.total_angle))
    one, other = modelled(FORCE, TensionOutGain(gain_error=0.03)), modelled(FORCE, rig=more)
    pulled = slice(15, 31)
    assert np.abs(one["tension_out_N"] - other["tension_out_N"])[pulled].max() < 1e-9
    assert np.abs(one["elongation_m"] - other["elongation_m"])[pulled].max() > 1e-5


def test_g9_wear_that_is_over_is_friction():
    model = prepare(RUNS[FORCE], ARCS, RIG, [FrictionDrift(gain=0.15)])
    state = begin(model)
    state.memory.travel[:] = 100.0
    same(carry_on(model, state, RUNS[FORCE])[0].channels, modelled(FORCE, rig=rubbing(1.15)))


def test_g10_slack_outside_is_a_toe_on_a_straight_sheath():
    # slack outside keeps a compliance of 1e-9 m/N, some 1e-5 of the elongation
    toe = ToeRegion(strain=1e-3)
    same(
        modelled(FORCE, SlackTakeUp(slack_m=5e-4), arcs=STRAIGHT),
        modelled(FORCE, toe, arcs=STRAIGHT),
        share=1e-5,
    )
    same(
        modelled(FORCE, SlackTakeUp(slack_m=5e-4, end="distal"), arcs=STRAIGHT),
        modelled(FORCE, toe, arcs=STRAIGHT),
    )


@pytest.mark.parametrize("drive", [FORCE, POSITION])
def test_g10_clearance_is_a_toe_on_a_route_of_one_curvature(drive):
    clearance = SheathClearance(clearance_m_per_rad=1e-4)
    same(
        modelled(drive, clearance, arcs=HALF),
        modelled(drive, ToeRegion(strain=1e-4 * math.pi / 0.5), arcs=HALF),
        share=1e-8,
    )
