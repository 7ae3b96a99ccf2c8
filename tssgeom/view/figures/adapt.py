"""Figure of a followed run: each number over time with its band, and a channel beside its reading."""

from __future__ import annotations

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.adapt.offline import FollowedRun
from tssgeom.arrays import Vector
from tssgeom.statistics import NORMAL_95
from tssgeom.view.figures.plots import BAND, BLUE, ORANGE, PAGE, SKY, figure, measured, note
from tssgeom.view.quantities import quantity

_HEIGHT = 1.35  # of a row of the figure [inch]; chosen: the bands can be read
_LETTER = 0.0115  # width of a letter over that of the axes; measured at 7.5 pt over 150 mm, rounded up
_BEFORE, _AFTER = (
    15.0,
    30.0,
)  # of the first alert, in the picture of the distal tension [s]; chosen: some strokes
_UNITS = {
    "Nm_per_rad": ("N·m/rad", 1.0),
    "N_per_m": ("N/m", 1.0),
    "per_N": ("1/N", 1.0),
    "per_m": ("1/m", 1.0),
    "N": ("N", 1.0),
    "m": ("mm", 1e3),
    "Nm": ("mN·m", 1e3),
    "rad": ("rad", 1.0),
}
"""Of names that end so, the longest ending first, and the factor from SI."""
_TENSION_OUT = "tension_out_N"
_TIMES = ((7200.0, "h", 3600.0), (300.0, "min", 60.0))


def followed_figure(run: FollowedRun, read: Vector | None, channel: str = _TENSION_OUT) -> Figure:
    """Draw what was followed in a run, and a channel, [n] as it was `read` in the unit of its name."""
    keys = run.keys
    unit, _ = _unit_of_time(run)
    with figure((PAGE, _HEIGHT * (len(keys) + 1) + 0.3)) as drawing:
        rows = drawing.subplots(len(keys) + 1, 1)
        for axes, key in zip(rows, keys, strict=False):
            draw_number(axes, run, key)
            axes.set_xlabel("")
            axes.tick_params(labelbottom=axes is rows[-2])
        rows[-2].set_xlabel(f"time [{unit}]")
        _name_alerts(rows[0], run)
        _draw_channel(rows[-1], run, channel, read)
        drawing.legend(*_named_once(rows[0], rows[-1]), loc="outside lower center", ncols=4)
        drawing.align_ylabels(rows.tolist())
    return drawing


