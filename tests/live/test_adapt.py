"""A stream whose rig is followed: answers, the rig in a file, and the state over restarts."""

import signal
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

from tests.live.peers import half_circle, next_answer
from tests.live_process import PATIENCE, Live, line, live
from tssgeom.adapt.readings import mean_and_covariance
from tssgeom.io.formats.states import read_filter, read_state
from tssgeom.rig import read_rig

RIG = """
[tendon]
pretension_N = 3.0

[sensors.tension_in_N]
noise = 0.02

[sensors.displacement_in_m]
noise = 1e-5
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    return path


def _answered(stream: Live, i: int) -> dict[str, Any]:
    """Return the answer to the i-th frame of a slow pull."""
    drive = {"tension_in_N": 3.0 + 0.02 * i, "displacement_in_m": 1e-5 * i}
    stream.input.write(line(half_circle(), 0.01 * i, **drive))
    stream.input.flush()
    answer = next_answer(stream)
    while answer.get("stale"):
        answer = next_answer(stream)
    return answer


def _known(saved, rig):
    values, _ = saved.restored(read_rig(rig)).estimate(*mean_and_covariance(saved.members))
    return values.tolist()


def test_a_followed_stream_writes_its_rig_and_goes_on_from_its_state(tmp_path, rig):
    state, out = tmp_path / "tendon.json", tmp_path / "followed.toml"
    options = ("--rig", rig, "--adapt", "--state", state, "--write-rig", out)
    with live(*options) as stream:
        answers = [_answered(stream, i) for i in range(60)]
        stream.input.close()
        assert stream.process.wait(PATIENCE) == 0
    first, last = (each["followed"] for each in (answers[0], answers[-1]))
    assert list(first) == ["friction.coefficient", "tension_in_offset.offset_N"]
    assert last["friction.coefficient"][1] < first["friction.coefficient"][1]
    written = read_rig(out)
    assert written.friction.coefficient == pytest.approx(last["friction.coefficient"][0], rel=1e-12)
    assert written.sensors["tension_in_N"].noise == 0.02
    assert "# friction.coefficient = " in out.read_text()
    saved = read_filter(state, read_rig(rig))
    assert saved is not None
    assert _known(saved, rig) == pytest.approx([value for value, _ in last.values()], rel=1e-9)
    with live(*options) as stream:
        again = _answered(stream, 60)["followed"]
        assert stream.stop() == 0
        assert not any("anew" in text for text in stream.errors)
    assert again["friction.coefficient"][1] < 1.2 * last["friction.coefficient"][1]


def test_a_killed_stream_loses_at_most_a_second_of_its_filter(tmp_path, rig):
    state = tmp_path / "tendon.json"
    with live("--rig", rig, "--adapt", "--state", state) as stream:
        ended, i = monotonic() + 2.0, 0
        while monotonic() < ended:
            _answered(stream, i)
            i += 1
            sleep(0.01)
        stream.stop(signal.SIGKILL)
    sleep(0.5)  # the process that saves ends by itself
    saved = read_filter(state, read_rig(rig))
    assert saved is not None
    assert saved.time == read_state(state).time
    assert saved.time > 0.01 * (i - 1) - 1.0


def test_a_state_of_another_rig_is_said_and_the_rig_followed_anew(tmp_path, rig):
    state = tmp_path / "tendon.json"
    with live("--rig", rig, "--adapt", "--state", state) as stream:
        _answered(stream, 0)
        assert stream.stop() == 0
    rig.write_text(RIG + '\n[adapt."tendon.compliance_per_N"]\nsd = 3e-5\n')
    with live("--rig", rig, "--adapt", "--state", state) as stream:
        assert list(_answered(stream, 1)["followed"]) == [
            "tendon.compliance_per_N",
            "tension_in_offset.offset_N",
        ]
        assert any("the rig is followed anew" in text for text in stream.errors)
        assert stream.stop() == 0


def test_a_rig_to_write_needs_adapt(run, tmp_path):
    outcome = run("live", "--write-rig", tmp_path / "rig.toml")
    assert outcome.status == 2
    assert "--write-rig writes the rig that --adapt follows: give both" in outcome.errors[0]


def test_an_alert_is_said_when_it_begins_when_its_mechanism_is_named_and_when_it_ends():
    from pipelines.live.following import alert_sentence
    from tssgeom.adapt.alert import Alert, Cause

    begun = Alert("tension_in_N", 12.5, "pulling")
    named = Alert("tension_in_N", 12.5, "pulling", (Cause("sensor", "tension_in_N", 0.9, "it stands"),))
    surer = Alert("tension_in_N", 12.5, "pulling", (Cause("sensor", "tension_in_N", 0.99, "it stands"),))
    assert alert_sentence(None, begun) == (
        "alert: tension_in_N disagrees with the model since 12.50 s (pulling)"
    )
    assert alert_sentence(begun, named) == (
        "alert: tension_in_N disagrees with the model since 12.50 s (pulling): sensor (tension_in_N), "
        "probability 0.90: it stands"
    )
    assert alert_sentence(named, surer) is None
    assert alert_sentence(surer, None) == "alert: tension_in_N agrees with the model again"


MACHINE = """
[drive]
kind = "pair"
radius_m = 0.01

[end]
kind = "joint"
radius_m = 0.008
stiffness_Nm_per_rad = 0.05

[tendon]
pretension_N = 6.0

[sensors.motor_angle_rad]
noise = 1e-3

[sensors.motor_torque_Nm]
noise = 2e-3

[sensors.joint_angle_rad]
noise = 1e-3
"""


def test_a_machine_is_followed_and_goes_on_from_its_state(tmp_path):
    rig, state, out = (tmp_path / name for name in ("rig.toml", "state.json", "followed.toml"))
    rig.write_text(MACHINE)
    options = ("--rig", rig, "--adapt", "--state", state, "--write-rig", out)

    def answered(stream: Live, i: int) -> dict[str, Any]:
        angle = 0.01 * i
        read = {"motor_angle_rad": angle, "motor_torque_Nm": 0.12 * angle, "joint_angle_rad": angle}
        stream.input.write(line(half_circle(), 0.02 * i, **read))
        stream.input.flush()
        answer = next_answer(stream)
        while answer.get("stale"):
            answer = next_answer(stream)
        return answer

    with live(*options) as stream:
        answers = [answered(stream, i) for i in range(40)]
        stream.input.close()
        assert stream.process.wait(PATIENCE) == 0
        assert not any("one tendon" in text for text in stream.errors)
    first, last = (each["followed"] for each in (answers[0], answers[-1]))
    assert list(first) == ["friction.coefficient", "sensors.motor_torque_Nm.zero"]
    assert last["friction.coefficient"][1] < first["friction.coefficient"][1]
    assert answers[-1]["tension_in_1_N"] > answers[-1]["tension_in_2_N"]
    written = read_rig(out)
    assert written.friction.coefficient == pytest.approx(last["friction.coefficient"][0], rel=1e-12)
    assert written.sensors["motor_torque_Nm"].zero == pytest.approx(
        last["sensors.motor_torque_Nm.zero"][0], rel=1e-12
    )
    saved = read_filter(state, read_rig(rig))
    assert saved is not None
    assert _known(saved, rig) == pytest.approx([value for value, _ in last.values()], rel=1e-9)
    with live(*options) as stream:
        again = answered(stream, 40)
        assert stream.stop() == 0
        assert not any("anew" in text for text in stream.errors)
    assert again["followed"]["friction.coefficient"][1] < 1.2 * last["friction.coefficient"][1]
