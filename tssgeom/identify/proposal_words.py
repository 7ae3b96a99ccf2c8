"""What proposed runs are for and what is expected of them, in words.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from tssgeom.arrays import Vector
from tssgeom.identify.candidate_models import AnyCompared
from tssgeom.identify.expected_evidence import Information
from tssgeom.identify.experiment_search import Goal
from tssgeom.identify.outcomes import Contrast, outcome, words_of
from tssgeom.identify.proposal import ExpectedEvidence, NarrowedInterval, ProposedRun
from tssgeom.identify.waveform import Course
from tssgeom.route.pieces import Arcs

_LARGE = 1000.0
"""ΔBIC beyond which a larger one adds no evidence [1]; chosen."""


def run_proposed(
    name: str,
    on: tuple[str, str, Arcs | None],
    drives: tuple[str, ...],
    course: Course,
    goal: Goal[AnyCompared],
    total: Information,
    narrowed: NarrowedInterval | None,
    pairs: Sequence[Contrast],
    channels: Sequence[Mapping[str, Vector]],
    sigma: Mapping[str, Vector],
) -> ProposedRun:
    """Return a run as it is reported.

    Parameters
    ----------
    name
        Of the run.
    on
        Its route in words, a run on the same route, and the route itself where it is new.
    drives, course
        Channels that drive, and what they do.
    goal, total, narrowed
        What is to be separated, what the runs up to this one add, and the interval where nothing is left.
    pairs
        The first model beside each other one.
    channels, sigma
        What each model predicts by channel, and the error of its readings [N, m, rad].
    """
    models = goal.models
    outcomes = [
        outcome(pair, (models[pair.true].name, models[pair.other].name), sigma, course, drives)
        for pair in pairs
    ]
    return ProposedRun(
        name=name,
        route=on[0],
        like=on[1],
        new_route=on[2],
        drives=drives,
        time=course.time,
        values=course.drive,
        corner_time=course.corner_time,
        corners=course.corner,
        why=_why(goal, total, narrowed),
        outcomes=tuple(words for _, words in outcomes),
        expected=_expected_of(goal, total),
        channels={model.name: own for model, own in zip(models, channels, strict=True)},
        differences={
            models[max(pair.true, pair.other)].name: {
                channel: values if pair.true else -values for channel, values in pair.difference.items()
            }
            for pair in pairs
        },
        sigma=sigma,
        clearest=outcomes[0][0] if outcomes else next(iter(channels[0])),
    )


def _expected_of(goal: Goal[AnyCompared], total: Information) -> tuple[ExpectedEvidence, ...]:
    """Return the expected evidence of each pair; none where there is nothing to separate."""
    if not goal.separates:
        return ()
    gains = goal.evidence(total)
    return tuple(
        ExpectedEvidence(goal.models[i].name, goal.models[j].name, gain) for (i, j), gain in gains.items()
    )


def _why(goal: Goal[AnyCompared], total: Information, narrowed: NarrowedInterval | None) -> str:
    """Say what a run does, with those before it; `narrowed` where there is nothing to separate."""
    if narrowed is not None:
        share = narrowed.expected / narrowed.half_width
        return f"narrows the interval of {narrowed.name} to {100.0 * share:.0f} %"
    standing = goal.standing(total)
    if not standing:
        return f"separates {words_of(goal.models[0].name)} from {_others(goal)} best, though not for sure"
    names = either(goal, standing)
    return f"is expected to show {names} if true, by {amount(standing)} in BIC"


def amount(standing: Mapping[int, float]) -> str:
    """Return the least of some ΔBIC in words; large ones are no exact numbers."""
    least = min(standing.values())
    return f"{least:.0f} or more" if least < _LARGE else f"more than {_LARGE:.0f}"


def either(goal: Goal[AnyCompared], which: Iterable[int]) -> str:
    """Return some models in words."""
    return " or ".join(words_of(goal.models[i].name) for i in which)


def _others(goal: Goal[AnyCompared]) -> str:
    return ", ".join(words_of(model.name) for model in goal.models[1:])


def sentence(goal: Goal[AnyCompared], total: Information, narrowed: NarrowedInterval | None) -> str:
    """Say what the proposed runs are for; `narrowed` where there is nothing to separate."""
    if (one := narrowed) is not None:
        return (
            f"Nothing is left to separate. The widest interval is that of {one.name}, "
            f"{one.value:.4g} ± {one.half_width:.2g} {one.unit}".removesuffix(" 1")
            + f"; the proposed runs are expected to narrow it to ± {one.expected:.2g}."
        )
    standing = goal.standing(total)
    rest = [k for k, model in enumerate(goal.models) if model.may_be_true and k not in standing]
    text = f"The runs so far leave {words_of(goal.models[0].name)} and {_others(goal)}."
    if standing:
        text += (
            f" If {either(goal, standing)} is true, the proposed runs are expected to show it, by "
            f"{amount(standing)} in BIC."
        )
    if rest:
        text += f" If {either(goal, rest)} is, they may not: too small, or too much like the others."
    return text
