"""What analyse, batch and check share: options, one input at a time, and what to do where one fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from msgspec.structs import replace as changed

from pipelines.console import complain
from pipelines.first_run import announce_compiling
from pipelines.progress import progressing
from tssgeom.errors import SettingsError, ShapeError, SpaceError, TssgeomError, refused
from tssgeom.io.formats.files import Recording, find_inputs, open_recording, output_names, real
from tssgeom.io.results.shapes import Analysis, frame_row, relative
from tssgeom.rig import Rig, read_rig
from tssgeom.stream import process
from tssgeom.summary import RunningSummary

Done = TypeVar("Done")

_MOST_FRAMES_TOLD = 5


@dataclass(frozen=True, slots=True)
class Options:
    """What the user chose for a run."""

    rig: Rig
    rig_file: Path | None
    tension_in: float
    """Proximal tension for frames that bring none [N]."""
    unit: str | None
    lumen: Path | None
    geometry_only: bool = False
    """Whether each frame is the first pull of its tendon, whatever came before it."""
    tube_radius: float = 0.0
    """Radius of the tube along the route, for its clearance [m]."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """An input that could not be used."""

    source: str
    reason: str
    """One line that names the input."""


def options(
    rig: Path | None,
    tension_in: float,
    unit: str | None,
    lumen: Path | None,
    *,
    geometry_only: bool = False,
    tube_mm: float | None = None,
) -> Options:
    """Check what the user chose.

    Raises
    ------
    SettingsError
        Where the rig file, the tension or the tube cannot be used.
    """
    if not math.isfinite(tension_in) or tension_in < 0:
        raise SettingsError(f"--tension-in is {tension_in:g} N: give a finite tension >= 0 N")
    held = Rig() if rig is None else read_rig(rig)
    if tube_mm is not None and not 0 < tube_mm < math.inf:
        raise SettingsError(f"--tube-mm is {tube_mm:g} mm: give the outer diameter of the tube, > 0 mm")
    announce_compiling()
    return Options(held, rig, tension_in, unit, lumen, geometry_only, 0.5e-3 * (tube_mm or 0.0))


def geometry_alone(chosen: Options) -> Options:
    """Return the options for finding a route on which the tendon does not matter: no effects act."""
    return replace(chosen, rig=changed(chosen.rig, effects=()))


def inputs_of(paths: Iterable[Path], besides: Collection[Path] = ()) -> Iterator[Path | Refusal]:
    """Yield each file in files and folders once, and a refusal for a folder without shapes."""
    seen = set[Path]()
    for path in paths:
        found = guarded(path, partial(find_inputs, [path], besides))
        for item in [found] if isinstance(found, Refusal) else found:
            if isinstance(item, Refusal) or real(item) not in seen:
                yield item
            if isinstance(item, Path):
                seen.add(real(item))


def guarded(source: str | Path, work: Callable[[], Done]) -> Done | Refusal:
    """Do the work for one input, so that whatever goes wrong stays with that input."""
    try:
        return work()
    except SpaceError:
        raise  # nothing else could be written either
    except TssgeomError as error:
        return Refusal(str(source), one_line(str(error)))
    except OSError as error:
        return Refusal(str(source), one_line(f"{source}: {refused(error)}"))
    except Exception as error:  # a mistake of ours must not take the other inputs down
        what = one_line(f"{type(error).__name__}: {error}")
        return Refusal(str(source), f"{source}: unexpected {what}: please report it with the file")


def analysis_of(
    name: str, path: Path, chosen: Options, step: Callable[[int, float], None] = lambda frames, size: None
) -> Analysis:
    """Read and process one input.

    Parameters
    ----------
    name
        Name of its outputs.
    path
        The file.
    chosen
        Rig, tension and unit.
    step
        Called after each frame with 1 and the share of the file that the frame is [B].

    Raises
    ------
    ShapeError, SourceError
        Where the file cannot be used, or none of its frames.
    """
    recording = open_recording(path, chosen.unit)
    account = RunningSummary.of(recording.frame_count)
    share = _size(path) / max(recording.frame_count, 1)
    for item in process(recording.frames, chosen.rig, tension_in=chosen.tension_in):
        account.add(item, frame_row(item))
        step(1, share)
    return useful(name, relative(path), recording, account.close())


def useful(name: str, source: str, recording: Recording, account: RunningSummary) -> Analysis:
    """Return the analysis of an input of which some frames could be used.

    Raises
    ------
    ShapeError
        Where none could.
    """
    if account.used:
        kind, timed = recording.kind, recording.timed
        return Analysis(name, source, recording.unit, kind, timed, account, recording.warnings)
    first = f"{account.rejected[0].reason}" if account.rejected else "it holds no frame"
    where = f"none of {account.frames} frames can be used; the first: " if account.frames > 1 else ""
    hints = "".join(f" ({warning})" for warning in recording.warnings)
    raise ShapeError(f"{recording.path}: {where}{first}{hints}")


def frame_refusals(analysis: Analysis, source: str) -> list[str]:
    """Return a line for each frame that was rejected; of many, the first few and a count."""
    told = analysis.summary.rejected[:_MOST_FRAMES_TOLD]
    lines = [f"{source}: frame {item.seq}: {one_line(item.reason)}" for item in told]
    more = analysis.summary.refused - len(lines)
    if more:
        lines.append(f"{source}: {more} more frames rejected: see tssgeom check --json")
    return lines


@dataclass(slots=True)
class Tally:
    """What became of the inputs of a run."""

    done: int = 0
    frames_refused: int = 0
    refusals: list[Refusal] = field(default_factory=list)

    @property
    def status(self) -> int:
        """Exit status: 0 all done, 1 something was rejected and the rest done, 2 nothing done."""
        if not self.done:
            return 2
        return 1 if self.refusals or self.frames_refused else 0

    def refuse(self, refusal: Refusal) -> None:
        """Count a refusal, and tell it."""
        complain(refusal.reason)
        self.refusals.append(refusal)


def each_analysis(
    found: Sequence[Path | Refusal], chosen: Options, finish: Callable[[Analysis], None], *, quiet: bool
) -> Tally:
    """Analyse input after input; what goes wrong is told, counted, and stays with its input.

    Parameters
    ----------
    found
        Files, and what was refused in finding them.
    chosen
        Rig, tension and unit.
    finish
        Called with each analysis; where it fails, the analysis counts as done and its failure is told.
    quiet
        Show no progress.
    """
    tally = Tally()
    names = output_names([item for item in found if isinstance(item, Path)])
    total = sum(_size(item) for item in found if isinstance(item, Path))
    with progressing(len(found), total, quiet=quiet) as progress:
        for item in found:
            if isinstance(item, Refusal):
                tally.refuse(item)
            else:
                work = partial(analysis_of, names[item], item, chosen, progress.more)
                frames = _count(tally, item, guarded(item, work), finish)
                progress.end(str(item), frames, _size(item))
    return tally


def _size(path: Path) -> int:
    """Size of a file [B]; 0 where there is none, which whoever reads it will tell."""
    return path.stat().st_size if path.is_file() else 0


def _count(tally: Tally, path: Path, outcome: Analysis | Refusal, finish: Callable[[Analysis], None]) -> int:
    """Count an input, and return how many frames it had."""
    if isinstance(outcome, Refusal):
        tally.refuse(outcome)
        return 0
    tally.done += 1
    tally.frames_refused += outcome.summary.refused
    for line in frame_refusals(outcome, str(path)):
        complain(line)
    if isinstance(failure := guarded(path, partial(finish, outcome)), Refusal):
        tally.refuse(failure)
    return outcome.summary.frames


def one_line(text: str) -> str:
    """Return a text without its line breaks."""
    return " ".join(text.split())
