"""A route, two runs and the physics of every effect as the lumped simulator knows it."""

import numpy as np

from tests import lumped
from tssgeom.rig import Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import predict

LENGTHS, ANGLES = [0.1, 0.1, 0.2, 0.1], [0.5, 1.5, 1.6, 0.0]
ARCS = Arcs.exact(np.array(LENGTHS), np.array(ANGLES))
RIG = Rig(tendon=Tendon(pretension_N=2.0), load=Load(stiffness_N_per_m=3000.0))
FORCE, POSITION = "tension_in_N", "displacement_in_m"
STEP = 0.1  # s

_KNOTS = [0, 4, 6, 9, 12, 15, 18, 20, 22, 24]
TIME = np.linspace(0.0, 24.0, 121)
TEMPERATURE = 20.0 + 5.0 * np.sin(TIME / 5.0)
PULLS = np.interp(TIME, _KNOTS, [2, 14, 14, 3, 9, 6, 15, 15, 4, 8])
STROKES = np.interp(TIME, _KNOTS, np.array([0, 6, 6, 1.5, 4, 2, 6.5, 6.5, 1.5, 3]) * 1e-3)
RUNS = {
    FORCE: {"time_s": TIME, FORCE: PULLS, "temperature_C": TEMPERATURE},
    POSITION: {"time_s": TIME, POSITION: STROKES, "temperature_C": TEMPERATURE},
}
"""Pulls, holds, releases and a loop inside of a loop, by tension and by position."""

PHYSICS = {
    "load_dependent_friction": {"load_exponent": -0.2},
    "velocity_dependent_friction": {"speed_gain": 0.08},
    "viscous_drag": {"viscous_drag_Ns_per_m2": 300.0},
    "straight_section_friction": {"straight_friction_N_per_m": 0.6},
    "curvature_dependent_friction": {"curvature_gain_m": 0.012},
    "asymmetric_friction": {"asymmetry": 0.08},
    "friction_drift": {"wear_gain": 0.15, "wear_travel_m": 0.05},
    "end_fitting_friction_proximal": {"fitting_in_N": 0.3, "fitting_in_ratio": 0.05},
    "end_fitting_friction_distal": {"fitting_out_N": 0.3, "fitting_out_ratio": 0.05},
    "hidden_bend": {"bend_at_m": 0.25, "bend_angle_rad": 0.6},
    "sheath_clearance": {"clearance_m": 1e-4},
    "slack_take_up": {"take_up_in_m": 5e-4},
    "toe_region": {"toe_strain": 8e-4},
    "creep": {"creep_ratios": (0.06,), "creep_times_s": (20.0,)},
    "series_compliance_proximal": {"series_in_m_per_N": 2e-5},
    "series_compliance_distal": {"series_out_m_per_N": 2e-5},
    "thermal_drift": {"expansion_per_K": 1.5e-5},
    "pretension_error": {"pretension_N": 2.6},
    "backlash": {"backlash_m": 2e-4},
    "load_friction": {"load_friction_N": 0.3},
}
"""The typical size of each effect, in the words of the lumped simulator."""


def modelled(drive, *effects, rig=RIG, arcs=ARCS, **options):
    return predict(RUNS[drive], arcs, rig, effects, **options)


def refereed(drive, step=STEP, cells=80, **physics):
    """Return the channels of the lumped simulator on the same run."""
    kind, values = ("force", PULLS) if drive == FORCE else ("displacement", STROKES)
    run = lumped.simulate(
        lumped.from_pieces(LENGTHS, ANGLES, cells),
        lumped.Physics(**({"pretension_N": 2.0} | physics)),
        lumped.Drive(kind, TIME, values, TEMPERATURE),
        lumped.Distal("spring", 3000.0),
        TIME,
        step,
    )
    return lumped.true_channels(run)
