"""Objects of designs and of the numbers of the paper."""

from __future__ import annotations

from typing import NotRequired, TypedDict

from tssgeom.tendon.design_table import CaseNumbers


class RandomBends(TypedDict):
    """Bends at random."""

    bends: int
    """Bends of a draw [1]."""
    bend_sd_rad: float
    """Standard deviation of their angle [rad]."""
    bend_width_m: float
    """Their length along the route [m]."""
    trials: int
    """Draws [1]."""
    seed: int
    """Seed of the random numbers [1]."""
    percentile: float
    """Percentile of the changes that is reported [1]."""


class TriedCurve(TypedDict):
    """A curve that is tried."""

    beta_rad: float
    """Angle of the curve [rad]."""
    curvature_per_m: float
    """Curvature of it [1/m]."""
    tension_out_N: float
    """Distal tension at the end of the pull [N]."""
    own_elongation_m: float
    """Elongation of the curve itself [m]."""
    pull_elongation_change_m: float
    """Change of the elongation by the bends, end of the pull [m]."""
    worst_elongation_change_m: float
    """The largest of pull and release [m]."""
    pull_tension_out_change_N: float
    """Change of the distal tension by the bends, end of the pull [N]."""


class Recommended(TypedDict):
    """The curve that is recommended; without numbers where there is none."""

    verdict: str
    """`none needed`, `curve`, `pull only` or `out of reach`."""
    beta_rad: NotRequired[float]
    """As in `sweep`, and so are the others [rad]."""
    curvature_per_m: NotRequired[float]
    """Curvature of it [1/m]."""
    tension_out_N: NotRequired[float]
    """Distal tension at the end of the pull [N]."""
    own_elongation_m: NotRequired[float]
    """Elongation of the curve itself [m]."""
    pull_elongation_change_m: NotRequired[float]
    """Change of the elongation by the bends, end of the pull [m]."""
    worst_elongation_change_m: NotRequired[float]
    """The largest of pull and release [m]."""
    pull_tension_out_change_N: NotRequired[float]
    """Change of the distal tension by the bends, end of the pull [N]."""


class Remedied(TypedDict):
    """An added curve."""

    shape: str
    """File of the shape."""
    beta_rad: float
    """Angle of the curve [rad]."""
    curvature_per_m: float
    """Its curvature [1/m]."""
    perturbation: RandomBends
    """Unknown bends, at random."""
    cases: dict[str, CaseNumbers]
    """`without`, `same_tension_in` and `same_tension_out`."""
    sweep: list[TriedCurve]
    """Curves of rising angle."""
    tolerance_m: float | None
    """Tolerance of the elongation; null without one [m]."""
    recommendation: Recommended | None
    """Curve for the tolerance; null without one."""
    words: list[str]
    """The result in sentences."""


class PaperNumber(TypedDict):
    """A number of the paper."""

    figure: str
    """Where it stands in the paper."""
    quantity: str
    """Quantity."""
    unit: str
    """Its unit."""
    paper: float
    """Number of the paper, in `unit`."""
    printed_in_paper: bool
    """True where it is printed, false where it is read from a figure."""
    ours: float
    """Number of this model, in `unit`."""
    difference: float
    """`ours` less `paper`, in `unit`."""
    why: str
    """Why they differ."""


class PaperObject(TypedDict):
    """The numbers of the paper."""

    numbers: list[PaperNumber]
    """Each beside that of this model."""
    files: list[str]
    """Files that are written."""
