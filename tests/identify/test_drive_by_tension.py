"""Campaigns of a rig that the force drives, where the position is an answer."""

import pytest

from tests.bristle import make_campaign
from tssgeom.identify.workflow import discover
from tssgeom.io.formats.campaigns import read_campaign


@pytest.mark.parametrize(("seed", "size"), [(5, 1.0), (7, 0.5)])
def test_an_encoder_that_drifts_is_a_law_with_the_tension_as_drive(tmp_path, seed, size):
    """Of the half size creep helps with the position as drive, and with the tension no name passes."""
    make_campaign(tmp_path / "drifting", seed, "drifting_displacement_in", size)
    finding = discover(read_campaign(tmp_path / "drifting"))
    assert finding.verdict == "law"
    assert [effect.names for effect in finding.effects] == [("sensor_drift",)]
    law = finding.effects[0].law
    assert law is not None
    assert 0.5 * size < law.value[-1] / 2.5e-4 < 1.0 * size  # 0.25 mm at the end of the longest run
    assert any("tension drives the model" in note for note in finding.notes)


def test_a_drift_many_times_the_noise_is_fitted_to_its_end(tmp_path):
    """0.25 mm of a position with 2 µm of noise: a law that is fitted by short steps ends on its way there."""
    make_campaign(tmp_path / "drifting", 9, "drifting_displacement_in")
    finding = discover(read_campaign(tmp_path / "drifting"))
    (effect,) = finding.effects
    assert effect.names == ("sensor_drift",)
    assert effect.law is not None
    assert 2.1e-4 < effect.law.value[-1] < 2.5e-4  # m
