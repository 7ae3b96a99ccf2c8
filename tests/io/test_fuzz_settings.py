"""Any rig, campaign, run, calibration, state, mesh or token gives its content, or an error of one line.

Each begins with a sound file of the corpus and cuts, joins and fills it. A saved state that is read has to
serve: it is stepped, and what it gives is finite.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.io.damage import damage, damaged, quick
from tssgeom.engine import process
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.cameras import read_cameras
from tssgeom.io.formats.campaigns import read_campaign
from tssgeom.io.formats.meshes import read_lumen, wall_of
from tssgeom.io.formats.runs import holds_run, read_run
from tssgeom.io.formats.states import read_state
from tssgeom.io.network.addresses import access
from tssgeom.lumen.clearance import clearance
from tssgeom.rig import read_rig
from tssgeom.route.synthetic import half_circle, positions
from tssgeom.stream import Frame, FrameResult
from tssgeom.tendon.saved import state_object

CORPUS = Path(__file__).parent / "corpus" / "settings"
POINTS = positions(half_circle(), np.linspace(0.0, 0.5, 20))
DEEP = b"a = " + b"[" * 3000


def reported(read: Callable[[], Any], name: str) -> Any:
    """What was read; None where an error of one line names the file."""
    try:
        return read()
    except TssgeomError as error:
        said = str(error)
    assert name in said
    assert len(said.splitlines()) == 1
    return None


def read_mesh(path: Path) -> None:
    mesh = read_lumen(path, "m")
    assert np.isfinite(mesh.vertices).all()
    wall_of(mesh)


READ: dict[str, Callable[[Path], object]] = {
    "rig.toml": read_rig,
    "campaign.toml": lambda path: read_campaign(path.parent),
    "run.csv": lambda path: (holds_run(path), read_run(path)),
    "cameras.toml": read_cameras,
    "cameras.json": read_cameras,
    "lumen.ply": read_mesh,
    "lumen.stl": read_mesh,
    "lumen.obj": read_mesh,
    "lumen.glb": read_mesh,
}


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A folder with the whole corpus, so that the campaign in it is sound."""
    shutil.copytree(CORPUS, tmp_path, dirs_exist_ok=True)
    np.savetxt(
        tmp_path / "points.csv", 1e3 * POINTS, delimiter=",", header="x_mm,y_mm,z_mm", comments="", fmt="%.6f"
    )
    return tmp_path


@pytest.mark.parametrize("name", sorted(READ))
def test_a_sound_file_is_read(campaign, name):
    READ[name](campaign / name)


@pytest.mark.parametrize("name", sorted(READ))
def test_a_damaged_file_is_read_or_refused(campaign, name):
    raw, path = (CORPUS / name).read_bytes(), campaign / name

    @quick
    @given(where=damage())
    @example(where=(0.0, 0.999999, b""))
    @example(where=(0.5, 0.999999, b""))
    def holds(where):
        path.write_bytes(damaged(raw, where))
        reported(lambda: READ[name](path), campaign.name)

    holds()


@pytest.mark.parametrize("name", sorted(READ))
def test_any_bytes_are_read_or_refused(campaign, name):
    @quick
    @given(raw=st.binary(max_size=200))
    @example(raw=b"")
    @example(raw=DEEP)
    @example(raw=b"[" * 100_000)
    @example(raw=b"\xef\xbb\xbf")
    @example(raw=b"time_s,tension_in_N\n0," + b"1" * 200_000 + b"\n")
    @example(raw=b'time_s,tension_in_N\n"0,1\n')
    def holds(raw):
        (campaign / name).write_bytes(raw)
        reported(lambda: READ[name](campaign / name), campaign.name)

    holds()


@st.composite
def changed(draw: st.DrawFn, saved: Any) -> Any:
    """Change, shorten or take out some part of an object."""
    unusual = st.sampled_from([None, 0, -1, 1e300, -1e300, 10**30, "x", [], {}, True, [[1.0]], [1.0, 2.0]])
    if draw(st.integers(0, 3)) == 0 or not isinstance(saved, dict | list) or not saved:
        return draw(unusual)
    if isinstance(saved, dict):
        key = draw(st.sampled_from(sorted(saved)))
        if draw(st.integers(0, 4)) == 0:
            return {name: value for name, value in saved.items() if name != key}
        return saved | {key: draw(changed(saved[key]))}
    at = draw(st.integers(0, len(saved) - 1))
    if draw(st.booleans()):
        return saved[:at]
    return [*saved[:at], draw(changed(saved[at])), *saved[at + 1 :]]


@pytest.mark.parametrize("today", [False, True], ids=["version 3", "today"])
@pytest.mark.parametrize("kind", ["corners", "bars", "effects"])
def test_a_damaged_state_serves_or_is_refused(tmp_path, kind, today):
    old, path = CORPUS / f"state_{kind}.json", tmp_path / "state.json"
    saved = state_object(read_state(old)) if today else json.loads(old.read_text())
    rig = read_rig(CORPUS / ("rig.toml" if kind == "effects" else "rig_of_the_paper.toml"))

    @quick
    @given(one=changed(saved))
    @example(one=saved)
    def holds(one):
        path.write_text(json.dumps(one))
        state = reported(lambda: read_state(path), "state.json")
        if state is None:
            assert json.dumps(one) != json.dumps(saved)
            return
        frames = [Frame(POINTS, 2.0, tension_in=9.0), Frame(POINTS, 3.0, displacement_in=1e-3)]
        for item in process(frames, rig, tension_in=9.0, state=state):
            if isinstance(item, FrameResult):
                assert np.isfinite([item.transmission.tension_out, item.transmission.elongation]).all()

    holds()


@quick
@given(raw=st.binary(max_size=60))
@example(raw=b"\xff" * 20)
@example(raw=b"a b c d e f g h i j k")
def test_any_token_file_is_taken_or_refused(tmp_path, raw):
    (tmp_path / "token").write_bytes(raw)
    reported(lambda: access(allow_remote=True, token_file=tmp_path / "token"), "token")


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1.0, 1e6, 1e300])
def test_a_mesh_of_any_size_gives_a_clearance_or_is_refused(campaign, scale):
    lines = (CORPUS / "lumen.obj").read_text().splitlines()
    corners = [[scale * float(x) for x in line.split()[1:]] for line in lines if line.startswith("v ")]
    rest = [line for line in lines if line.startswith("f ")]
    (campaign / "big.obj").write_text("\n".join([*("v {} {} {}".format(*one) for one in corners), *rest]))
    reported(lambda: clearance_in(campaign / "big.obj"), "big.obj")


def clearance_in(path: Path) -> None:
    (result,) = process([Frame(POINTS)], read_rig(CORPUS / "rig_of_the_paper.toml"), tension_in=5.0)
    assert isinstance(result, FrameResult)
    outcome = clearance(result.route, wall_of(read_lumen(path, "m")), 1e-3)
    assert outcome.least is None or np.isfinite(outcome.least)
