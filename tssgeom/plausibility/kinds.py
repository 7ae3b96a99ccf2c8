"""What a rule of plausibility is, and the remark that one is broken."""

from __future__ import annotations

from typing import Literal, NamedTuple

Severity = Literal["refuse", "warn"]
Subject = Literal["run", "campaign", "frame", "rig", "command"]


class Rule(NamedTuple):
    """One rule: a row of docs/checks.md."""

    test: str
    """What breaks it, in words, with its limits."""
    severity: dict[Subject, Severity]
    """What follows, by what is tested."""
    reason: str
    """Why no sound measurement does so."""
    hint: str
    """What to do, the end of each message."""


class Remark(NamedTuple):
    """A rule that is broken."""

    rule: str
    severity: Severity
    text: str
    """One line: what was measured, the hint, and the name of the rule."""
