"""`tssgeom simulate --adapt`: what it writes for a run of the independent simulator."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq
import pytest

from pipelines.cli import main
from tests.adapt.cases import rig_of
from tests.described import described
from tests.twins import drifting_friction, route_points
from tssgeom.rig import read_rig, write_rig

COUNT = 1500  # rows


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("adapt")
    scenario = drifting_friction(2, 0.02)
    read = {
        name: values[:COUNT] for name, values in scenario.readings.items() if name != "displacement_out_m"
    }
    papq.write_table(pa.table({"time_s": scenario.times[:COUNT], **read}), folder / "run.parquet")
    points = 1e3 * route_points(scenario.machine.lengths_m, scenario.machine.angles_rad, 100)
    np.savetxt(folder / "shape.csv", points, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    write_rig(folder / "rig.toml", rig_of(scenario.machine))
    return folder


def simulate(folder, *options):
    arguments = ["simulate", str(folder / "shape.csv"), "--drive", str(folder / "run.parquet"), *options]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--out", str(folder / "out")])
    return ended.value.code


def test_a_run_is_followed_and_written(folder, capsys):
    rig, written = folder / "rig.toml", folder / "now.toml"
    assert simulate(folder, "--rig", str(rig), "--adapt", "--write-rig", str(written), "--json") == 0
    report = json.loads(capsys.readouterr().out)
    described("simulate --adapt --json, adapt.json", report)
    assert json.loads((folder / "out/adapt.json").read_text("utf-8")) == report
    assert (report["rows"], report["rows_left_out"], report["drive"]) == (COUNT, 0, "displacement_in_m")
    assert [one["key"] for one in report["numbers"]] == list(read_rig(rig).adapt)
    table = papq.read_table(folder / "out/adapt.parquet")
    assert table.num_rows == COUNT
    assert table.schema.field("tension_out_se_N").metadata[b"unit"] == b"N"
    numbers = papq.read_table(folder / "out/adapt_numbers.parquet")
    last = report["numbers"][0]["end"]
    assert numbers["friction.coefficient_smoothed"][-1].as_py() == last["value"]
    assert numbers["friction.coefficient_filtered"][-1].as_py() == last["value"]
    assert numbers.schema.field("tension_in_offset.offset_N_smoothed_se").metadata[b"unit"] == b"N"
    alerts = papq.read_table(folder / "out/adapt_alerts.parquet")
    assert alerts.num_rows == len(report["alerts"])
    assert {"since_s", "mechanism", "sentence"} <= set(alerts.column_names)
    assert all(
        (folder / "out" / f"adapt.{ending}").stat().st_size > 10_000 for ending in ("png", "pdf", "svg")
    )
    now = read_rig(written)
    assert now.friction.coefficient == pytest.approx(last["value"], rel=1e-2)  # the last 0.1 s
    assert "SHA-256" in written.read_text("utf-8").split("\n\n")[0]
    assert sum(name.startswith("# ") and "±" in name for name in written.read_text("utf-8").split("\n")) == 3


def test_a_rig_without_noise_takes_that_of_the_readings_and_states_it(folder, capsys):
    assert simulate(folder, "--adapt", "--quiet") == 0
    written = capsys.readouterr().err
    assert "sensors.displacement_in_m.noise is not stated: " in written
    assert " m, as the readings show" in written


def test_a_rig_is_written_only_where_it_is_followed(folder, capsys):
    assert simulate(folder, "--write-rig", str(folder / "none.toml")) == 2
    assert "--write-rig needs --adapt" in capsys.readouterr().err
