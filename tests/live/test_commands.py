"""Commands of a stream: their errors, tolerance, policy and the limits of the drive."""

import pytest

from tests.live.peers import half_circle, next_answer
from tests.live_process import PATIENCE, line, live

RIG = """
[tendon]
pretension_N = 3.0

[friction]
coefficient = { value = 0.145, sd = 0.015 }

[drive]
limits = { tension_N = 12.0 }
"""


def test_a_stream_says_the_error_of_each_command_and_what_kept_it_from_its_target(tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG)
    targets = [None, 2e-3, 1.99e-3, 8e-3]
    with live("--rig", rig, "--tolerance-mm", "0.2", "--policy", "wait") as stream:
        for time, target in enumerate(targets):
            wanted = {"displacement_target_m": target, "tension_in_N": None if target else 3.5}
            stream.input.write(line(half_circle(), float(time), **wanted))
        stream.input.close()
        none, first, held, cut = (next_answer(stream) for _ in targets)
        assert stream.process.wait(PATIENCE) == 0
    new = {"displacement_out_se_m", "tension_out_se_N", "limited", "waits", "out_of_tolerance"}
    assert not new & none.keys()
    assert 0.0 < first["displacement_out_se_m"] < first["displacement_out_se_by_tension_m"]
    # T_out = T_in exp(−μΦ) for a drive by tension: 5 N · π · 0.015
    assert first["tension_out_se_by_tension_N"] == pytest.approx(0.236, rel=0.05)
    assert first["tension_out_se_N"] == pytest.approx(1000.0 * first["displacement_out_se_m"], rel=1e-9)
    assert not {"limited", "waits", "displacement_reached_m"} & first.keys()
    assert held["waits"] is True
    assert held["displacement_command_m"] == pytest.approx(first["displacement_command_m"], abs=1e-6)
    assert held["displacement_reached_m"] == pytest.approx(2e-3, rel=1e-3)
    assert cut["limited"] == "tension_N"
    assert cut["tension_command_N"] == pytest.approx(12.0, rel=1e-9)
    assert cut["displacement_reached_m"] < 8e-3
    assert cut["out_of_tolerance"] > 0.99


def test_an_option_that_is_no_tolerance_ends_the_stream_before_it_begins(tmp_path):
    with pytest.raises(AssertionError, match="--tolerance-mm is -1 mm"), live("--tolerance-mm", "-1"):
        pass
