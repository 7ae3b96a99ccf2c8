"""Campaigns of the independent simulator, read once for all tests of the workflow."""

import tomllib
from functools import cache

import numpy as np
import pytest
import threadpoolctl

from tests.campaigns import make_campaign
from tssgeom.identify.campaign import Campaign, Route, Run
from tssgeom.identify.workflow import discover
from tssgeom.io.formats.files import open_recording
from tssgeom.rig import read_rig
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean


def read(folder):
    listed = tomllib.loads((folder / "campaign.toml").read_text())
    rig, routes, runs = read_rig(folder / listed["rig"]), {}, []
    for one in listed["run"]:
        name = one["shape"]
        if name not in routes:
            frame = next(iter(open_recording(folder / name).frames))
            shape = measure(clean(frame.points, frame.stations), rig.shape.noise)
            routes[name] = Route(name, shape.arcs, np.array(shape.route.position), np.array(shape.route.s))
        table = np.genfromtxt(folder / one["data"], delimiter=",", names=True)
        columns = {column: np.array(table[column]) for column in table.dtype.names}
        runs.append(Run(one["name"], routes[name], columns, one["held_out"]))
    return Campaign(folder.name, rig, tuple(runs))


@pytest.fixture(scope="session")
def campaign(tmp_path_factory):
    """A campaign and its truth, by seed, effect, size and plan."""
    room = tmp_path_factory.mktemp("discrepancy")

    @cache
    def made(seed, effect=None, size=1.0, plan="full"):
        folder = room / f"{seed}-{effect}-{size}-{plan}"
        truth = make_campaign(folder, seed, effect, size, plan)
        return read(folder), truth

    return made


@pytest.fixture(scope="session")
def result(campaign):
    """What the workflow finds in a campaign, while the share of its work grows to 1."""

    @cache
    def finding(seed, effect=None, size=1.0, plan="full"):
        shares = list[float]()
        made = discover(
            campaign(seed, effect, size, plan)[0], progress=lambda step, share: shares.append(share)
        )
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
        return made

    return finding


class StoppedError(Exception):
    """The work has gone as far as a test needs it."""


@pytest.fixture
def library_threads():
    """How many threads the libraries of linear algebra may use in the first step of a work."""

    def counted(work):
        counts = []

        def progress(step, share):
            counts.extend(one["num_threads"] for one in threadpoolctl.threadpool_info())
            raise StoppedError

        with threadpoolctl.threadpool_limits(limits=2), pytest.raises(StoppedError):
            work(progress)
        return set(counts)

    return counted
