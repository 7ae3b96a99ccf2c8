"""Campaign folders: what is read, what is noted, and what is refused with the file that is at fault."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tssgeom.effects import HiddenBend
from tssgeom.errors import SettingsError, ShapeError, SourceError, TssgeomError
from tssgeom.identify.readings import readings
from tssgeom.io.formats.campaigns import read_campaign
from tssgeom.io.formats.files import find_inputs
from tssgeom.rig import Sensor

LISTED = '[[run]]\nname = "{name}"\ndata = "{name}.csv"\nshape = "{shape}"\n'
ROWS = 60


def half_circle(count: int = 40) -> np.ndarray:
    """Points on a half circle of 500 mm [mm]."""
    angle = np.linspace(0.0, math.pi, count)
    return 500.0 / math.pi * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def pulled() -> dict[str, np.ndarray]:
    """A pull and a release on a half circle without pretension; the numbers of the pull are the paper's."""
    pull = np.linspace(0.0, 15.0, ROWS // 2)
    tension = np.concatenate([pull, pull[::-1]])
    released = np.minimum(0.6341 * 15.0, tension / 0.6341)
    distal = np.where(np.arange(ROWS) < len(pull), 0.6341 * tension, released)
    return {
        "time_s": np.arange(float(ROWS)),
        "tension_in_N": tension,
        "tension_out_N": distal,
        "elongation_m": 1.9036e-3 / 15.0 * (tension + distal) / 1.6341,
    }


def table(path: Path, columns: dict[str, np.ndarray]) -> None:
    cells = np.column_stack(list(columns.values()))
    np.savetxt(path, cells, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two runs on one shape, a third on another."""
    home = tmp_path / "bench"
    home.mkdir()
    for shape in ("half.csv", "other.csv"):
        table(home / shape, dict(zip(("x_mm", "y_mm", "z_mm"), half_circle().T, strict=True)))
    for name in ("one", "two", "three"):
        table(home / f"{name}.csv", pulled())
    runs = [LISTED.format(name=name, shape="half.csv") for name in ("one", "two")]
    runs += [LISTED.format(name="three", shape="other.csv"), "held_out = true\n"]
    (home / "campaign.toml").write_text('rig = "rig.toml"\n' + "".join(runs))
    (home / "rig.toml").write_text("[friction]\ncoefficient = 0.2\n")
    return home


def test_runs_routes_and_rig_arrive(folder):
    campaign = read_campaign(folder)
    assert (campaign.name, campaign.rig.friction.coefficient, campaign.notes) == ("bench", 0.2, ())
    assert [(run.name, run.route.name, run.held_out) for run in campaign.runs] == [
        ("one", "half", False),
        ("two", "half", False),
        ("three", "other", True),
    ]
    first, second, third = campaign.runs
    assert first.route is second.route
    assert third.route is not second.route
    assert first.route.arcs.total_angle == pytest.approx(math.pi, rel=1e-3)  # 40 exact points, fitted
    np.testing.assert_allclose(first.columns["tension_in_N"], pulled()["tension_in_N"], rtol=1e-8)


def test_the_listing_itself_may_be_named(folder):
    assert read_campaign(folder / "campaign.toml").name == "bench"


def test_elongation_in_millimetres_arrives_in_metres(folder):
    columns = pulled()
    columns["elongation_mm"] = 1e3 * columns.pop("elongation_m")
    table(folder / "one.csv", columns)
    arrived = read_campaign(folder).runs[0].columns
    np.testing.assert_allclose(arrived["elongation_m"], pulled()["elongation_m"], rtol=1e-8)


def test_effects_of_the_rig_arrive_and_do_not_touch_the_route(folder):
    effect = '\n[[effects]]\nname = "hidden_bend"\nat_m = 0.2\nangle_rad = 0.5\n'
    plain = read_campaign(folder).runs[0].route.arcs.total_angle
    (folder / "rig.toml").write_text((folder / "rig.toml").read_text() + effect)
    campaign = read_campaign(folder)
    assert campaign.rig.effects == (HiddenBend(at_m=0.2, angle_rad=0.5),)
    assert campaign.runs[0].route.arcs.total_angle == plain


def test_of_a_recording_the_first_usable_frame_is_taken_and_noted(folder):
    points = half_circle().tolist()
    frames = [{"t": 0.0, "points": points[:2]}, {"t": 1.0, "points": points}, {"t": 2.0, "points": points}]
    lines = "\n".join(json.dumps(frame | {"unit": "mm"}) for frame in frames)
    (folder / "moving.jsonl").write_text(lines + "\n")
    listing = folder / "campaign.toml"
    listing.write_text(listing.read_text().replace("other.csv", "moving.jsonl"))
    (note,) = read_campaign(folder).notes
    assert note.startswith("moving.jsonl has 3 frames")
    assert "frame 1" in note


def test_missing_values_and_unknown_sensors_are_noted(folder):
    columns = pulled()
    columns["tension_out_N"][3:7] = np.nan
    table(folder / "two.csv", columns)
    (folder / "rig.toml").write_text(
        "[sensors.tension]\nnoise = 0.1\n[sensors.tension_in_N]\nfull_scale = 12.0\n"
    )
    campaign = read_campaign(folder)
    notes = campaign.notes
    assert any("[sensors.tension] is no channel" in note for note in notes)
    assert any(note.startswith("two: tension_out_N is missing in 4 of 60 rows") for note in notes)
    assert any(note.startswith("one: tension_in_N reaches 15 N and its full scale is 12 N") for note in notes)
    assert sum("missing" in note for note in {*readings(campaign)[1]}) == 1  # fit and reader say it alike


def test_sensors_are_known_by_short_names_and_in_millimetres(folder):
    (folder / "rig.toml").write_text(
        "[sensors.tension_in]\nnoise = 0.1\nfull_scale = 20.0\n"
        "[sensors.elongation_mm]\nnoise = 0.02\nresolution = 0.01\nnonlinearity = 0.001\n"
        "[sensors.tension_out]\nnoise = 0.5\n[sensors.tension_out_N]\nnoise = 0.2\n"
    )
    campaign = read_campaign(folder)
    assert campaign.notes == ()
    assert campaign.rig.sensors == {
        "tension_in_N": Sensor(noise=0.1, full_scale=20.0),
        "elongation_m": Sensor(noise=0.02 / 1000.0, resolution=0.01 / 1000.0, nonlinearity=0.001),
        "tension_out_N": Sensor(noise=0.2),
    }


def test_a_stretch_a_thousand_times_too_small_is_noted(folder):
    table(folder / "one.csv", pulled() | {"elongation_m": 1e-3 * pulled()["elongation_m"]})
    (note,) = read_campaign(folder).notes
    assert "check its unit" in note


@pytest.mark.parametrize(
    ("listing", "said"),
    [
        ('[[run]]\ndata = "one.csv"\nshape = "half.csv"\nheld = true\n', r"campaign\.toml.*`held`.*run\[0"),
        ('[[run]]\ndata = "one.csv"\n', r"campaign\.toml.*`shape`.*run\[0\]"),
        ("run = []\n", r"campaign\.toml: no run"),
        ("[[run]\n", r"campaign\.toml"),
        ('[[run]]\ndata = "one.csv"\nshape = "half.csv"\n' * 2, r"two runs are called 'one'"),
        ('[[run]]\ndata = "one.csv"\nshape = "half.csv"\nheld_out = true\n', r"every run is held out"),
        ('[[run]]\ndata = "none.csv"\nshape = "half.csv"\n', r"none\.csv: no such file"),
        ('[[run]]\ndata = "one.csv"\nshape = "none.csv"\n', r"none\.csv: no such file"),
        (f'[[run]]\ndata = "{300 * "n"}.csv"\nshape = "half.csv"\n', r"n\.csv: no such file"),
        (f'[[run]]\ndata = "one.csv"\nshape = "{300 * "n"}"\n', r"nnn: no such file"),
        ('rig = "none.toml"\n[[run]]\ndata = "one.csv"\nshape = "half.csv"\n', r"none\.toml"),
    ],
)  # fmt: skip
def test_a_wrong_listing_is_refused_in_one_line(folder, listing, said):
    (folder / "campaign.toml").write_text(listing)
    with pytest.raises(TssgeomError, match=said) as reported:
        read_campaign(folder)
    assert "\n" not in str(reported.value)


def kept(*names: str) -> dict[str, np.ndarray]:
    return {name: values for name, values in pulled().items() if name in ("time_s", *names)}


def apart() -> dict[str, np.ndarray]:
    """Two recorders that took turns."""
    columns = pulled()
    columns["tension_in_N"][30:] = np.nan
    columns["tension_out_N"][:30] = np.nan
    columns["elongation_m"][:30] = np.nan
    return columns


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (kept("tension_out_N", "elongation_m"), "no drive"),
        (kept("tension_in_N"), "a drive without a response"),
        (apart(), "on one clock"),
        (pulled() | {"elongation_m": 1e3 * pulled()["elongation_m"]}, "check its unit.*elongation_mm"),
        (pulled() | {"tension_in_N": 1e3 * pulled()["tension_in_N"]}, "give newtons"),
        (pulled() | {"temperature_C": np.full(ROWS, 295.0)}, "not kelvin"),
        (pulled() | {"displacement_in_m": np.linspace(0.0, 12.0, ROWS)}, "give metres"),
        (pulled() | {"tension_in_mN": np.linspace(0.0, 12.0, ROWS)}, "'tension_in_mN' is tension_in_N too"),
        (kept("elongation_m") | {"tension_in": 1e3 * pulled()["tension_in_N"]}, "no unit.*tension_in_N:mN"),
    ],
)  # fmt: skip
def test_a_run_that_cannot_serve_is_refused_by_name(folder, columns, said):
    table(folder / "two.csv", columns)
    with pytest.raises((SettingsError, ShapeError), match=rf"two\.csv: .*{said}"):
        read_campaign(folder)


def test_a_tension_far_beyond_full_scale_is_refused(folder):
    (folder / "rig.toml").write_text("[sensors.tension_in_N]\nfull_scale = 4.0\n")
    with pytest.raises(SettingsError, match=r"one\.csv: tension_in_N reaches 15 N.*full scale is 4 N"):
        read_campaign(folder)


def test_no_folder_and_no_listing_are_refused(tmp_path):
    with pytest.raises(SourceError, match="no such folder"):
        read_campaign(tmp_path / "none")
    with pytest.raises(SourceError, match=r"campaign\.toml"):
        read_campaign(tmp_path)


def test_a_shape_without_unit_needs_one_from_outside(folder):
    table(folder / "half.csv", dict(zip("xyz", half_circle().T, strict=True)))
    with pytest.raises(ShapeError, match=r"half\.csv"):
        read_campaign(folder)
    assert read_campaign(folder, "mm").runs[0].route.arcs.total_length == pytest.approx(0.5, rel=1e-3)


def test_a_campaign_is_no_folder_of_shapes(folder):
    with pytest.raises(SourceError, match="no shape file"):
        find_inputs([folder])
    assert find_inputs([folder / "half.csv"]) == [folder / "half.csv"]
