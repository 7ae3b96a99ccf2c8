"""Tension and elongation of tendon-sheath transmissions on sensed three-dimensional routes."""

from tssgeom.errors import FitError, SettingsError, ShapeError, SourceError, TssgeomError
from tssgeom.rig import Rig, read_rig
from tssgeom.route.curvature import CurvatureProfile, curvature_profile
from tssgeom.route.geometry import measure
from tssgeom.route.observations import Shape, clean
from tssgeom.route.pieces import Arcs, constant_curvature_pieces
from tssgeom.route.route import Route
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.spline.fit import Spline, fit
from tssgeom.stream import Frame, FrameResult, Rejected, process
from tssgeom.tendon.state import TendonState, pretensioned, step, tension, transmit
from tssgeom.tendon.transmission import Transmission

__all__ = [
    # errors
    "FitError",
    "SettingsError",
    "ShapeError",
    "SourceError",
    "TssgeomError",
    # settings
    "Rig",
    "read_rig",
    # sensed points to geometry
    "Arcs",
    "CurvatureProfile",
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
    # the engine
    "Frame",
    "FrameResult",
    "Rejected",
    "process",
]
