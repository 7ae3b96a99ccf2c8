"""What is fitted far from what a rig states is said; a default states nothing."""

from pathlib import Path

import pytest
from msgspec.structs import replace as changed

from tssgeom import calibrate, read_rig
from tssgeom.rig import Friction

CLEAN = Path(__file__).parents[2] / "sample_shapes" / "campaign_clean"


def said(rig) -> list[str]:
    """Return the warnings of a run on the route of another: μΦ holds, so that μ is three times as large."""
    fitted = calibrate(CLEAN / "loop_slow.csv", CLEAN / "route_half_circle.csv", rig)
    return [each for each in fitted.warnings if "what the rig states" in each]


@pytest.mark.parametrize("friction", ["0.145", "{ value = 0.145, sd = 0.1 }"])
def test_a_number_that_a_file_states_is_compared_even_where_it_equals_the_default(tmp_path, friction):
    (tmp_path / "rig.toml").write_text(f"friction.coefficient = {friction}\n")
    (only,) = said(tmp_path / "rig.toml")
    assert only.startswith("friction is fitted as ")
    assert "what the rig states, 0.145: check that shape and run belong together" in only


@pytest.mark.parametrize("text", ["", 'friction.coefficient = "unknown"\n'])
def test_a_number_that_a_file_does_not_state_is_not(tmp_path, text):
    (tmp_path / "rig.toml").write_text(text)
    assert said(tmp_path / "rig.toml") == []


def test_of_a_rig_that_is_no_file_what_is_not_the_default_is_stated():
    rig = read_rig(CLEAN / "rig.toml")
    assert said(rig) == []
    (only,) = said(changed(rig, friction=Friction(coefficient=0.15)))
    assert "what the rig states, 0.15" in only
    assert said(None) == []