def _named_once(*every: Axes) -> tuple[list[Artist], list[str]]:
    """Return what a legend of several axes shows, and its names, each once."""
    of = {
        name: one
        for axes in reversed(every)
        for one, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    return list(of.values()), list(of)


def _unit_of_time(run: FollowedRun) -> tuple[str, float]:
    span = run.time[-1] - run.time[0]
    return next(((unit, per) for least, unit, per in _TIMES if span > least), ("s", 1.0))


def draw_number(axes: Axes, run: FollowedRun, key: str) -> Axes:
    """Draw one followed number over time with its 95 % band, and when alerts were given."""
    (time_unit, per), (name, unit, factor) = _unit_of_time(run), _words(key)
    for i, stretch in enumerate(run.stretches):
        if key not in stretch.keys:
            continue
        at, numbers = stretch.keys.index(key), stretch.numbers
        time, value = numbers.time / per, factor * numbers.values[:, at]
        bound = factor * NORMAL_95 * numbers.se[:, at]
        hidden = "_" if i else ""  # one line in the legend for all stretches
        low, high = value - bound, value + bound
        axes.fill_between(time, low, high, color=BAND, linewidth=0, label=f"{hidden}95 % band")
        filtered = factor * numbers.filtered[:, at]
        axes.plot(time, filtered, color=SKY, linewidth=0.8, label=f"{hidden}filtered")
        axes.plot(time, value, color=BLUE, linewidth=1.5, label=f"{hidden}smoothed")
    for alert in run.alerts:
        axes.axvline(alert.since / per, color=ORANGE, linewidth=1.0)
    axes.set_xlim(run.time[0] / per, run.time[-1] / per)
    axes.set_xlabel(f"time [{time_unit}]")
    axes.set_ylabel(f"{name}\n[{unit}]")
    return axes


def draw_followed_tension(axes: Axes, run: FollowedRun) -> Axes:
    """Draw the distal tension about the first alert, or at the end, with its band [N]."""
    return _draw_channel(axes, run, _TENSION_OUT, None)


def _draw_channel(axes: Axes, run: FollowedRun, channel: str, read: Vector | None) -> Axes:
    """Draw a channel about the first alert, or at the end, with its band and what was read."""
    of = quantity(channel)
    every, errors = (
        run.channels[channel].T if channel in run.channels else (run.ends[:, 1], run.ends_se[:, 1])
    )
    middle = run.alerts[0].since if run.alerts else run.time[-1] - _AFTER
    window = (run.time >= middle - _BEFORE) & (run.time <= middle + _AFTER)
    time, value = run.time[window], of.factor * every[window]
    bound = NORMAL_95 * of.factor * errors[window]
    axes.fill_between(time, value - bound, value + bound, color=BAND, linewidth=0, label="95 % band")
    axes.plot(time, value, color=SKY, linewidth=1.2, label="filtered")
    if read is not None:
        measured(axes, time, of.factor * read[window])
    for alert in run.alerts:
        if len(time) and time[0] <= alert.since <= time[-1]:
            axes.axvline(alert.since, color=ORANGE, linewidth=1.0)
    axes.margins(x=0.0)
    axes.set_ylabel(f"{of.symbol}\n[{of.unit}]")
    axes.set_xlabel("time [s], about the first alert" if run.alerts else "time [s], the end of the run")
    return axes


def _name_alerts(axes: Axes, run: FollowedRun) -> None:
    """Write the name of each alert above the axes, in as many lines as it takes that none covers another."""
    span, ends = max(float(run.time[-1] - run.time[0]), 1e-300), list[float]()
    for alert in sorted(run.alerts, key=lambda each: each.since):
        words = alert.mechanism.replace("_", " ") or quantity(alert.channel).symbol
        if alert.mechanism:
            words += f",\N{NO-BREAK SPACE}{100.0 * alert.probability:.0f}\N{NO-BREAK SPACE}%"
        width = _LETTER * len(words)
        begin = min((alert.since - run.time[0]) / span, 1.0 - width)
        line = next((k for k, end in enumerate(ends) if end < begin), len(ends))
        ends[line : line + 1] = [begin + width]
        at = {"xytext": (0, 2 + 9 * line), "textcoords": "offset points", "va": "bottom"}
        note(axes, words, (begin, 1.0), xycoords="axes fraction", color=ORANGE, **at)


def _words(key: str) -> tuple[str, str, float]:
    """Return name, unit and factor of a number by its key: `tension_in_offset.offset_N`."""
    if key.startswith("sensors.") and key.endswith(".zero"):
        channel = quantity(key.removeprefix("sensors.").removesuffix(".zero"))
        return f"zero of {channel.symbol}", channel.unit, channel.factor
    table, _, name = key.partition(".")
    words = {"coefficient": "friction μ", "angle_gain": "angle gain", "gain_error": table.replace("_", " ")}
    for ending, (unit, factor) in _UNITS.items():
        if name.endswith(f"_{ending}"):
            stem = name.removesuffix(f"_{ending}")
            owner = table.replace("_offset", " zero").replace("_in", "").replace("_", " ")
            short = {"tension_in_offset": "zero of T_in", "tension_out_offset": "zero of T_out"}.get(table)
            plain = stem if table in ("tendon", "load") else f"{owner} {stem}"
            return short or plain.replace("_", " "), unit, factor
    return words.get(name, key.replace("_", " ")), "1", 1.0
