"""Campaigns: one for each seed, readable, silent about their cause, clean where nothing is wrong."""

import ast
import dataclasses
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from pipelines.contents import checked
from tests.campaigns import INSIDE, OUTSIDE, PAIRS, PLANS, SEEDS, make_campaign
from tests.campaigns.instruments import SPECIFIED
from tests.campaigns.make import _rig, _run
from tests.campaigns.routes import positions
from tests.tendon.steps import pretensioned_bars, step
from tssgeom.io.formats.laboratory.mapping import NO_MAP
from tssgeom.rig import Friction, Load, Rig, Tendon, read_rig
from tssgeom.route.pieces import Arcs


def contents(folder):
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


def columns(file):
    return np.genfromtxt(file, delimiter=",", names=True)


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaigns") / "clean"
    return folder, make_campaign(folder, 4)


def test_campaigns_import_nothing_of_what_they_judge():
    for file in Path(__file__).parent.glob("*.py"):
        if not file.name.startswith("test_"):
            tree = ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            names = [node.module or "" for node in tree if isinstance(node, ast.ImportFrom)]
            assert not any(name.split(".")[0] in ("tssgeom", "pipelines") for name in names), file


def test_a_seed_gives_its_campaign_digit_by_digit(clean, tmp_path):
    folder, truth = clean
    assert make_campaign(tmp_path / "again", 4) == truth
    assert contents(tmp_path / "again") == contents(folder)
    make_campaign(tmp_path / "other", 5)
    assert contents(tmp_path / "other")["run_1.csv"] != contents(folder)["run_1.csv"]


def test_splits_share_no_rig(clean, tmp_path):
    _, truth = clean
    assert make_campaign(tmp_path / "test", 4, split="test").friction != truth.friction
    first, second = SEEDS.values()
    assert abs(first - second) >= 1_000_000
    with pytest.raises(ValueError, match="0 to 999999"):
        make_campaign(tmp_path / "far", 1_000_000)


def test_the_cause_is_beside_the_folder_and_not_in_it(tmp_path):
    truth = make_campaign(tmp_path / "c", 1, "backlash", size=0.5)
    reported = json.loads((tmp_path / "c.truth.json").read_text())
    assert (
        reported["parameters"]
        == truth.parameters
        == {"backlash": {"width_m": pytest.approx(7.5e-5, rel=0.15)}}
    )
    assert not any(b"backlash" in text or b"truth" in text for text in contents(tmp_path / "c").values())


def test_every_file_is_read_by_the_program(clean):
    folder, truth = clean
    listed = tomllib.loads((folder / "campaign.toml").read_text())
    assert read_rig(folder / listed["rig"]).sensors.keys() == SPECIFIED.keys()
    assert [run["held_out"] for run in listed["run"]] == [False] * 4 + [True]
    held = listed["run"][-1]["shape"]
    assert all(run["shape"] != held for run in listed["run"][:-1])
    for shape in {run["shape"] for run in listed["run"]}:
        report = checked(folder / shape, None, NO_MAP)
        assert report["wrong"] == []
        # chords of 150 points are short by 1e-4, noise of 0.2 mm makes some 0.5 mm
        assert report["length_m"] == pytest.approx(truth.length_m, abs=1e-3)


def test_a_plan_measures_what_it_says(clean, tmp_path):
    folder, _ = clean
    full = columns(folder / "run_1.csv").dtype.names
    assert len(full) == 6
    for plan, gone in (
        ("no_tension_out", {"tension_out_N"}),
        ("displacement_only", {"tension_in_N", "tension_out_N"}),
    ):
        make_campaign(tmp_path / plan, 4, plan=plan)
        assert set(full) - set(columns(tmp_path / plan / "run_1.csv").dtype.names) == gone
    make_campaign(tmp_path / "one_route", 4, plan="one_route")
    assert len(list((tmp_path / "one_route").glob("route_*.csv"))) == 1
    with pytest.raises(ValueError, match="one_rate"):
        make_campaign(tmp_path / "no", 4, plan="none")
    make_campaign(tmp_path / "round_turns", 4, plan="round_turns")
    for name, most in (("round_turns", 0.4), ("one_route", 2.1)):  # of the largest step, at its turns
        drive = columns(tmp_path / name / "run_1.csv")["displacement_in_m"]
        assert np.abs(np.diff(drive, 2)).max() < most * np.abs(np.diff(drive)).max()
    make_campaign(tmp_path / "force_driven", 4, plan="force_driven")
    ramp = columns(tmp_path / "force_driven" / "run_1.csv")["tension_in_N"][15:25]
    assert np.abs(np.diff(ramp, 2)).max() < 0.25  # noise of 0.02 N, six standard deviations
    assert len(PLANS) == 7


