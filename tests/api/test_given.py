"""What is given to the calls of Python: units, numbers and names of plots, and the words of their errors."""

import numpy as np
import pytest

from tssgeom import Frame, Rig, SettingsError, ShapeError, analyse, analyse_all, calibrate, read
from tssgeom.effects import ChannelLag
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import predict

ANGLE = np.linspace(0.0, np.pi, 40)
POINTS = 0.5 / np.pi * np.column_stack((np.sin(ANGLE), 1 - np.cos(ANGLE), 0 * ANGLE))
STATIONS = 0.5 * ANGLE / np.pi


def test_the_unit_of_an_array_is_that_of_its_points_and_stations():
    metres = analyse(POINTS, stations=STATIONS, unit="m")
    millimetres = analyse(1e3 * POINTS, stations=1e3 * STATIONS, unit="mm")
    inches = analyse(POINTS / 0.0254, stations=STATIONS / 0.0254, unit="in")
    for result in (metres, millimetres, inches):
        assert result.profile.length == pytest.approx(0.5, rel=1e-3)  # a chord of 1/40 of a half circle
    assert millimetres.profile.total_angle == pytest.approx(metres.profile.total_angle, rel=1e-9)
    with pytest.raises(SettingsError, match="unit is 'inch': give one of 'mm', 'm', 'cm', 'in', "):
        analyse(POINTS, unit="inch")


def test_a_unit_beside_what_has_its_own_is_refused(tmp_path):
    with pytest.raises(SettingsError, match="unit is 'mm', but a Frame is in m: leave unit out"):
        analyse(Frame(POINTS), unit="mm")
    with pytest.raises(SettingsError, match="unit is 'mm', but a recording is in m"):
        analyse_all([Frame(POINTS)], unit="mm")
    with pytest.raises(SettingsError, match="unit is 'mm', but a FrameResult is in m"):
        calibrate({"time_s": STATIONS, "tension_in_N": STATIONS}, analyse(POINTS), Rig(), unit="mm")


def test_an_elongation_that_is_formed_of_a_late_reading_is_late_as_a_whole():
    rig, arcs = (
        Rig(effects=(ChannelLag(lag_s=0.08, channel="distal"),)),
        Arcs.exact(*np.array([[0.5], [np.pi]])),
    )
    time = np.linspace(0.0, 24.0, 1200)
    run = {"time_s": time, "tension_in_N": 10.0 + 8.0 * np.sin(time - 0.5 * np.pi)}
    read = predict(run, arcs, rig)
    run |= {name: read[name] for name in ("tension_out_N", "displacement_in_m", "displacement_out_m")}
    known = calibrate(run, arcs, rig).estimates
    assert known["friction"].value == pytest.approx(rig.friction.coefficient, rel=1e-3)
    assert known["compliance"].value == pytest.approx(rig.tendon.compliance_per_N, rel=1e-3)
    now = calibrate(run, arcs, Rig()).estimates["compliance"].value
    assert abs(now / rig.tendon.compliance_per_N - 1.0) > 0.01


@pytest.mark.parametrize("wrong", ["15", None, [1.0, 2.0]])
def test_a_tension_that_is_no_number_is_refused_by_its_name_and_unit(wrong):
    with pytest.raises(SettingsError, match=r"tension_in is .*: give a number in N"):
        analyse(POINTS, tension_in=wrong)
    with pytest.raises(SettingsError, match=r"tension_in is .*: give a number in N"):
        analyse_all([Frame(POINTS)], tension_in=wrong)


def test_errors_of_files_name_the_parameters_of_python(tmp_path):
    path = tmp_path / "points.csv"
    np.savetxt(path, POINTS, delimiter=",", header="x,y,z", comments="")
    with pytest.raises(ShapeError, match=r'or give unit="mm" or unit="m" \(cm, in, …\)$'):
        analyse(path)
    path.write_text("x_m,y_m,z_m\n0,0,0\n1,0,0\n")
    with pytest.raises(ShapeError, match="unit says mm: read it without unit"):
        read(path, "mm")
    path.write_text("x_m,y_m,z_m,Force [N],Load [N]\n" + "0,0,0,1,2\n1,0,0,1,2\n")
    with pytest.raises(ShapeError, match=r"give read\(…, columns=\['Force \[N\]=tension_in_N'\]\)"):
        read(path)
    with pytest.raises(SettingsError, match="no column 'Kraft' in the file"):
        read(path, columns=["Force [N]=tension_in_N", "Load [N]=ignore", "Kraft=ignore"])


def test_a_line_without_a_unit_is_refused_with_the_parameter(tmp_path):
    path = tmp_path / "points.jsonl"
    path.write_text('{"points": [[0,0,0],[1,0,0],[2,0,0],[3,1,0]]}\n')
    with pytest.raises(ShapeError, match='unit="mm" or unit="m"'):
        analyse(path)


def test_a_plot_is_named_alone_and_other_axes_are_refused():
    import matplotlib as mpl

    mpl.use("Agg")
    result = analyse(POINTS)
    assert result.plot("curvature").get_ylabel() == result.plot(what="curvature").get_ylabel()
    with pytest.raises(SettingsError, match="has no plot 'force': its plots are"):
        result.plot("force")
    with pytest.raises(SettingsError, match="axes is 7: give matplotlib's axes, or the name of a plot alone"):
        result.plot(7)


def test_the_line_of_a_result_counts_its_warnings():
    result = analyse(1e3 * POINTS)
    count = len(result.warnings)
    assert count
    assert repr(result).endswith(f", {count} warning{'s' if count > 1 else ''}>")
    assert "warning" not in repr(analyse(POINTS))
