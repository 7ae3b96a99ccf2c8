"""The picture of a machine: tendons side by side, and names, colours and plots of their channels."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.view.conftest import analysed
from tests.view.recorded import axes, columns, spans, verify, views
from tssgeom.rig import Rig
from tssgeom.stream import Frame
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulated
from tssgeom.view.colours import tension_rgba32
from tssgeom.view.samples import route_samples
from tssgeom.view.scene.machine import write_machine_recording

TIME = np.linspace(0.0, 10.0, 41)
PAIR = """
tendon.pretension_N = 6.0
drive = { kind = "pair", radius_m = 0.01 }
end = { kind = "joint", radius_m = 0.008, stiffness_Nm_per_rad = 0.2 }
"""
GEARED = """
tendon.pretension_N = 4.0
drive = { radius_m = 0.01, gear = 50.0 }
end = { kind = "joint", radius_m = 0.006, stiffness_Nm_per_rad = 0.05 }
"""
SEGMENT = """
tendon.pretension_N = 3.0
drive.kind = "tendons"
[end]
kind = "segment"
radius_m = 0.004
tendon_angles_deg = [0, 120, 240]
stiffness_Nm_per_rad = 0.02
length_m = 0.06
"""


def half_circle() -> np.ndarray:
    angle = np.linspace(0.0, np.pi, 80)
    return 0.15 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle])


def recorded(folder: Path, rig: str, **drive: np.ndarray) -> Path:
    (result,) = analysed([Frame(half_circle())])
    machine = machine_of(msgspec.toml.decode(rig, type=Rig), [result.arcs], 30)
    out = simulated(machine, {"time_s": TIME, **drive}, profile=True)
    path = folder / "run.rrd"
    routes = [route_samples(result)] * machine.count
    assert out.tension is not None
    write_machine_recording(path, "run", machine, routes, TIME, out.channels, out.tension)
    return path


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("pair"), PAIR, motor_angle_rad=0.5 * np.sin(TIME))


def line(path: Path, tendon: int) -> np.ndarray:
    strips = columns(path, f"/tendon/{tendon}", timed=True)["LineStrips3D:strips"][0]
    return np.array([strip[0] for strip in strips])


def test_tendons_on_one_route_lie_side_by_side_and_never_one_upon_another(pair: Path) -> None:
    verify(pair)
    one, other = line(pair, 1), line(pair, 2)
    apart, along = other - one, np.gradient(one, axis=0)
    gap = np.linalg.norm(apart, axis=1)
    np.testing.assert_allclose(gap, gap.mean(), rtol=0.02)  # single precision, and ends by one side only
    slanted = np.abs(np.sum(apart * along, axis=1)) / gap / np.linalg.norm(along, axis=1)
    assert slanted.max() < 0.05  # noise of the route


def test_ends_are_named_as_the_lines_of_the_plots_and_in_their_colours(pair: Path) -> None:
    labels = columns(pair, "/labels", timed=True)["Points3D:labels"][0]
    shades = columns(pair, "/labels", timed=False)["Points3D:colors"][0]
    names = [label.rpartition(" ")[0].partition(" ")[0] for label in labels]
    assert names == ["T_in,1", "T_out,1", "T_in,2", "T_out,2"]
    for name, shade in zip(names, shades, strict=True):
        end, number = name.removeprefix("T_").split(",")
        style = columns(pair, f"/series/tension_{end}_{number}_N", timed=False)
        assert style["SeriesLines:names"] == [[f"{name} [N]"]]
        assert style["SeriesLines:colors"] == [[shade]]
    hand, angle = (
        columns(pair, entity, timed=False)[f"{kind}:colors"]
        for entity, kind in (("/joint/hand", "LineStrips3D"), ("/series/joint_angle_rad", "SeriesLines"))
    )
    assert hand == angle


def test_a_bar_has_the_colours_of_the_tendons_from_0_to_their_top(pair: Path) -> None:
    top = max(
        value
        for name in ("in_1", "in_2", "out_1", "out_2")
        for (value,) in columns(pair, f"/series/tension_{name}_N", timed=True)["Scalars:scalars"]
    )
    (texts,) = columns(pair, "/scale/tension/ends", timed=False)["Points3D:labels"]
    assert texts == ["0 N", f"{top:.1f} N"]
    bar = columns(pair, "/scale/tension", timed=False)["LineStrips3D:colors"][0]
    rows = columns(pair, "/tendon/1", timed=True)["LineStrips3D:colors"]
    assert {shade for row in rows for shade in row} & set(bar)
    assert bar[-1] == int(tension_rgba32(np.array([top]), top)[0])


def test_tensions_have_one_scale_from_0_and_legends_stand_before_the_run(pair: Path) -> None:
    assert len({tuple(each) for each in axes(pair)}) == 1
    assert all(low < 0.0 < high for low, high in axes(pair))
    assert spans(pair)
    assert all(begin < 0.0 and end == TIME[-1] for begin, end in spans(pair))


def test_a_motor_with_a_gear_does_not_flatten_the_joint(pair: Path, tmp_path: Path) -> None:
    geared = recorded(tmp_path, GEARED, motor_angle_rad=25.0 * np.abs(np.sin(TIME)))
    assert views(pair).count("TimeSeries") == 4  # of both angles one
    assert views(geared).count("TimeSeries") == 5


def test_the_tip_of_a_segment_is_plotted(tmp_path: Path) -> None:
    drive = {f"displacement_in_{k + 1}_m": 2e-3 * np.sin(TIME + 2.1 * k) for k in range(3)}
    path = recorded(tmp_path, SEGMENT, **drive)
    for axis in "xyz":
        style = columns(path, f"/series/tip_{axis}_m", timed=False)
        assert style["SeriesLines:names"] == [[f"{axis}_tip [mm]"]]
