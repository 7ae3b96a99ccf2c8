"""Search for a free law that a machine lacks, where no part passes or formulae come near it.

Source: docs/model.md (311).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from tssgeom.arrays import Matrix
from tssgeom.identify.law_smoothness import Straight, straight_model
from tssgeom.identify.machine_evidence import FittedModel, delta_bic
from tssgeom.identify.machine_law_bands import by_knots, law_part
from tssgeom.identify.machine_laws import FreeLaw, free_laws
from tssgeom.identify.machine_physics import simulated_runs
from tssgeom.identify.machine_refit import reordered, without_part
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.machine_score import Lines, PartScore, as_noise, straight_lines, with_part
from tssgeom.identify.machine_steps import PartStep, is_far, refits
from tssgeom.statistics import EVIDENCE_SCALE


def laws_of(model: FittedModel) -> tuple[FreeLaw, ...]:
    """Return the laws that the runs of a model may show; none where one finds no equilibrium alone."""
    runs, moved = model.problem.runs, list(simulated_runs(model))
    return free_laws(runs, moved, model.rig) if len(moved) == len(runs) else ()


def law_step(base: FittedModel, model: FittedModel, kept: Sequence[MachineRun]) -> PartStep:
    """Try every free law on top of a model as `part_step` tries parts; docs/model.md (311)."""
    has = {law.name for law in model.problem.laws}
    tests = law_scores(model, [law for law in laws_of(model) if law.name not in has])
    return refits(base, model, tests, kept)


def law_scores(model: FittedModel, laws: Sequence[FreeLaw]) -> list[PartScore]:
    """Return what laws promise on top of a model, of those that promise enough to be fitted."""
    if not laws:
        return []
    lines = straight_lines(as_noise(model) if is_far(model) else model)
    tests = (law_score(law, lines) for law in laws)
    return [one for one in tests if one is not None and one.gain > EVIDENCE_SCALE.very_strong]


def laws_for_formulae(
    base: FittedModel, model: FittedModel, kept: Sequence[MachineRun]
) -> Iterator[PartStep]:
    """Yield steps to a free law instead of all formulae of its mechanism, where it is likelier; (311)."""
    named = {part.mechanism for part in model.parts} - {law.name for law in model.problem.laws}
    for law in [law for law in laws_of(model) if law.name in named] if named else ():
        those = [part.label for part in model.parts if part.mechanism == law.name]
        step = _instead(law, those, base, model, kept, EVIDENCE_SCALE.very_strong)
        if step is not None and step.chosen is not None:
            yield step
            model = step.chosen.model


def _instead(
    law: FreeLaw,
    those: Sequence[str],
    base: FittedModel,
    model: FittedModel,
    kept: Sequence[MachineRun],
    least: float,
) -> PartStep | None:
    """Return the step to a law from a model without some parts; None with a ΔBIC up to `least`."""
    less: FittedModel | None = model
    whole = model
    for label in those:
        if less is None:
            return None
        whole = reordered(whole, _position(label, whole))
        less = without_part(less, _position(label, less), kept)
    if less is None:
        return None
    step = refits(base, less, law_scores(less, [law]), kept)
    gain = -math.inf if step.chosen is None else step.chosen.delta_bic
    return step if gain - delta_bic(less, whole) > least else None


def without_formulae(base: FittedModel, model: FittedModel, kept: Sequence[MachineRun]) -> FittedModel:
    """Return a model whose last part is a law without the formulae of its mechanism, which it can follow.

    The law gets anew the roughness that is likeliest without them.
    """
    law = model.parts[-1]
    those = [part.label for part in model.parts if part.mechanism == law.name]
    if not those:
        return model
    step = _instead(law.laws[0], [*those, law.label], base, model, kept, -EVIDENCE_SCALE.very_strong)
    if step is not None and step.chosen is not None:
        return step.chosen.model
    for label in those:
        model = without_part(model, _position(label, model), kept) or model
    return model


def _position(label: str, model: FittedModel) -> int:
    return [part.label for part in model.parts].index(label)


def law_score(law: FreeLaw, lines: Lines) -> PartScore | None:
    """Return what a model made straight promises of a law, as rough as is likeliest there.

    None where the machine has no equilibrium beside the law, or the law changes nothing.
    """
    model, every = lines.model, law.as_rough()
    of_knots = by_knots(every[-1], model.problem, model.state.u, np.zeros(every[-1].size))
    if of_knots is None:
        return None
    deviation, weight = model.state.u, lines.weight[:, None]

    def straight(columns: Matrix) -> Straight:
        return straight_model(-np.column_stack([lines.slope, columns]), lines.left, deviation)

    base = straight(np.zeros((len(lines.left), 0)))
    without = base.evidence(np.eye(len(deviation)))
    tried = [(one, straight(weight * (of_knots @ one.waves))) for one in every]
    gains = [each.evidence(np.eye(len(each.slope))) - without for _, each in tried]
    best = int(np.argmax(gains))
    one, line = tried[best]
    own = np.linalg.solve(line.information + np.eye(len(line.slope)), line.slope)[len(deviation) :]
    start = np.asarray(np.concatenate([model.state.u, own]), dtype=np.float64)
    part = law_part(one)
    return PartScore(part, with_part(model.problem, part), start, 2.0 * gains[best], model, fitted=True)
