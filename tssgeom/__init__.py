"""Tension and elongation of tendon-sheath transmissions on sensed three-dimensional routes."""

from tssgeom.errors import FitError, SettingsError, ShapeError, SourceError, TssgeomError
from tssgeom.settings import Rig, read_rig
from tssgeom.shape.arcs import Arcs, constant_curvature_pieces
from tssgeom.shape.curvature import CurvatureProfile, curvature_profile
from tssgeom.shape.geometry import Geometry, measure
from tssgeom.shape.points import Shape, clean
from tssgeom.shape.route import Route
from tssgeom.shape.spline import Spline, fit
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
    "Geometry",
    "Route",
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
