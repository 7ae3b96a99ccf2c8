"""Numbers that are followed, and alerts, in the picture of a stream."""

from dataclasses import replace

import numpy as np
import pytest

from tests.adapt.rigs import rig_of
from tests.twins import frames, scenarios
from tests.view.recorded import columns, entities, verify, views
from tssgeom import Engine, Frame, FrameResult, Rig
from tssgeom.adapt.alert import Alert, Cause
from tssgeom.adapt.follower import Follower
from tssgeom.view import colours
from tssgeom.view.scene.live import LivePicture
from tssgeom.view.scene.writer import GrowingFile


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """Frames of a followed machine, the later half with an alert; and the recording of them."""
    scenario = scenarios.sound(1, 0.005)
    rig = rig_of(scenario)
    engine = Engine(rig, tension_in=5.0, follower=Follower(rig))
    results = [engine.push(frame) for frame in frames(scenario, every=50)]
    alert = Alert("tension_in_N", 9.0, "hold", (Cause("sensor", "tension_in_N", 0.9, "it stands"),))
    middle = len(results) // 2
    results = [replace(one, alert=alert if i >= middle else None) for i, one in enumerate(results)]
    path = tmp_path_factory.mktemp("followed") / "run.rrd"
    file = GrowingFile(path)
    picture = LivePicture(file.recording, "run")
    for first in range(0, len(results), 10):
        picture.draw([one for one in results[first : first + 10] if isinstance(one, FrameResult)])
    file.finish()
    return results, path


def test_each_number_has_its_band(followed):
    results, path = followed
    verify(path)
    key = "friction.coefficient"
    names = {end: f"/followed/friction.coefficient/{end}" for end in ("value", "upper", "lower")}
    assert set(names.values()) <= entities(path)
    assert "TimeSeries" in views(path)
    at = results[0].followed.keys.index(key)
    lines = {}
    for end in ("value", "upper"):
        rows = columns(path, names[end], timed=True)
        lines[end] = [row[0] for name, rows in rows.items() if "scalars" in name for row in rows if row]
    known = [one.followed for one in results]
    np.testing.assert_allclose(lines["value"], [one.values[at] for one in known])
    np.testing.assert_allclose(
        lines["upper"], [one.values[at] + 1.959964 * one.se[at] for one in known], rtol=1e-9
    )


def test_an_alert_is_logged_once(followed):
    _, path = followed
    rows = columns(path, "/alerts", timed=True)
    texts = [text for name, values in rows.items() if "text" in name.lower() for text in values]
    assert texts == [
        ["WARN"],
        [
            "tension_in_N disagrees with the model since 9.00 s (hold): "
            "sensor (tension_in_N), probability 0.90: it stands"
        ],
    ]


def test_pieces_scale_and_axes_of_a_stream_hold_for_its_whole_recording(tmp_path):
    turns = np.linspace(0.02, 4.0, 12)  # straight at first: the camera has to turn and to grow
    stations = np.linspace(0.0, 1.0, 60)
    sensed = [
        0.3 * np.column_stack((np.sin(a * stations), 1 - np.cos(a * stations), 0 * stations)) / a
        for a in turns
    ]
    noise = np.random.default_rng(0).normal(0, 1e-4, (len(turns), 60, 3))
    engine = Engine(Rig(), tension_in=5.0)
    pushed = [engine.push(Frame(points + noise[k], 0.1 * k)) for k, points in enumerate(sensed)]
    file = GrowingFile(tmp_path / "run.rrd")
    picture = LivePicture(file.recording, "run")
    for one in pushed:
        picture.draw([one])
    file.finish()
    held = ("/", "/scale", "/scale/length", "/scale/axes", "/scale/axes/letters", "/scale/time")
    for entity in held:
        assert columns(tmp_path / "run.rrd", entity, timed=False), entity
    (names,) = [
        rows[-1]
        for name, rows in columns(tmp_path / "run.rrd", "/", timed=False).items()
        if "context" in name
    ]
    assert names[0][0]["class_description"]["info"]["color"] == rgba(colours.piece_rgb(0))


def rgba(rgb):
    red, green, blue = rgb
    return red << 24 | green << 16 | blue << 8 | 255
