"""`tssgeom simulate --adapt` of a machine: what it writes for a run of the independent simulator."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq
import pytest

from pipelines.cli import main
from tests.adapt.machine_cases import rig_of
from tests.described import described
from tests.twins import route_points
from tests.twins.mechanisms import pair
from tssgeom.rig import read_rig, write_rig


def test_the_run_of_a_machine_is_followed_and_written(tmp_path, capsys):
    scenario = pair(1, 20.0)
    papq.write_table(pa.table({"time_s": scenario.times, **scenario.readings}), tmp_path / "run.parquet")
    points = 1e3 * route_points(scenario.machine.lengths_m, scenario.machine.angles_rad, 100)
    np.savetxt(tmp_path / "shape.csv", points, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    write_rig(tmp_path / "rig.toml", rig_of(scenario.machine))
    shape, run, rig, out = (str(tmp_path / name) for name in ("shape.csv", "run.parquet", "rig.toml", "out"))
    written = tmp_path / "now.toml"
    options = ("--adapt", "--json", "--write-rig", str(written))
    with pytest.raises(SystemExit) as ended:
        main(["simulate", shape, "--drive", run, "--rig", rig, "--out", out, *options])
    assert ended.value.code == 0
    report = json.loads(capsys.readouterr().out)
    described("simulate --adapt --json, adapt.json", report)
    assert report["drive"] == "motor_angle_rad"
    assert report["rows_left_out"] == 0
    assert [one["key"] for one in report["numbers"]] == [
        "friction.coefficient",
        "sensors.motor_torque_Nm.zero",
    ]
    last = report["numbers"][0]["end"]
    truth = scenario.truth["friction"][-1]
    assert abs(last["value"] - truth) < 3.0 * last["se"] + 1e-3
    table = papq.read_table(tmp_path / "out/adapt.parquet")
    assert table.num_rows == len(scenario.times)
    joint = np.array(table["joint_angle_rad"])[-1]
    assert joint == pytest.approx(scenario.truth["joint_angle_rad"][-1], abs=5e-3)
    assert table.schema.field("tension_in_1_se_N").metadata[b"unit"] == b"N"
    numbers = papq.read_table(tmp_path / "out/adapt_numbers.parquet")
    assert numbers.schema.field("sensors.motor_torque_Nm.zero_smoothed").metadata[b"unit"] == b"N\xc2\xb7m"
    picture = (tmp_path / "out/adapt.svg").read_text("utf-8")  # a reading that is followed, not tendon 1
    assert "measured" in picture
    assert picture.count(r"\mathregular{τ_{m}}") == 2  # its zero, and the channel
    now = read_rig(written)
    assert now.friction.coefficient == pytest.approx(last["value"])
    assert now.sensors["motor_torque_Nm"].zero == pytest.approx(report["numbers"][1]["end"]["value"])


@pytest.mark.parametrize("missing", [slice(None), slice(7, 8)])
def test_a_drive_that_lacks_a_value_is_refused(tmp_path, capsys, missing):
    scenario = pair(1, 1.0)
    angle = np.array(scenario.readings["motor_angle_rad"])
    angle[missing] = np.nan
    columns = {"time_s": scenario.times, **scenario.readings, "motor_angle_rad": angle}
    papq.write_table(pa.table(columns), tmp_path / "run.parquet")
    points = 1e3 * route_points(scenario.machine.lengths_m, scenario.machine.angles_rad, 100)
    np.savetxt(tmp_path / "shape.csv", points, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    write_rig(tmp_path / "rig.toml", rig_of(scenario.machine))
    shape, run, rig, out = (str(tmp_path / name) for name in ("shape.csv", "run.parquet", "rig.toml", "out"))
    with pytest.raises(SystemExit) as ended:
        main(["simulate", shape, "--drive", run, "--rig", rig, "--out", out, "--adapt", "--quiet"])
    assert ended.value.code == 2
    row = np.flatnonzero(np.isnan(angle))[0]
    said = f"motor_angle_rad has no value at time_s = {scenario.times[row]:g}: fill every row"
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out").exists()
