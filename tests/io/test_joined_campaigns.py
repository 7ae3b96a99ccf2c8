"""New runs beside those of a campaign: their routes, their names, what is held out, and what is refused."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tests.campaigns import make_campaign
from tssgeom.errors import SettingsError
from tssgeom.identify.readings import readings
from tssgeom.io.formats.campaigns import read_campaign
from tssgeom.io.formats.joined_campaigns import with_runs

PROPOSED = """
[[run]]
data = "run_1.csv"
route = "route_2"
drive = "displacement_in_m"
corner_time_s = [0.0, 1.0, 5.0]
corners = [0.0, 0.0, 3e-3]
"""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    room = tmp_path_factory.mktemp("joined")
    make_campaign(room / "campaign", 4)
    return room


@pytest.fixture(scope="module")
def campaign(room):
    return read_campaign(room / "campaign")


def folder_with(tmp_path: Path, **files: str | Path) -> Path:
    folder = tmp_path / "new"
    folder.mkdir()
    for name, content in files.items():
        path = folder / name.replace("_dot_", ".")
        if isinstance(content, Path):
            shutil.copy(content, path)
        else:
            path.write_text(content, "utf-8")
    return folder


def test_a_run_goes_on_the_route_that_was_proposed_and_another_drive_is_named(room, campaign, tmp_path):
    run = room / "campaign" / "run_1.csv"
    folder = folder_with(tmp_path, run_1_dot_csv=run, proposal_dot_toml=PROPOSED)
    joined = with_runs(campaign, folder)
    assert [one.name for one in joined.runs][-1] == "new_run_1"
    assert joined.runs[-1].route is campaign.runs[2].route
    assert any("not the proposed one; it counts" in note for note in joined.notes)
    assert [run.held_out for run in joined.runs] == [False] * 4 + [True, False]


def test_runs_that_a_campaign_file_lists_share_the_routes_whose_shapes_are_the_same(room, campaign, tmp_path):
    pairs = (("again.csv", "bent.csv"), ("run_1.csv", "route_1.csv"))
    listing = "".join(f'[[run]]\ndata = "{data}"\nshape = "{shape}"\n' for data, shape in pairs)
    home = room / "campaign"
    folder = folder_with(
        tmp_path,
        campaign_dot_toml=listing,
        again_dot_csv=home / "run_3.csv",
        bent_dot_csv=home / "route_2.csv",
        run_1_dot_csv=home / "run_5.csv",
        route_1_dot_csv=home / "route_3.csv",
    )
    again, other = with_runs(campaign, folder).runs[5:]
    assert (again.name, again.route) == ("again", campaign.runs[2].route)
    assert (other.name, other.route) == ("new_run_1", campaign.runs[4].route)


def test_the_run_that_was_held_out_stays_held_out_and_no_new_one_is(room, campaign, tmp_path):
    free = replace(campaign, runs=tuple(replace(run, held_out=False) for run in campaign.runs))
    folder = folder_with(tmp_path, run_1_dot_csv=room / "campaign" / "run_1.csv", proposal_dot_toml=PROPOSED)
    joined = with_runs(free, folder)
    held = [run.name for run in readings(joined)[0] if run.held_out]
    assert held == [run.name for run in readings(free)[0] if run.held_out] == ["run_5"]
    alone = with_runs(replace(free, runs=free.runs[2:3]), folder)
    assert not any(run.held_out for run in readings(alone)[0])


def test_a_folder_is_joined_once(room, campaign, tmp_path):
    folder = folder_with(tmp_path, run_1_dot_csv=room / "campaign" / "run_1.csv", proposal_dot_toml=PROPOSED)
    with pytest.raises(SettingsError, match="name each folder once"):
        with_runs(with_runs(campaign, folder), folder)


def test_a_run_that_was_proposed_on_another_route_needs_its_shape(room, campaign, tmp_path):
    elsewhere = PROPOSED.replace('"route_2"', '"lay the sheath nearly straight"')
    folder = folder_with(tmp_path, run_1_dot_csv=room / "campaign" / "run_1.csv", proposal_dot_toml=elsewhere)
    with pytest.raises(SettingsError, match="sense its shape, and list run and shape"):
        with_runs(campaign, folder)


def test_a_proposal_that_cannot_be_read_is_named(room, campaign, tmp_path):
    folder = folder_with(tmp_path, run_1_dot_csv=room / "campaign" / "run_1.csv", proposal_dot_toml="run = 3")
    with pytest.raises(SettingsError, match=r"proposal\.toml: .*write it anew"):
        with_runs(campaign, folder)
