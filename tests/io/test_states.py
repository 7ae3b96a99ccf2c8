"""A state on disk is whole, comes back to the last bit, and is refused where it is none."""

import json
import math
from pathlib import Path

import pytest

from tssgeom.errors import SettingsError, SourceError
from tssgeom.io.formats.states import read_state, write_state
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.saved import state_object
from tssgeom.tendon.state import pretensioned, step

CORPUS = Path(__file__).parent / "corpus" / "settings"

HALF_CIRCLE, BENT = Arcs.exact([0.5], [3.1]), Arcs.exact([0.2, 0.3], [1.0, 2.5])


def test_a_state_comes_back_from_disk_to_the_last_bit(tmp_path):
    corners = step(pretensioned(Rig()), HALF_CIRCLE, Rig(), tension_in=15.0)
    bars = step(corners, BENT, Rig(), tension_in=10.0)
    for state in (pretensioned(Rig()), corners, bars):
        write_state(tmp_path / "state.json", state)
        assert state_object(read_state(tmp_path / "state.json")) == state_object(state)
    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"version": 1, "kind": "bars"}', '{"version": 2}'])
def test_what_is_no_state_is_refused_with_its_path(tmp_path, text):
    path = tmp_path / "state.json"
    path.write_text(text)
    with pytest.raises(SettingsError, match=r"state\.json"):
        read_state(path)


def test_a_state_of_version_3_with_an_infinite_position_is_refused_without_a_warning(tmp_path):
    saved = json.loads((CORPUS / "state_bars.json").read_text())
    saved["along"]["displacement_in"] = math.inf
    (tmp_path / "tendon.json").write_text(json.dumps(saved).replace("Infinity", "1e999"))
    with pytest.raises(SettingsError, match="the saved state is broken"):
        read_state(tmp_path / "tendon.json")


def test_a_missing_state_is_an_error(tmp_path):
    with pytest.raises(SourceError, match="cannot be read"):
        read_state(tmp_path / "none.json")
