"""What a law is, in a clause that a newcomer understands."""

from __future__ import annotations

import numpy as np

from tssgeom.effects import KINDS
from tssgeom.identify.finding import Candidate

OVER = {
    "tension_N": ("tension", "N"),
    "speed_m_per_s": ("speed of sliding", "m/s"),
    "curvature_per_m": ("curvature", "1/m"),
    "arc_length_m": ("arc length", "m"),
    "travel_m": ("path slid", "m"),
    "time_s": ("time since the run began", "s"),
    "position_m": ("proximal position", "m"),
}
"""What a law may be over, and its unit in SI; a channel stands for itself."""
_DEPENDS = {
    "friction_over_tension": "friction depends on the tension",
    "friction_over_speed": "friction depends on the speed of sliding",
    "friction_over_curvature": "friction depends on the curvature",
    "friction_over_arc_length": "friction is uneven along the sheath",
    "friction_over_travel": "friction changes with the path slid",
    "friction_over_time": "friction changes with time",
    "friction_over_position": "friction, or the angle of the route, changes with the position",
    "strain_over_tension": "the tendon stretches by another law than a straight line",
    "stretch_at_end": "what lies outside the sheath stretches by another law",
    "load_over_position": "the load is no straight spring",
    "strain_over_time": "the tendon stretches late",
    "sensor_curve": "a sensor is no straight line",
    "sensor_drift": "a sensor drifts in time",
    "sensor_lag": "the sensor of the drive is late",
}


def law_words(one: Candidate) -> str:
    """Say in a clause what a part is, with the range of its law."""
    name = one.names[0]
    if one.law is None or name in KINDS:
        return ""
    law, own = one.law, one.effects[0]
    at = getattr(own, "channel", "") or (f"{getattr(own, 'of', '')} end" if name == "stretch_at_end" else "")
    what = _DEPENDS[name] + (f" ({at})" if at else "")
    if len(law.x) < 4:
        return what
    least, most = int(np.argmin(law.value)), int(np.argmax(law.value))
    unit = "" if law.unit == "1" else f" {law.unit}"
    first, last = sorted((least, most))
    variable, si = OVER.get(law.over, ("a reading", law.over.rpartition("_")[2]))
    start, end = f"{law.x[first]:.3g} {si}", f"{law.x[last]:.3g} {si}"
    low, high = f"{law.value[first]:.3g}{unit}", f"{law.value[last]:.3g}{unit}"
    nearest = min(law.nearest, key=lambda each: each[1], default=("", 0.0))[0]
    near = f"; nearest formula {nearest}" if nearest else ""
    return f"{what}: from {low} at {start} to {high} at {end} ({variable}{near})"
