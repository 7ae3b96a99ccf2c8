"""Campaigns of a rig that the force drives, where the position is an answer."""

from tests.bristle import make_campaign
from tssgeom.identify.workflow import discover
from tssgeom.io.formats.campaigns import read_campaign


def test_an_encoder_that_drifts_is_a_law_with_the_tension_as_drive(tmp_path):
    make_campaign(tmp_path / "drifting", 5, "drifting_displacement_in")
    finding = discover(read_campaign(tmp_path / "drifting"))
    assert finding.verdict == "law"
    assert finding.effects[0].names[0] == "sensor_drift"
    law = finding.effects[0].law
    assert law is not None
    assert 1.2e-4 < law.value[-1] < 2.5e-4  # m; 0.25 mm at the end of the longest run
    assert any("tension drives the model" in note for note in finding.notes)
