"""Times of loggers and spreadsheets: what is no second is asked for, two clocks in a row are refused."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import SettingsError, ShapeError
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.io.formats.runs import read_run

TIME = np.arange(60) * 0.05
PULL = np.round(8.0 + 5.0 * np.sin(TIME), 3)


def written(path: Path, *names: str, **columns: list[str]) -> Path:
    forces = [f"{pull}" for pull in PULL], [f"{0.7 * pull:.4f}" for pull in PULL]
    rows = zip(*columns.values(), *forces, strict=True)
    head = [*(names or columns), "tension_in_N", "tension_out_N"]
    path.write_text("\n".join(",".join(each) for each in (head, *rows)) + "\n")
    return path


@pytest.mark.parametrize("since", [46_083.47227, 739_950.47227], ids=["spreadsheet", "MATLAB"])
def test_days_of_a_calendar_are_no_seconds(tmp_path, since):
    path = written(tmp_path / "run.csv", Time=[f"{since + each / 86_400.0:.10f}" for each in TIME])
    with pytest.raises(ShapeError, match=r'--map "Time=time_s:86400s" if it counts days'):
        read_run(path)
    read = read_run(path, ColumnMap(["Time=time_s:86400s"]))
    np.testing.assert_allclose(np.diff(read.time), 0.05, atol=2e-5)  # two roundings of 1e-10 days


def test_seconds_of_the_day_are_seconds(tmp_path):
    path = written(tmp_path / "run.csv", Time=[f"{46_083.2 + each:.3f}" for each in TIME])
    np.testing.assert_allclose(np.diff(read_run(path).time), 0.05, atol=1e-9)


@pytest.mark.parametrize("names", [("Time 1 (s)", "Time 2 (s)"), ("Time 1 (s)", "Time 2 (ms)")])
@pytest.mark.parametrize("lag", [0.4, 0.02, 0.0])
def test_channels_of_two_clocks_are_refused_unless_they_are_one_to_half_a_sample(tmp_path, names, lag):
    factor = 1e3 if "(ms)" in names[1] else 1.0
    columns = {"a": [f"{each:.3f}" for each in TIME], "b": [f"{factor * (each + lag):.3f}" for each in TIME]}
    path = written(tmp_path / "run.csv", *names, **columns)
    if lag < 0.025:
        np.testing.assert_allclose(read_run(path).time, TIME)
        return
    with pytest.raises(ShapeError, match=r"has other times than .* or give --map \"Time 2 \(m?s\)=ignore\""):
        read_run(path)
    np.testing.assert_allclose(read_run(path, ColumnMap([f"{names[1]}=ignore"])).time, TIME)


def test_a_clock_of_fewer_samples_is_another_clock(tmp_path):
    times = [f"{each:.3f}" for each in TIME]
    path = written(tmp_path / "run.csv", "t1 [s]", "t2 [s]", a=times, b=[*times[:40], *[""] * 20])
    with pytest.raises(ShapeError, match="has other times than"):
        read_run(path)


def test_a_time_since_1970_beside_one_of_the_run_is_no_other_clock(tmp_path):
    path = written(
        tmp_path / "run.csv",
        *("Time [s]", "Timestamp"),
        a=[f"{each:.3f}" for each in TIME],
        b=[f"{1_772_450_404.0 + each:.3f}" for each in TIME],
    )
    np.testing.assert_allclose(read_run(path).time, TIME)


def test_a_time_that_is_no_known_form_is_cited_with_what_to_write(tmp_path):
    begin = datetime(2026, 3, 2, 12, 59, 58)
    path = written(
        tmp_path / "run.csv",
        Timestamp=[f"{begin + timedelta(seconds=each):%m/%d/%Y %I:%M:%S.%f %p}" for each in TIME.tolist()],
    )
    with pytest.raises(SettingsError, match=r"'03/02/2026 12:59:58.000000 PM' is no time .* or seconds"):
        read_run(path)