def test_a_full_plan_has_two_speeds_ten_times_apart_dwells_and_no_slack(clean):
    folder, _ = clean
    slow, fast = columns(folder / "run_1.csv"), columns(folder / "run_2.csv")
    speeds = [speed(run) for run in (slow, fast)]
    assert speeds[1] / speeds[0] == pytest.approx(10.0, rel=0.1)  # legs end at samples, of which they have 30
    dwell = columns(folder / "run_3.csv")
    still = (
        np.abs(dwell["displacement_in_m"] - np.max(dwell["displacement_in_m"])) < 5e-6
    )  # five times the noise
    assert np.sum(still) * np.diff(dwell["time_s"])[0] > 20.0
    runs = [columns(file) for file in folder.glob("run_*.csv")]
    assert min(run["tension_in_N"].min() for run in runs) > 1.0
    assert all(200 <= len(run) <= 400 for run in runs)


def test_points_of_a_chain_turn_and_reach_as_far_as_its_pieces():
    route = _rig(2, (), 1.0, "development").routes[2]
    total = route.lengths.sum()
    steps = np.diff(positions(route, np.linspace(0.0, total, 20_001), 1.0), axis=0)
    size = np.linalg.norm(steps, axis=1)
    way = steps / size[:, None]
    assert size.sum() == pytest.approx(total, rel=1e-6)  # chords are short by (κ ds)²/24
    turned = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    assert turned == pytest.approx(
        route.angles.sum(), abs=1e-3
    )  # half a step at each end; a kink would be 0.1


def speed(run):
    """Median while the drive moves."""
    observed = np.abs(np.diff(run["displacement_in_m"]) / np.diff(run["time_s"]))
    return np.median(observed[observed > 0.5 * observed.max()])


def test_names_inside_and_outside_are_apart_and_pairs_are_of_known_ones():
    assert len(INSIDE) == 25
    assert not INSIDE.keys() & OUTSIDE.keys()
    assert all({*pair} <= INSIDE.keys() and len({*pair}) == 2 for pair in PAIRS)


@pytest.mark.parametrize("name", [*INSIDE, *OUTSIDE])
def test_a_cause_shows_and_grows_with_its_size(name):
    rng = np.random.default_rng
    half, whole = ({**INSIDE, **OUTSIDE}[name](size, rng(3), 0.5) for size in (0.5, 1.0))
    (key, amplitude), *rest = whole.parameters.items()
    assert half.parameters[key] == pytest.approx(0.5 * amplitude)
    assert list(half.parameters.items())[1:] == rest
    assert dataclasses.replace(whole, parameters={}) != dataclasses.replace(half, parameters={})


@pytest.mark.parametrize("day", [0, 3, 4])
def test_a_clean_campaign_is_the_base_model_within_what_the_sensors_are_specified_for(clean, day):
    folder, truth = clean
    rig = _rig(4, (), 1.0, "development")
    route = rig.routes[(0, 0, 1, 1, 2)[day]]
    read = columns(folder / f"run_{day + 1}.csv")
    out = modelled(rig, route, _run(rig, day, "full").displacement_in)
    assert truth.effects == ()
    for name, model in zip(("tension_in_N", "tension_out_N"), out, strict=True):
        reported = SPECIFIED[name]
        # noise, the bend of the cell, drift and zero of the day, 0.01 N of the simulator's cells
        allowed = 4.0 * reported.noise + reported.nonlinearity * reported.full_scale + 0.02 + 0.01
        assert np.abs(read[name] - model).max() < allowed
        assert np.std(read[name] - model) > 0.5 * reported.noise


def modelled(rig, route, points):
    """Tension at both ends by the model that the workflow starts from, with the true coefficients."""
    believed = Rig(
        tendon=Tendon(compliance_per_N=rig.compliance, pretension_N=rig.believed.pretension_N),
        friction=Friction(coefficient=rig.friction),
        load=Load(stiffness_N_per_m=rig.distal.stiffness_N_per_m),
    )
    arcs = Arcs.exact(route.lengths, route.angles)
    states = [pretensioned_bars(believed, arcs)]
    for position in points:
        states.append(step(states[-1], arcs, believed, displacement_in=position))
    return np.array([(state.tension_in, state.tension_out) for state in states[1:]]).T
