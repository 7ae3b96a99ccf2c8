"""The route as it is beside the one with an added curve, at the same T_in and at the same T_out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.design import (
    Curve,
    Cycle,
    Disturbed,
    Price,
    disturbed,
    fully_releasing,
    price,
    same_output,
)


class CaseNumbers(TypedDict):
    """A pull and release on the route, with or without the curve."""

    scaling_factor: float
    """Factor S of what perturbations change on pulling [1]."""
    release_amplification: float
    """Factor 1/S when all of the tendon releases [1]."""
    tension_in_N: float
    """Proximal tension at the end of the pull [N]."""
    release_to_N: float
    """Proximal tension at the end of the release [N]."""
    full_release_at_N: float
    """Proximal tension below which all of the tendon releases [N]."""
    tension_out_N: float
    """Distal tension at the end of the pull [N]."""
    elongation_m: float
    """Elongation at the end of the pull [m]."""
    own_elongation_m: float
    """Elongation of the added curve itself [m]."""
    pull_reaches_from_N: float
    """Proximal tension from which a pull reaches the distal end [N]."""
    release_reaches_below_N: float
    """Proximal tension below which a release reaches the distal end [N]."""
    pull_tension_out_change_N: float
    """Change of the distal tension by the bends, end of the pull [N]."""
    pull_elongation_change_m: float
    """Change of the elongation by the bends, end of the pull [m]."""
    release_tension_out_change_N: float
    """Change of the distal tension, end of the release [N]."""
    release_elongation_change_m: float
    """Change of the elongation, end of the release [m]."""
    full_release_tension_out_change_N: float
    """Change of the distal tension when all releases [N]."""
    full_release_elongation_change_m: float
    """Change of the elongation when all releases [m]."""


@dataclass(frozen=True, slots=True)
class Case:
    """One column of the table."""

    name: str
    scaling: float
    """S on pulling [1]."""
    cycle: Cycle
    price: Price
    disturbed: Disturbed
    """At the end of the pull, then at the end of the release, then where all of the tendon releases."""
    full_release_at: float
    """Proximal tension at which all of the tendon releases [N]."""

    @property
    def pull(self) -> float:
        """|Δδ| at the end of the pull [m]."""
        return float(self.disturbed.elongation[0])

    @property
    def released(self) -> float:
        """|Δδ| at the end of the release [m]."""
        return float(self.disturbed.elongation[1])

    def numbers(self) -> CaseNumbers:
        """Return all numbers, in SI."""
        elongation: list[float] = self.disturbed.elongation.tolist()
        tension: list[float] = self.disturbed.tension.tolist()
        return {
            "scaling_factor": self.scaling,
            "release_amplification": 1.0 / self.scaling,
            "tension_in_N": self.cycle.tension_in,
            "release_to_N": self.cycle.release_to,
            "full_release_at_N": self.full_release_at,
            "tension_out_N": self.price.tension_out,
            "elongation_m": self.price.elongation,
            "own_elongation_m": self.price.own_elongation,
            "pull_reaches_from_N": self.price.pull_reaches_from,
            "release_reaches_below_N": self.price.release_reaches_below,
            "pull_tension_out_change_N": tension[0],
            "pull_elongation_change_m": elongation[0],
            "release_tension_out_change_N": tension[1],
            "release_elongation_change_m": elongation[1],
            "full_release_tension_out_change_N": tension[2],
            "full_release_elongation_change_m": elongation[2],
        }

    def cells(self) -> dict[str, str]:
        """Return the same as people read it."""
        n = self.numbers()
        return {
            "S on pulling [1]": f"{n['scaling_factor']:.3f}",
            "1/S when all releases [1]": f"{n['release_amplification']:.3f}",
            "T_in at the end of the pull [N]": f"{n['tension_in_N']:.2f}",
            "T_out there [N]": f"{n['tension_out_N']:.3f}",
            "δ there [mm]": f"{1e3 * n['elongation_m']:.3f}",
            "of this the curve's own [mm]": f"{1e3 * n['own_elongation_m']:.3f}",
            "first pull reaches the end from T_in [N]": f"{n['pull_reaches_from_N']:.2f}",
            "release reaches the end below T_in [N]": f"{n['release_reaches_below_N']:.2f}",
            "|ΔT_out| at the end of the pull [N]": f"{n['pull_tension_out_change_N']:.3f}",
            "|Δδ| at the end of the pull [mm]": f"{1e3 * n['pull_elongation_change_m']:.4f}",
            f"|ΔT_out| released to {n['release_to_N']:g} N [N]": f"{n['release_tension_out_change_N']:.3f}",
            f"|Δδ| released to {n['release_to_N']:g} N [mm]": f"{1e3 * n['release_elongation_change_m']:.4f}",
            f"|ΔT_out|, all releasing, {n['full_release_at_N']:.3f} N [N]": (
                f"{n['full_release_tension_out_change_N']:.4f}"
            ),
            f"|Δδ|, all releasing, {n['full_release_at_N']:.3f} N [mm]": (
                f"{1e3 * n['full_release_elongation_change_m']:.5f}"
            ),
        }


def cases(
    arcs: Arcs, routes: Sequence[Arcs], rig: Rig, curve: Curve, cycle: Cycle, percentile: float
) -> list[Case]:
    """Return the route without the curve, with it at the same T_in, and with it at the same T_out."""
    none, harder = Curve(0.0, curve.kappa), same_output(cycle, rig, curve)
    low = fully_releasing(routes, rig, curve, cycle)
    s = math.exp(-rig.friction.coefficient * curve.angle)  # docs/model.md (15)
    chosen = (
        ("without", 1.0, none, cycle),
        ("same_tension_in", s, curve, cycle),
        ("same_tension_out", s, curve, harder),
    )
    return [
        Case(
            name,
            scaling,
            load,
            price(arcs, rig, added, load),
            _observed(arcs, routes, rig, added, load, low, percentile),
            low,
        )
        for name, scaling, added, load in chosen
    ]


def _observed(
    arcs: Arcs, routes: Sequence[Arcs], rig: Rig, added: Curve, load: Cycle, low: float, percentile: float
) -> Disturbed:
    tensions = np.array([load.tension_in, load.release_to, low])
    return disturbed(arcs, routes, rig, added, tensions, percentile)
