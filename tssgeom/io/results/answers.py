"""Answers of the stream to each frame, as lines of JSON."""

from __future__ import annotations

import math
from typing import Any, overload

import msgspec

from tssgeom.adapt.alert import Alert
from tssgeom.adapt.readings import FollowedRig
from tssgeom.io.results.keys.shapes import Segment
from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import MOST_OUTSIDE
from tssgeom.tendon.machine_stream import MachineCommand

_LEAST_PROBABILITY = 0.01  # of a mechanism that is named beside the likeliest one [1]; chosen
_LONGEST_TEXT = 512  # characters of a frame's own text in an answer; chosen: ids and reasons fit


class OtherCause(msgspec.Struct, frozen=True):
    """A mechanism that explains an alert less well."""

    mechanism: str
    """Name of the mechanism."""
    where: str
    """On what it acts."""
    probability: float
    """Of the mechanism, among those that were tried [1]."""
    sentence: str
    """The mechanism with its size."""


class LiveAlert(msgspec.Struct, frozen=True, omit_defaults=True):
    """A disagreement between readings and model; without a mechanism as long as none is known."""

    channel: str
    """Channel whose readings the model does not explain."""
    since_s: float
    """When it began, by the sender's clock [s]."""
    phase: str
    """What the drive did then: `pulling`, `releasing` or `hold`."""
    mechanism: str = ""
    """What explains it best, and likewise the keys below; left out where nothing is compared yet."""
    where: str = ""
    """On what the mechanism acts."""
    probability: float | None = None
    """Of the mechanism, among those that were tried [1]."""
    sentence: str = ""
    """The mechanism with its size."""
    others: tuple[OtherCause, ...] = ()
    """Mechanisms that explain it less well."""


class Answer(msgspec.Struct, frozen=True, omit_defaults=True):
    """The answer to a good frame, in SI."""

    t: float
    """Time of the frame [s]."""
    seq: int
    """Count of the frame on arrival, from 0, over all sources [1]."""
    length_m: float
    """Arc length L [m]."""
    total_angle_rad: float
    """Accumulated curve angle Φ [rad]."""
    total_angle_se_rad: float
    """Standard error of Φ [rad]."""
    tension_in_N: float
    """Tension at the proximal end [N]."""
    tension_out_N: float
    """Tension at the distal end [N]."""
    elongation_m: float
    """Elongation δ above the pretensioned state [m]."""
    elongation_se_m: float
    """Standard error of δ [m]."""
    direction_index: int
    """+1 pulling, -1 releasing."""
    dead_zone: bool
    """True where the distal end has not followed yet."""
    segments: list[Segment]
    """Pieces of constant curvature, proximal to distal."""
    latency_us: float
    """From the last byte of the frame to this line [µs]."""
    dropped: int
    """Frames that were dropped for newer ones, since the start [1]."""
    stale: bool
    """False."""
    displacement_command_m: float | None = None
    """Position of the drive that reaches the target; as the keys below, only with a target [m]."""
    tension_command_N: float | None = None
    """Tension of the drive that reaches it [N]."""
    displacement_out_se_m: float | None = None
    """Standard error of the load's movement, the drive at the position [m]."""
    tension_out_se_N: float | None = None
    """Standard error of the distal tension, the drive at the position [N]."""
    displacement_out_se_by_tension_m: float | None = None
    """Standard error of the load's movement, the drive at the tension [m]."""
    tension_out_se_by_tension_N: float | None = None
    """Standard error of the distal tension, the drive at the tension [N]."""
    displacement_reached_m: float | None = None
    """Movement of the load that is reached instead; only with `limited` or `waits` [m]."""
    tension_reached_N: float | None = None
    """Distal tension that is reached instead; only with `limited` or `waits` [N]."""
    limited: str = ""
    """Limits of the drive that cut the command; only where one did."""
    waits: bool = False
    """True where the drive is held inside the dead zone; only there."""
    out_of_tolerance: float | None = None
    """Probability of a miss by more than `--tolerance-mm`; only where above 5 % [1]."""
    followed: dict[str, tuple[float, float]] | None = None
    """With `--adapt`: value and standard error of each followed number, by key of the rig, in its unit."""
    alert: LiveAlert | None = None
    """With `--adapt`: a disagreement, as long as it lasts."""
    id: str | int = ""
    """The sender's own name of the frame."""
    warnings: tuple[str, ...] = ()
    """What is worth knowing about the frame; only where there is any."""


class Refusal(msgspec.Struct, frozen=True, omit_defaults=True):
    """The answer to a bad frame."""

    t: float | None
    """Time of the frame; null where it holds none that could be read [s]."""
    seq: int
    """Count of the frame on arrival, from 0 [1]."""
    rejected: str
    """Why it could not be used."""
    id: str | int = ""
    """The sender's own name of the frame."""


class Stale(msgspec.Struct, frozen=True):
    """The one line that is sent when no frame has come for a while."""

    t: float
    """Time of the last good frame [s]."""
    seq: int
    """Count of the last good frame [1]."""
    stale: bool
    """True."""
    silent_s: float
    """Time since the last good frame [s]."""
    dropped: int
    """Frames that were dropped for newer ones, since the start [1]."""


