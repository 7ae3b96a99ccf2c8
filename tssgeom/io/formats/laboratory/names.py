"""Names of columns as laboratories write them: which quantity, at which end, in which unit."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

from tssgeom import channel_names
from tssgeom.io.formats.columns import (
    AXES,
    BENDS,
    CHANNELS,
    DIRECTIONS,
    MACHINE_CHANNELS,
    MEASURED,
    OF_MACHINE,
    POINT,
    TIME,
)
from tssgeom.io.formats.laboratory.units import (
    ANGLE,
    CURRENT,
    CURVATURE,
    FORCE,
    LENGTH,
    SI,
    TEMPERATURE,
    TORQUE,
    UNITS,
    Unit,
    plain,
    unit_of,
)
from tssgeom.io.formats.laboratory.units import TIME as OF_TIME

RECORDING, FRAME, LABEL = "recording", "frame", "label"
QUANTITIES = {
    **{
        channel_names.quantity_of(name): UNITS[channel_names.unit_of(name)].quantity
        for name in {**CHANNELS, **MEASURED, **MACHINE_CHANNELS}
    },
    "time": OF_TIME,
    **dict.fromkeys((*AXES, "s"), LENGTH),
    **dict.fromkeys(BENDS, CURVATURE),
    **dict.fromkeys((*DIRECTIONS, POINT, RECORDING, FRAME, LABEL), ""),
}
"""What a column can be, and its quantity; "" for what has no unit."""
EXACT = frozenset(
    (
        *(TIME, POINT, *CHANNELS, *OF_MACHINE, *MEASURED, *DIRECTIONS),
        *(f"{axis}{unit}" for axis in (*AXES, "s") for unit in ("", "_m", "_mm")),
        *(f"{bend}_per_{unit}" for bend in BENDS for unit in ("m", "mm")),
    )
)
"""Names that are read as they stand."""


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


_FORCES = _set("tension force load kraft zugkraft seilkraft zug t f loadcell lc pull tensions")
_LENGTHS = _set("displacement disp position pos stroke travel weg verschiebung displ")
_ELONGATIONS = _set("elongation elong stretch dehnung delta δ")
_TEMPERATURES = _set("temperature temp temperatur")
_TIMES = _set("time t timestamp timestamps zeit elapsed epoch datetime date clock uhrzeit zeitstempel")
_IN = _set("in input proximal prox drive motor actuator antrieb eingang handle servo")
_OUT = _set("out output distal dist tip abtrieb ausgang")
_FORCE_UNITS = _set("N newton newtons mN cN daN kN kgf kp gf lbf ozf")
"""Units that only forces have: a column in one of them may be a tension, whatever its name."""
_TARGETS = _set("target setpoint command cmd commanded soll reference ref desired goal demand")
_FILLERS = _set(
    "cell sensor measured meas actual ist value channel ch the of at reading end side cable tendon "
    "wire rope seil signal total raw filtered filt stamp abs absolute unix utc rel relative since "
    "start data"
)
_UNCLEAR_LENGTHS = _set("extension strain motion movement encoder crosshead")
_RECORDINGS = _set(
    "run trial recording rec experiment session test case subject versuch messung repeat repetition"
)
_ORDERS = _set("point order index idx seq sequence node")
_LABELS = _set(
    "marker id label name nr no number nummer tracker tag markerid tool port handle coil probe sensor"
)
_MOTORS = _set("motor drive actuator servo spindle antrieb pulley")
_JOINTS = _set("joint wrist hinge gelenk")
_OF_MACHINES = {
    ANGLE: ("angle", _set("angle position pos winkel rotation")),
    TORQUE: ("torque", _set("torque moment drehmoment load")),
    CURRENT: ("current", _set("current strom i")),
}
_FRAMES = _set("frame frames sample samples")
FLAG = re.compile(r"(is[ _]?)?(valid|tracked|visible)(?![a-z]).*", re.IGNORECASE)
"""Name of a column that says whether a point was tracked."""
_AXIS_FILLERS = _set("position pos coordinate coord coordinates marker point p koordinate")
_STATIONS = frozenset(("s", "arclength", "station", "arc length", "curve length", "bogenlänge"))
_JOINED = (
    {
        prefix + side: (prefix, side)
        for prefix in ("t", "f", "x", "d")
        for side in ("in", "out", "prox", "dist", "proximal", "distal")
    }
    | {
        part + what: (part, what)
        for part in ("gelenk", "motor", "antrieb")
        for what in ("winkel", "position", "moment", "drehmoment", "strom", "kraft", "weg")
    }
    | {"loadcell": ("force",), "arclength": ("arclength",)}
)


class Meaning(NamedTuple):
    """What a column seems to be."""

    channel: str
    """A name of QUANTITIES, or "force" or "displacement" where the end is open; "" where it is unclear."""
    unit: Unit | None
    quantity: str
    """What it measures, also where it is unclear which channel that is."""
    target: bool = False
    """True for a command or set point, which is no measurement."""


def canonical(channel: str) -> str:
    """Return the column in SI of a channel: "tension_in_N" of "tension_in"."""
    quantity = QUANTITIES.get(channel)
    if channel in MEASURED or not quantity:
        return channel
    return f"{channel}_{SI[quantity]}"


def channel_text(channel: str, unit: Unit | None) -> str:
    """Return `channel[:unit]` as `--map` takes it."""
    return canonical(channel) + (f":{unit.symbol}" if unit and unit.factor != 1.0 else "")


@lru_cache(maxsize=4096)
def meaning_of(name: str, unit_row: str = "") -> Meaning | None:
    """Return what a column seems to be by its name; None where it resembles nothing that is read."""
    stem, unit = _unit_in(plain(name))
    unit = unit_of(unit_row) or unit
    words = _words(stem)
    if (
        unit is None
        and len(words) > 1
        and "[" not in stem
        and (last := unit_of(_last_word(stem)))
        and last.symbol != "in"
    ):
        unit, words = last, words[:-1]
    if not words:
        return None
    return (
        _geometry(words, unit)
        or _numbering(words, unit)
        or _of_machine(words, unit)
        or _measurement(stem, words, unit)
    )


def split_unit(name: str) -> tuple[str, Unit | None]:
    """Split the name of a column into all else and the unit that it states."""
    return _unit_in(plain(name))


def is_inert(name: str) -> bool:
    """Whether a column is neither read nor resembles what is, and says nothing of what is read."""
    return meaning_of(name) is None and stamp_part(name) is None and not FLAG.fullmatch(name)


def stamp_part(name: str) -> tuple[str, str] | None:
    """Split the column of a stamp of ROS into its message and its part, "sec" or "nanosec"."""
    match = re.fullmatch(r"(.*stamp)[._/]?(?:(secs?)|(?:n|nano)secs?)", name.strip(), re.IGNORECASE)
    return (match[1], "sec" if match[2] else "nanosec") if match else None


def _unit_in(text: str) -> tuple[str, Unit | None]:
    """Split the unit off a name: in brackets, after a slash, comma or "in", or after an underscore."""
    for match in re.finditer(r"\s*[\[({<]\s*([^\[\](){}<>]*)\s*[\])}>]", text):
        if unit := unit_of(match[1]):
            return (text[: match.start()] + " " + text[match.end() :]).strip(), unit
    for pattern in (r"(.*\S)\s*[/,;:]\s*(\S+)", r"(.*\S)\s+in\s+(\S+)"):
        if (match := re.fullmatch(pattern, text)) and (unit := unit_of(match[2])):
            return match[1], unit
    if match := re.fullmatch(r"(.*[^_])_((?:deg_|rad_)?per_m{1,2}|per_cm)", text):
        return match[1], unit_of(match[2])
    if match := re.fullmatch(r"([^\[({<]*[^\s_.\[({<-])[\s_.-]+([^\s_.\])}>-]+)", text):
        unit = unit_of(match[2])
        inch_of_no_axis = unit is not None and unit.symbol == "in" and not _is_axis(match[1])
        if unit is not None and not inch_of_no_axis:
            return match[1], unit
    return text, None


def _is_axis(stem: str) -> bool:
    return any(word in (*AXES, "s") for word in _words(stem))


def _last_word(stem: str) -> str:
    return re.findall(r"[^\W\d_]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", stem))[-1:][0]


def _words(stem: str) -> tuple[str, ...]:
    """Return the words of a name in small letters, without numbers."""
    split = re.sub(r"([a-zä-ü])([A-ZÄ-Ü])", r"\1 \2", stem.replace("%", " percent "))
    words = (word.lower() for word in re.findall(r"[^\W\d_]+", split))
    return tuple(part for word in words for part in _JOINED.get(word, (word,)))


def _geometry(words: tuple[str, ...], unit: Unit | None) -> Meaning | None:
    """Recognise coordinates, stations and curvatures."""
    rest = [word for word in words if word not in _AXIS_FILLERS]
    quantity = unit.quantity if unit else None
    if quantity in (None, LENGTH):
        if len(rest) == 1 and rest[0] in AXES:
            return Meaning(rest[0], unit, LENGTH)
        if " ".join(words) in _STATIONS:
            return Meaning("s", unit, LENGTH)
    if quantity == CURVATURE and rest and rest[0] in ("kappa", "κ", "curvature") and rest[-1] in ("x", "y"):
        return Meaning(f"kappa_{rest[-1]}", unit, CURVATURE)
    return None


def _numbering(words: tuple[str, ...], unit: Unit | None) -> Meaning | None:
    """Recognise the numbers of points, frames and recordings."""
    if unit is not None:
        return None
    held = set(words)
    for known, channel in ((_RECORDINGS, RECORDING), (_FRAMES, FRAME)):
        if held & known and held <= known | _LABELS | _ORDERS:
            return Meaning(channel, None, "")
    if held & _ORDERS and held <= _ORDERS | _LABELS | {"along", "route"}:
        return Meaning(POINT, None, "")
    return Meaning(LABEL, None, "") if held <= _LABELS | {"point"} else None


def _of_machine(words: tuple[str, ...], unit: Unit | None) -> Meaning | None:
    """Recognise angle, torque and current of a motor or a joint; an angle without a unit is not clear."""
    if unit is None or unit.quantity not in _OF_MACHINES:
        return None
    word, spelled = _OF_MACHINES[unit.quantity]
    held = set(words) - _FILLERS
    for side, known in (("motor", _MOTORS), ("joint", _JOINTS)):
        channel = f"{side}_{word}"
        if held & known and held <= known | spelled and channel in QUANTITIES:
            return Meaning(channel, unit, unit.quantity)
    return None


def _measurement(stem: str, words: tuple[str, ...], unit: Unit | None) -> Meaning | None:
    """Recognise a channel by its words; one with a word that is not known is unclear."""
    held = set(words) - _FILLERS
    target = bool(held & _TARGETS)
    held -= _TARGETS
    quantity = _quantity_of(held, stem, unit)
    if quantity is None:
        return Meaning("", unit, FORCE, target) if unit is not None and unit.symbol in _FORCE_UNITS else None
    sides = {"in": held & _IN, "out": held & _OUT}
    if quantity in ("displacement", "elongation") and "load" in held:
        sides["out"] = sides["out"] | {"load"}
    known = _WORDS_OF[quantity] | _IN | _OUT | sides["out"]
    measured = (
        FORCE if quantity == "force" else {"temperature": TEMPERATURE, "time": OF_TIME}.get(quantity, LENGTH)
    )
    stated = [side for side, present in sides.items() if present]
    wrong_unit = unit is not None and unit.quantity != measured
    if held - known or held & _UNCLEAR_LENGTHS or len(stated) > 1 or wrong_unit:
        return Meaning("", unit, measured, target)
    side = f"_{stated[0]}" if stated else ""
    if target:
        wanted = {"force": "tension_out_target", "displacement": "displacement_target"}.get(quantity, "")
        return Meaning(wanted if side != "_in" else "", unit, measured, True)
    if quantity in ("temperature", "time", "elongation"):
        return Meaning(quantity, unit, measured)
    channel = {"force": "tension", "displacement": "displacement"}[quantity] + side if side else quantity
    return Meaning(channel, unit, measured)


_WORDS_OF = {
    "force": _FORCES,
    "displacement": _LENGTHS | _UNCLEAR_LENGTHS,
    "elongation": _ELONGATIONS,
    "temperature": _TEMPERATURES | {"t"},
    "time": _TIMES | {"s"},
}
_BY_UNIT = {FORCE: "force", LENGTH: "displacement", TEMPERATURE: "temperature", OF_TIME: "time"}


def _quantity_of(held: set[str], stem: str, unit: Unit | None) -> str | None:
    """Return what a column measures by its words and its unit; the letter t is a time, a tension or °C."""
    if "t" in held:
        sided = bool(held & (_IN | _OUT))
        by_unit = _BY_UNIT.get(unit.quantity) if unit else None
        if by_unit in ("force", "temperature", "time"):
            return by_unit
        if unit is None and len(held) == 1:
            return "time" if "t" in stem else "force"
        return "force" if sided else None
    for quantity in ("elongation", "displacement", "force", "temperature", "time"):
        if held & _WORDS_OF[quantity] and not (quantity == "time" and held == {"s"}):
            return quantity
    if unit is not None and held and held <= _IN | _OUT:
        return _BY_UNIT.get(unit.quantity)
    return None
