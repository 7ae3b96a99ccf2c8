"""Faults of machines that are followed: detected at once, and named once some seconds are compared."""

import pytest

from tests.adapt.machine_cases import followed, rig_of
from tests.twins.mechanisms import FAULT_S, UNPLUGGED, with_fault
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
