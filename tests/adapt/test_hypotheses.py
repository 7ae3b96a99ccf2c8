"""Which mechanisms are tried after an alarm."""

import numpy as np
import pytest

from tests.adapt.cases import follow
from tests.twins import scenarios
from tssgeom.adapt.hypotheses import turned
from tssgeom.adapt.readings import Moment
from tssgeom.route.pieces import Arcs


@pytest.mark.parametrize(
    ("since", "leaps"), [(4.0, True), (-9.0, False)], ids=["while it is kept", "before the first moment"]
)
def test_the_sensed_angle_leaps_where_any_moment_shows_it(since, leaps):
    angles = np.where(np.arange(100) < 45, 3.0, 3.6)
    moments = [
        Moment(0.1 * k, Arcs.exact(np.array([0.5]), np.array([angle])), None)
        for k, angle in enumerate(angles)
    ]
    assert turned(moments, since) is leaps


def test_friction_that_steps_again_is_no_play_of_size_nothing():
    alerts = follow(scenarios.stepping_friction(10), every=4).alerts
    assert [one.mechanism for one in alerts] == ["friction_over_time", "friction_over_time"]
