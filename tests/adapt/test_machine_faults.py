"""Faults of machines that are followed: detected at once, and named once some seconds are compared."""

import pytest

from tests.adapt.machine_cases import followed, rig_of
from tests.twins.mechanisms import FAULT_S, UNPLUGGED, segment, with_fault
from tssgeom.adapt.follower import Follower

_CAUSES = {
    "wet_sheath": ("friction_over_time", "along the route"),
    "frayed_tendon": ("strain_over_time", "along the tendons"),
    "unplugged": ("sensor", UNPLUGGED["pair"]),
}


@pytest.mark.parametrize("fault", _CAUSES)
def test_a_fault_of_a_pair_is_detected_within_a_second_and_named_within_eight(fault):
    scenario = with_fault("pair", 1, FAULT_S + 8.0, fault)
    follower, detected = Follower(rig_of(scenario.machine)), None
    for now in followed(scenario, follower):
        if follower.alert is not None and detected is None:
            detected = now
    assert detected is not None
    assert FAULT_S < detected < FAULT_S + 1.0
    assert follower.alert is not None
    first = follower.alert.explanations[0]
    assert (first.mechanism, first.where) == _CAUSES[fault]
    assert first.probability > 0.8


def test_a_drive_of_a_sound_segment_that_turns_slowly_beside_fast_ones_raises_no_alert():
    scenario = segment(2, 21.0)  # from 18.4 s on one goes back by 5 noises, the others by 95
    follower = Follower(rig_of(scenario.machine))
    for now in followed(scenario, follower):
        assert follower.alert is None, now
