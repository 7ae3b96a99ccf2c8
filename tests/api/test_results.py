"""Every result shows a short line and a table, is plotted on given axes, and becomes tables and files."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import msgspec
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.csv as pacsv
import pyarrow.parquet as papq
import pytest
from matplotlib.figure import Figure

import tssgeom
from tssgeom.adapt.offline import RunFollower
from tssgeom.errors import SettingsError, SourceError
from tssgeom.rig import Sensor, with_values
from tssgeom.tendon.simulation import Measured

SAMPLES = Path(__file__).parents[2] / "sample_shapes"
CAMPAIGN = SAMPLES / "campaign_hidden_bend"
HOSTILE = '<script>alert("x")</script>'
TIME = np.linspace(0.0, 2.0, 21)
HEAVY = "('cv2', 'matplotlib', 'pandas', 'pyarrow', 'rerun', 'scipy', 'trimesh')"


def followed():
    rig = tssgeom.Rig(
        sensors={"tension_in_N": Sensor(noise=0.02), "tension_out_N": Sensor(noise=0.02)},
    )
    run = tssgeom.read_run(CAMPAIGN / "half_slow.csv")
    shape = tssgeom.analyse(CAMPAIGN / "route_half_circle.csv")
    route = tssgeom.MovingRoute(np.array([0.0]), [shape.arcs])
    kept = slice(0, 60)
    columns = Measured(run.time[kept], tension_in=run.tension_in[kept], tension_out=run.tension_out[kept])
    follower = RunFollower(rig, route, columns)
    assert len(list(follower.rows())) == 60
    return follower.result()


PAIR = """
[tendon]
pretension_N = 4.0
[drive]
kind = "pair"
radius_m = 0.01
[end]
kind = "joint"
radius_m = 0.006
stiffness_Nm_per_rad = 0.05
"""


def machine_run():
    motor = {"time_s": TIME, "motor_angle_rad": 0.3 * np.sin(TIME)}
    return tssgeom.simulate(
        CAMPAIGN / "route_half_circle.csv", motor, msgspec.toml.decode(PAIR, type=tssgeom.Rig)
    )


@pytest.fixture(scope="module")
def results():
    """One result of every class that a notebook shows."""
    mpl.use("Agg")
    shape, run, rig = (CAMPAIGN / name for name in ("route_half_circle.csv", "half_slow.csv", "rig.toml"))
    result = tssgeom.analyse(SAMPLES / "colon_markers.csv")
    targets = {"time_s": TIME, "displacement_out_m": 0.003 * np.sin(TIME)}
    compensation = tssgeom.compensate(shape, targets, rig)
    recording = tssgeom.read(SAMPLES / "insertion.jsonl")
    listed = [
        recording,
        recording[3],
        result,
        result.fit,
        result.route,
        result.profile,
        result.arcs,
        tssgeom.read_run(run),
        tssgeom.simulate(shape, run, rig),
        compensation,
        compensation[3],
        tssgeom.calibrate(run, shape, rig),
        tssgeom.discover(SAMPLES / "campaign_clean"),
        followed(),
        tssgeom.analyse_all(recording[:12], rig),
        machine_run(),
        tssgeom.calibrate([run, run], shape, rig),
    ]
    return {type(each).__name__: each for each in listed}


NAMES = [
    *("Recording", "Frame", "FrameResult", "RouteFit", "Route", "CurvatureProfile", "Arcs", "MeasuredRun"),
    *("Simulation", "Compensation", "Command", "Calibration", "Finding", "FollowedRun", "RecordingResult"),
    *("MachineChannels", "MachineCalibration"),
]


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_one_short_line_and_a_table(results, name):
    line = repr(results[name])
    assert line.startswith(f"<{name}: ")
    assert "\n" not in line
    assert len(line) <= 200
    page = results[name]._repr_html_()
    assert page.count("<tr>") == page.count("</tr>") > 0
    assert "color" not in page  # that of the notebook, of any style


@pytest.mark.parametrize("name", NAMES)
def test_a_result_becomes_the_same_table_in_every_library_and_file(results, name, tmp_path):
    result = results[name]
    table = result.to_arrow()
    assert table.num_rows > 0
    assert all(field.metadata[b"meaning"] for field in table.schema)
    pd.testing.assert_frame_equal(result.to_pandas(), table.to_pandas())
    assert result.to_polars().equals(pl.from_arrow(table))
    assert papq.read_table(result.save(tmp_path / "result.parquet")).equals(table)
    read = pacsv.read_csv(result.save(tmp_path / "result.csv"))
    assert (read.column_names, read.num_rows) == (table.column_names, table.num_rows)
    for column in table.column_names:
        if str(table.schema.field(column).type) == "double":
            np.testing.assert_array_equal(
                read[column].to_pandas().astype(float), table[column].to_pandas().astype(float)
            )
    content = json.loads(result.save(tmp_path / "result.json").read_text())
    if name not in ("FrameResult", "Finding"):
        assert [list(row) for row in content] == [table.column_names] * table.num_rows


@pytest.mark.parametrize("name", NAMES)
def test_every_plot_uses_the_axes_that_are_given(results, name):
    for what in results[name].plots:
        axes = Figure().subplots()
        assert results[name].plot(axes, what) is axes
        assert axes.has_data()
    assert bool(results[name].plots) == (name != "Command")


def test_a_plot_without_axes_is_a_figure_of_pyplot(results):
    import matplotlib.pyplot as plt

    axes = results["FrameResult"].plot()
    assert plt.gcf() is axes.figure
    plt.close("all")


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_a_plot_is_saved_by_its_ending_and_opens_no_figure(results, ending, tmp_path):
    import matplotlib.pyplot as plt

    path = results["FrameResult"].save(tmp_path / f"route.{ending}")
    assert path.stat().st_size > 1000
    assert plt.get_fignums() == []
    assert list(tmp_path.iterdir()) == [path]


def test_every_frame_of_a_recording_is_kept_or_rejected(results):
    kept = results["RecordingResult"]
    assert len(kept) + len(kept.rejected) == 12
    assert kept.to_arrow().num_rows == len(kept)
    assert kept[-1].transmission.tension_in == pytest.approx(kept.to_pandas()["tension_in_N"].iloc[-1])


def test_a_machine_is_simulated_commanded_and_calibrated_as_its_commands_do(tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text(PAIR + '[friction]\ncoefficient = "unknown"\n', "utf-8")
    shape = CAMPAIGN / "route_half_circle.csv"
    run = machine_run().channels
    measured = {
        name: run[name] for name in ("time_s", "motor_angle_rad", "motor_torque_Nm", "joint_angle_rad")
    }
    fitted = tssgeom.calibrate(measured, shape, rig)
    assert fitted.rig.friction.coefficient == pytest.approx(0.145, rel=0.1)
    known = msgspec.toml.decode(PAIR, type=tssgeom.Rig)
    target = {"time_s": TIME, "joint_angle_rad": run["joint_angle_rad"]}
    commands = tssgeom.compensate(shape, target, known)
    assert commands.reached.all()
    again = tssgeom.simulate(shape, {k: commands.channels[k] for k in ("time_s", "motor_angle_rad")}, known)
    np.testing.assert_allclose(again.channels["joint_angle_rad"], target["joint_angle_rad"], atol=1e-5)


def test_what_a_result_has_not_is_one_line_with_what_it_has(results, tmp_path):
    with pytest.raises(SettingsError, match=r"no result is saved as \.xlsx: use \.csv, \.parquet"):
        results["FrameResult"].save(tmp_path / "result.xlsx")
    with pytest.raises(SettingsError, match="no plot 'torque': its plots are tension, curvature"):
        results["FrameResult"].plot(what="torque")
    with pytest.raises(SettingsError, match="Command has no plot None: its plots are none"):
        results["Command"].save(tmp_path / "command.png")
    with pytest.raises(SourceError):
        results["Arcs"].save(_folder(tmp_path / "a.csv"))


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


def test_names_and_warnings_of_a_file_are_text_in_the_table(results):
    recording = replace(results["Recording"], name=HOSTILE, warnings=(HOSTILE,))
    assert HOSTILE not in recording._repr_html_()
    assert recording._repr_html_().count("&lt;script&gt;") == 2
    frame = replace(results["Frame"], id=HOSTILE)
    assert HOSTILE not in frame._repr_html_()


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_library_that_is_absent_is_named(results, library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(SettingsError, match=f"which is not installed: pip install {library}"):
        getattr(results["Arcs"], f"to_{library}")()


def test_a_recording_is_a_sequence_that_reads_again_and_a_table_of_it_is_read_alike(results, tmp_path):
    recording = results["Recording"]
    assert len(recording) == len(list(recording)) == len(list(recording)) == 600
    assert recording[-1].time == list(recording)[-1].time
    assert [each.time for each in recording[5:9:2]] == [recording[5].time, recording[7].time]
    with pytest.raises(IndexError):
        recording[600]
    again = tssgeom.read(recording.save(tmp_path / "again.parquet"))
    for one, other in zip(recording[:20], again[:20], strict=True):
        np.testing.assert_allclose(one.points, other.points, atol=1e-15)
        assert (one.time, one.tension_in) == (other.time, other.tension_in)


def test_columns_and_paths_give_the_same_as_the_objects_that_they_hold():
    shape, run, rig = (CAMPAIGN / name for name in ("route_half_circle.csv", "half_slow.csv", "rig.toml"))
    frame = pd.read_csv(run)
    by_path = tssgeom.simulate(str(shape), str(run), str(rig)).to_arrow()
    by_columns = tssgeom.simulate(tssgeom.read(shape)[0], frame, tssgeom.read_rig(rig)).to_arrow()
    assert by_path.equals(by_columns)
    result = tssgeom.analyse(shape, rig)
    assert tssgeom.simulate(result, dict(frame), rig).to_arrow().equals(by_path)
    one, other = (tssgeom.calibrate(each, result, rig).estimates["friction"] for each in (run, frame))
    assert one == other
    rougher = with_values(tssgeom.read_rig(rig), {"friction.coefficient": 0.2})
    assert tssgeom.analyse(shape, rougher).transmission.tension_out < result.transmission.tension_out


def test_what_a_call_cannot_take_is_one_line():
    shape, run = CAMPAIGN / "route_half_circle.csv", CAMPAIGN / "half_slow.csv"
    with pytest.raises(SettingsError, match="stations belong to an array"):
        tssgeom.analyse(shape, stations=TIME)
    with pytest.raises(SettingsError, match="the run brings its drive"):
        tssgeom.simulate(shape, run, tension_in=TIME)
    with pytest.raises(SettingsError, match="a run brings its targets"):
        tssgeom.compensate(shape, run, displacement_out=0.001)
    with pytest.raises(SettingsError, match="run: tension_in_N has size"):
        tssgeom.simulate(shape, {"time_s": TIME, "tension_in_N": TIME[:3]})
    with pytest.raises(SettingsError, match="run: no column time_s"):
        tssgeom.simulate(shape, {"tension_in_N": TIME})


def test_a_line_of_a_result_loads_no_library_for_tables_and_pictures():
    code = (
        "import sys, tssgeom; print(repr(tssgeom.analyse(__import__('numpy').random.default_rng(0)"
        ".normal(0, 1e-4, (40, 3)) + [[0.01 * k, 0, 0] for k in range(40)])));"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    line, heavy = done.stdout.splitlines()
    assert line.startswith("<FrameResult: L = ")
    assert heavy == "[]"
