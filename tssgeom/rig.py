"""The rig: tendon, friction, load and sensors, held alike from Python and from a TOML file."""

import itertools
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import tomli_w

from tssgeom.atomic import write_text
from tssgeom.effects import AnyEffect, wrong_effect
from tssgeom.errors import SettingsError, printable, require, require_at_least_zero, require_file
from tssgeom.mechanism import Drive, End, GivenRoute, is_machine, require_effects
from tssgeom.toml_keys import with_choices, with_short_keys, without_none
from tssgeom.uncertain import (
    CERTAIN,
    Follow,
    RigErrors,
    Uncertain,
    Unexplained,
    change,
    parted,
    require_known,
)

Source = Literal["markers", "em", "fbg", "centreline", "smoothed"]
"""Where the points of a route come from; docs/model.md (164)."""

_LEAST_RADIUS = 5.0  # of a sheath where it is not known [diameters]; chosen: coils kink below
_MOST_BYTES = 1 << 20  # of a rig file: more is none
_QUOTED = re.compile(r'"(\{ value = [^"]* \})"')  # a number with its error


class Tendon(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Elastic properties of the tendon; the defaults are the paper's (section III-B)."""

    compliance_per_N: float = 3.16e-4
    """Strain per tension, 1/EA [1/N]."""
    pretension_N: float = 0.0
    """Tension all along the tendon before the first pull [N]."""

    def __post_init__(self) -> None:
        require_at_least_zero("tendon.compliance_per_N", self.compliance_per_N, "1/N")
        require_at_least_zero("tendon.pretension_N", self.pretension_N, "N")


class Friction(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Coulomb friction between tendon and sheath; the default is the paper's (section III-B)."""

    coefficient: float = 0.145
    """Coefficient of friction [1]."""

    def __post_init__(self) -> None:
        require_at_least_zero("friction.coefficient", self.coefficient, "")


class Load(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the distal end pulls against."""

    stiffness_N_per_m: float = 1000.0
    """Stiffness of the distal spring [N/m]."""

    def __post_init__(self) -> None:
        require_at_least_zero("load.stiffness_N_per_m", self.stiffness_N_per_m, "N/m")


class Sensor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Specification of one measuring channel, in the unit of that channel."""

    noise: float = 0.0
    """Standard deviation of white noise."""
    resolution: float = 0.0
    """Size of one digital step."""
    full_scale: float = 0.0
    """Largest value that the channel reads; 0 where not known."""
    nonlinearity: float = 0.0
    """Largest deviation from a straight line, as a fraction of full scale [1]."""
    zero: float = 0.0
    """What the channel of a machine reads where it should read 0."""
    gain: float = 1.0
    """What the channel of a machine reads for 1 above its zero [1]."""
    lag_s: float = 0.0
    """Time constant with which the channel of a machine follows [s]."""
    drift_per_s: float = 0.0
    """By how much the channel of a machine reads more, each second of a run [1/s]; what a run answers, not
    what drives it."""
    drift_time_s: float = 0.0
    """Time constant with which this drift ends, as that of a cell that warms up [s]; 0 where it goes on."""

    @property
    def reading_noise(self) -> float:
        """Standard deviation of one reading, of noise and digits, as stated; 0 where nothing is."""
        return math.hypot(self.noise, self.resolution / math.sqrt(12.0))

    def __post_init__(self) -> None:
        for name in ("noise", "resolution", "full_scale", "nonlinearity", "lag_s", "drift_time_s"):
            require_at_least_zero(f"sensors.*.{name}", getattr(self, name), "")
        for name in ("zero", "drift_per_s"):
            value = getattr(self, name)
            require(math.isfinite(value), f"sensors.*.{name}", value, "give a finite value")
        usable = math.isfinite(self.gain) and self.gain != 0.0
        require(usable, "sensors.*.gain", self.gain, "give a finite value that is not 0")


class Sheath(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The sheath, which cannot follow a short wave."""

    diameter_mm: float | None = None
    """Outer diameter [mm]."""
    least_radius_mm: float | None = None
    """Least bend radius [mm]; left out, it follows from the diameter."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            if (value := getattr(self, name)) is not None:
                remedy = "give a finite value > 0 mm, or leave it out"
                require(math.isfinite(value) and value > 0, f"sheath.{name}", value, remedy)

    @property
    def shortest_wave(self) -> float | None:
        """Shortest wave that it can follow [m]; docs/model.md (163)."""
        if self.least_radius_mm is not None:
            return math.pi * (1e-3 * self.least_radius_mm)
        return None if self.diameter_mm is None else math.pi * (_LEAST_RADIUS * (1e-3 * self.diameter_mm))


class ShapeSensor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Specification of whatever senses the route."""

    noise_mm: float | None = None
    """Standard deviation of each coordinate [mm]; left out, it is estimated from the points, as where more
    than 40 of them contradict it."""
    curvature_noise_per_m: float | None = None
    """Standard deviation of each curvature component of a fibre [1/m]; left out, it is estimated."""
    direction_noise_deg: float | Literal["estimate"] | None = None
    """Standard deviation of a component of a sensed direction [deg], or that it is to be estimated; left out,
    directions are not used."""
    length_noise_mm: float = 1.0
    """Standard deviation of the stated length of a route [mm]."""
    angle_gain_sd: float = 0.0
    """Standard deviation of a common scale error of all sensed angles [1]."""
    marker_offset_mm: tuple[tuple[float, float, float], ...] = ()
    """Where each marker sits beside the centre line: along two axes across the route, then along it [mm]."""
    marker_axis: tuple[float, float, float] | None = None
    """Direction of the first axis at the first marker, in the coordinates of the points; left out, it is
    estimated."""
    time_filter: bool = True
    """Whether the points of a stream are filtered in time before a route is fitted."""
    order: Literal["given", "shortest"] = "given"
    """Whether the points are in order, or to be put in that of the shortest path through them."""
    source: Source | None = None
    """Where the points come from: by it errors that neighbours share are counted. A file may state it too."""
    resolution_mm: float | None = None
    """Length of the shortest wave of the route that counts [mm]; left out, that of sheath or source."""

    def __post_init__(self) -> None:
        for name, unit in (("noise_mm", "mm"), ("curvature_noise_per_m", "1/m"), ("resolution_mm", "mm")):
            value = getattr(self, name)
            if value is not None:
                remedy = f"give a finite value > 0 {unit}, or leave it out"
                require(math.isfinite(value) and value > 0, f"shape.{name}", value, remedy)
        if isinstance(turn := self.direction_noise_deg, float | int):
            remedy = "give a value > 0 deg and < 90 deg, or leave it out where no directions are sensed"
            require(0 < turn < 90, "shape.direction_noise_deg", turn, remedy)
        require_at_least_zero("shape.length_noise_mm", self.length_noise_mm, "mm")
        require_at_least_zero("shape.angle_gain_sd", self.angle_gain_sd, "")
        for value in (*itertools.chain.from_iterable(self.marker_offset_mm), *(self.marker_axis or ())):
            require(
                math.isfinite(value), "shape.marker_offset_mm or marker_axis", value, "give finite numbers"
            )
        if self.marker_axis is not None and not any(self.marker_axis):
            raise SettingsError(
                "shape.marker_axis has no direction: give one across the route, or leave it out"
            )
        if self.marker_axis is not None and not self.marker_offset_mm:
            raise SettingsError("shape.marker_axis without shape.marker_offset_mm: give both, or neither")

    @property
    def noise(self) -> float | None:
        """Standard deviation of each coordinate [m], or None where it is to be estimated."""
        return None if self.noise_mm is None else 1e-3 * self.noise_mm

    @property
    def direction_noise(self) -> float | None:
        """Standard deviation of a component of a sensed direction [rad], or None where not stated."""
        stated = self.direction_noise_deg
        return math.radians(stated) if isinstance(stated, float | int) else None

    @property
    def length_noise(self) -> float:
        """Standard deviation of the stated length of a route [m]."""
        return 1e-3 * self.length_noise_mm

    @property
    def resolution(self) -> float | None:
        """Length of the shortest wave of the route that counts [m], or None where it is not stated."""
        return None if self.resolution_mm is None else 1e-3 * self.resolution_mm


class Rig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything about the hardware that the model needs; the defaults are the paper's."""

    tendon: Tendon = Tendon()
    """Compliance and pretension."""
    friction: Friction = Friction()
    """Friction in the sheath."""
    load: Load = Load()
    """The spring at the distal end."""
    sensors: dict[str, Sensor] = {}
    """Noise and limits of each sensor, by the name of its channel."""
    shape: ShapeSensor = ShapeSensor()
    """The sensor of the route."""
    sheath: Sheath = Sheath()
    """Diameter and least radius of the sheath."""
    drive: Drive = Drive()
    """What drives the tendons, and its limits."""
    end: End = End()
    """What the tendons move."""
    route: GivenRoute = GivenRoute()
    """The route where no shape is sensed."""
    effects: tuple[AnyEffect, ...] = ()
    """What else acts, beside the base model; docs/model.md (50)-(62)."""
    unexplained: Unexplained = Unexplained()
    """What the model is known to be off by; docs/model.md (354)."""
    adapt: dict[str, Follow] = {}
    """Numbers that `--adapt` follows, by key; model.md (200)."""
    columns: dict[str, str] = {}
    """What columns of measured files are, `channel[:unit]` by name."""

    def __post_init__(self) -> None:
        require_effects(self.drive, self.end, self.effects)

    @property
    def is_machine(self) -> bool:
        """Whether it has more than one tendon, or an end other than a spring."""
        return is_machine(self.drive, self.end)


def read_rig(path: str | Path) -> Rig:
    """Read a rig from a TOML file; of a number with an error, its value.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Rig
        What it holds; the paper's numbers where it holds none.

    Raises
    ------
    SettingsError
        As `read_uncertain_rig`, and where a number is "unknown".

    Examples
    --------
    >>> from tssgeom import read_rig
    >>> read_rig("sample_shapes/campaign_clean/rig.toml").friction.coefficient
    0.145
    """
    rig, uncertain = read_uncertain_rig(path)
    require_known(path, uncertain)
    return rig


def read_uncertain_rig(path: str | Path) -> tuple[Rig, tuple[Uncertain, ...]]:
    """Read a rig, and what of it is not certain; docs/model.md (179).

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    tuple
        The rig, and its numbers that are unknown or have an error.

    Raises
    ------
    SettingsError
        Where the file is missing, is no TOML, or holds an unknown key or a value out of bounds.

    Examples
    --------
    >>> from tssgeom import read_uncertain_rig
    >>> rig, uncertain = read_uncertain_rig("sample_shapes/campaign_clean/rig.toml")
    >>> uncertain
    ()
    """
    tables: dict[str, Any] = {}
    require_file(Path(path))
    try:
        with open(path, "rb") as file:
            content = file.read(_MOST_BYTES + 1)
        require(len(content) <= _MOST_BYTES, "its size", len(content), f"at most {_MOST_BYTES} bytes")
        tables, uncertain = parted(tomllib.loads(with_short_keys(content).decode("utf-8-sig")))
        return msgspec.convert(tables, Rig), uncertain
    except OSError as error:
        raise SettingsError(f"{path}: cannot read the rig file ({error.strerror}): check the path") from error
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        if isinstance(error, SettingsError):
            raise SettingsError(f"{path}: {error}") from error
        reported = wrong_effect(tables) if "$.effects" in str(error) else with_choices(str(error), Rig())
        raise SettingsError(f"{path}: {reported}: mend the rig file (docs/formats.md, Rig)") from error


def with_values(rig: Rig, values: Mapping[str, float]) -> Rig:
    """Return a rig with some of its numbers changed, by key; SettingsError where one is out of bounds."""
    tables = msgspec.to_builtins(rig, enc_hook=float)  # fits give numpy's floats
    for key, value in values.items():
        change(tables, key, lambda _, value=value: float(value))
    try:
        return msgspec.convert(tables, Rig)
    except msgspec.ValidationError as error:
        raise SettingsError(str(error)) from error


def write_rig(path: Path, rig: Rig, provenance: Sequence[str] = (), errors: RigErrors = CERTAIN) -> None:
    """Write a rig as TOML, which `read_rig` reads back alike.

    Parameters
    ----------
    path, rig
        The file, and what it is to hold.
    provenance, errors
        Origin of its numbers, a comment line each, and their errors, as `read_uncertain_rig` reads them.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    comments = "".join(f"# {printable(' '.join(line.split()))}\n" for line in provenance)
    tables = without_none(msgspec.to_builtins(rig, enc_hook=float) | {"unexplained": rig.unexplained.given()})
    errors.state(tables)
    for name in ("drive", "end", "route"):
        if getattr(rig, name) == getattr(Rig(), name):
            del tables[name]
    for sensor in tables.get("sensors", {}).values():
        for name in ("zero", "gain", "lag_s", "drift_per_s", "drift_time_s"):
            if sensor[name] == getattr(Sensor(), name):
                del sensor[name]
    write_text(path, comments + "\n" * bool(comments) + _QUOTED.sub(r"\1", tomli_w.dumps(tables)))
