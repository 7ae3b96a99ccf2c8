"""The order of frames in a recording."""

import numpy as np
import pytest

from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import find_inputs, open_recording
from tssgeom.io.formats.recording import in_order, late
from tssgeom.stream import Frame, Rejected

POINTS = np.column_stack((np.arange(5.0), np.zeros(5), np.zeros(5)))


@pytest.mark.parametrize("bad", [Frame(POINTS[:2], 1e9), Frame(POINTS, 1e9, tension_in=-7.0)])
def test_the_time_of_a_frame_that_cannot_be_used_does_not_count(bad):
    frames = [Frame(POINTS, 0.1), bad, Frame(POINTS, 0.2), Frame(POINTS, 0.15)]
    outcome = list(in_order(frames))
    assert outcome[:3] == frames[:3]
    assert isinstance(outcome[3], Rejected)
    assert "comes after 0.2 s" in outcome[3].reason


def test_a_frame_that_comes_too_late_is_refused_with_all_digits_of_both_times():
    assert late(1.7e9, 1.7e9 + 0.025).startswith("time 1700000000 s comes after 1700000000.025 s: put")


def test_a_file_of_a_folder_that_states_another_unit_than_the_option_is_refused_alone(tmp_path):
    rows = "\n".join(f"{0.1 * k},{0.01 * k * k},0" for k in range(6))
    (tmp_path / "names.csv").write_text("x_m,y_m,z_m\n" + rows)
    (tmp_path / "brackets.csv").write_text("x [m],y [m],z [m]\n" + rows)
    (tmp_path / "comment.csv").write_text("# unit: m\nx,y,z\n" + rows)
    (tmp_path / "lines.jsonl").write_text('{"unit": "m", "points": [[0,0,0],[1,0,0],[2,1,0],[3,1,1]]}\n')
    (tmp_path / "none.csv").write_text("x,y,z\n" + rows)
    (tmp_path / "tenths.csv").write_text("x_cm,y_cm,z_cm\n" + rows)
    refused, lengths = list[str](), dict[str, float]()
    for path in find_inputs([tmp_path]):
        try:
            (frame,) = open_recording(path, "mm").frames
        except ShapeError as error:
            assert "the file is in m, --unit says mm: read it without --unit" in str(error)  # noqa: PT017
            refused.append(path.name)
        else:
            assert isinstance(frame, Frame)
            lengths[path.name] = frame.points[-1, 0]
    assert refused == ["brackets.csv", "comment.csv", "lines.jsonl", "names.csv"]
    assert lengths == {"none.csv": pytest.approx(0.0005), "tenths.csv": pytest.approx(0.005)}