class Late(msgspec.Struct, frozen=True):
    """The line that is sent when an answer is not out by its deadline; it follows."""

    t: float | None
    """Time of the last good frame; null before the first [s]."""
    seq: int
    """Count of the last good frame; -1 before the first [1]."""
    stale: bool
    """True."""
    late: int
    """Count of the frame whose answer is not out [1]."""
    silent_s: float
    """Time since that frame arrived [s]."""
    dropped: int
    """Frames that were dropped for newer ones, since the start [1]."""


_encoder = msgspec.json.Encoder()


def answer(result: FrameResult, time: float, seq: int, latency_us: float, dropped: int) -> bytes:
    """Write the answer to a good frame of a `time` by its sender's clock [s]."""
    arcs, transmission = result.arcs, result.transmission
    line = Answer(
        t=time,
        seq=seq,
        length_m=arcs.total_length,
        total_angle_rad=arcs.total_angle,
        total_angle_se_rad=arcs.total_angle_se,
        tension_in_N=transmission.tension_in,
        tension_out_N=transmission.tension_out,
        elongation_m=transmission.elongation,
        elongation_se_m=transmission.elongation_se,
        direction_index=transmission.direction_index,
        dead_zone=transmission.dead_zone,
        segments=Segment.of(arcs),
        latency_us=latency_us,
        dropped=dropped,
        stale=False,
        **(_of_command(result.command) if result.machine is None else _of_machine(result.machine.command)),
        followed=None if result.followed is None else _numbers(result.followed),
        alert=None if result.alert is None else _alert(result.alert, time - result.frame.time),
        id=result.frame.id,
        warnings=result.warnings,
    )
    if result.machine is None:
        return _line(line)
    return _encoder.encode({**msgspec.to_builtins(line), **result.machine.numbers}) + b"\n"


def _of_command(command: Command | None) -> dict[str, Any]:
    """Return the part of an answer on a command: what is reached only where that is not the target."""
    if command is None:
        return {}
    errors, risk = command.errors, command.out_of_tolerance
    misses = command.waits or bool(command.limited)
    return {
        "displacement_command_m": command.displacement_in,
        "tension_command_N": command.tension_in,
        "displacement_out_se_m": errors.displacement_out,
        "tension_out_se_N": errors.tension_out,
        "displacement_out_se_by_tension_m": errors.displacement_out_by_tension,
        "tension_out_se_by_tension_N": errors.tension_out_by_tension,
        "displacement_reached_m": command.displacement_reached if misses else None,
        "tension_reached_N": command.tension_reached if misses else None,
        "limited": command.limited,
        "waits": command.waits,
        "out_of_tolerance": risk if risk is not None and risk > MOST_OUTSIDE else None,
    }


def _of_machine(command: MachineCommand | None) -> dict[str, Any]:
    """Return the part of an answer on the command of a machine that is no number of it."""
    if command is None:
        return {}
    risk = command.out_of_tolerance
    return {
        "limited": command.limited,
        "waits": command.waits,
        "out_of_tolerance": risk if risk is not None and risk > MOST_OUTSIDE else None,
    }


def _numbers(known: FollowedRig) -> dict[str, tuple[float, float]]:
    """Return value and standard error of each number that is followed, by key."""
    pairs = zip(known.values.tolist(), known.se.tolist(), strict=True)
    return dict(zip(known.keys, pairs, strict=True))


def _alert(alert: Alert, offset: float) -> LiveAlert:
    """Return an alert as an answer has it; `offset` is the sender's clock less the tendon's [s]."""
    begun = LiveAlert(alert.channel, alert.since + offset, alert.phase)
    if not alert.explanations:
        return begun
    first, *others = alert.explanations
    likely = tuple(OtherCause(*one) for one in others if one.probability >= _LEAST_PROBABILITY)
    return LiveAlert(begun.channel, begun.since_s, begun.phase, *first, likely)


def refusal(rejected: Rejected) -> bytes:
    """Write the answer to a bad frame; long text of the frame is cut."""
    time = rejected.time if math.isfinite(rejected.time) else None
    return _line(Refusal(time, rejected.seq, _cut(rejected.reason), _cut(rejected.id)))


@overload
def _cut(given: str) -> str: ...
@overload
def _cut(given: str | int) -> str | int: ...
def _cut(given: str | int) -> str | int:
    return given[:_LONGEST_TEXT] + "…" if isinstance(given, str) and len(given) > _LONGEST_TEXT else given


def stale(time: float, seq: int, silent: float, dropped: int) -> bytes:
    """Write that no good frame has come for `silent` seconds."""
    return _line(Stale(time, seq, True, round(silent, 3), dropped))


def late(time: float | None, seq: int, frame: int, waited: float, dropped: int) -> bytes:
    """Write that a frame has no answer by its deadline; `time` and `seq` are the last good frame's."""
    return _line(Late(time, seq, True, frame, round(waited, 3), dropped))


def _line(message: msgspec.Struct) -> bytes:
    return _encoder.encode(message) + b"\n"
