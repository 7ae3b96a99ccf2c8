"""Tension and elongation of tendon-sheath transmissions on sensed three-dimensional routes."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tssgeom.field_docs import WithFields

if TYPE_CHECKING:
    from tssgeom.analysis import analyse_same
    from tssgeom.api.calls import analyse, analyse_all, calibrate, discover
    from tssgeom.api.inputs import read
    from tssgeom.api.machine_calls import MachineChannels
    from tssgeom.api.run_calls import compensate, simulate
    from tssgeom.api.runs import Compensation, RecordingResult, Simulation
    from tssgeom.engine import Engine, process
    from tssgeom.errors import FitError, SettingsError, ShapeError, SourceError, TssgeomError
    from tssgeom.identify.calibration import Calibration
    from tssgeom.identify.campaign import Campaign, Run
    from tssgeom.identify.finding import Finding
    from tssgeom.identify.machine_estimates import MachineCalibration
    from tssgeom.io.formats.campaigns import read_campaign
    from tssgeom.io.formats.recording import Recording
    from tssgeom.io.formats.runs import MeasuredRun, read_run
    from tssgeom.rig import Rig, read_rig, read_uncertain_rig
    from tssgeom.route.curvature import CurvatureProfile
    from tssgeom.route.geometry import measure
    from tssgeom.route.observations import Shape, clean
    from tssgeom.route.pieces import Arcs, constant_curvature_pieces, curvature_profile
    from tssgeom.route.repeated import Repeated
    from tssgeom.route.route import Route
    from tssgeom.route.route_fit import RouteFit
    from tssgeom.route.spline.fit import fit
    from tssgeom.route.spline.spline import Spline
    from tssgeom.stream import Frame, FrameResult, Rejected
    from tssgeom.tendon.capstan import Transmission
    from tssgeom.tendon.command import Command
    from tssgeom.tendon.commander import Commander, commander_of
    from tssgeom.tendon.moving import MovingRoute
    from tssgeom.tendon.simulation import Measured, Moment
    from tssgeom.tendon.state import TendonState, pretensioned, step, tension, transmit
    from tssgeom.version import __version__ as __version__

__all__ = [
    # errors
    "FitError",
    "SettingsError",
    "ShapeError",
    "SourceError",
    "TssgeomError",
    # the rig
    "Rig",
    "read_rig",
    "read_uncertain_rig",
    # files
    "MeasuredRun",
    "Recording",
    "read",
    "read_run",
    # sensed points to geometry
    "Arcs",
    "CurvatureProfile",
    "Repeated",
    "Route",
    "RouteFit",
    "Shape",
    "Spline",
    "clean",
    "constant_curvature_pieces",
    "curvature_profile",
    "fit",
    "measure",
    # geometry to tension
    "TendonState",
    "Transmission",
    "pretensioned",
    "step",
    "tension",
    "transmit",
    # the engine: frames in, results out
    "Engine",
    "Frame",
    "FrameResult",
    "Rejected",
    "RecordingResult",
    "analyse",
    "analyse_all",
    "analyse_same",
    "process",
    # runs over time
    "Command",
    "Commander",
    "Compensation",
    "MachineChannels",
    "Moment",
    "MovingRoute",
    "Simulation",
    "commander_of",
    "compensate",
    "simulate",
    # measured against simulated
    "Calibration",
    "Campaign",
    "Finding",
    "MachineCalibration",
    "Measured",
    "Run",
    "calibrate",
    "discover",
    "read_campaign",
]

_MODULES = {
    "analysis": "analyse_same",
    "api.calls": "analyse analyse_all calibrate discover",
    "api.inputs": "read",
    "api.machine_calls": "MachineChannels",
    "api.run_calls": "compensate simulate",
    "api.runs": "Compensation RecordingResult Simulation",
    "engine": "Engine process",
    "errors": "FitError SettingsError ShapeError SourceError TssgeomError",
    "identify.calibration": "Calibration",
    "identify.campaign": "Campaign Run",
    "identify.finding": "Finding",
    "identify.machine_estimates": "MachineCalibration",
    "io.formats.campaigns": "read_campaign",
    "io.formats.recording": "Recording",
    "io.formats.runs": "MeasuredRun read_run",
    "rig": "Rig read_rig read_uncertain_rig",
    "route.curvature": "CurvatureProfile",
    "route.geometry": "measure",
    "route.observations": "Shape clean",
    "route.pieces": "Arcs constant_curvature_pieces curvature_profile",
    "route.repeated": "Repeated",
    "route.route": "Route",
    "route.route_fit": "RouteFit",
    "route.spline.fit": "fit",
    "route.spline.spline": "Spline",
    "stream": "Frame FrameResult Rejected",
    "tendon.capstan": "Transmission",
    "tendon.command": "Command",
    "tendon.commander": "Commander commander_of",
    "tendon.moving": "MovingRoute",
    "tendon.simulation": "Measured Moment",
    "tendon.state": "TendonState pretensioned step tension transmit",
    "version": "__version__",
}
_MODULE_OF = {name: f"tssgeom.{module}" for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that each command loads no more than it needs."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'tssgeom' has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    if isinstance(value, type) and not isinstance(value.__dict__["__doc__"], WithFields):
        value.__doc__ = WithFields(value.__doc__)  # pyright: ignore[reportAttributeAccessIssue]
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
