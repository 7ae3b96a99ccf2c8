"""What a stream sends to the processes beside it arrives as it was."""

import numpy as np

from pipelines.live.messages import packed, unpacked
from tests.live.peers import half_circle
from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult


def test_a_picture_arrives_as_it_was_sent():
    frame = Frame(1e-3 * half_circle(), 1.0, tension_in=5.0)
    result = next(process([frame], Rig(), tension_in=5.0))
    assert isinstance(result, FrameResult)
    ((kind, outcome),) = unpacked(bytearray(packed("picture", result.strip())))
    assert kind == "picture"
    np.testing.assert_array_equal(outcome.route.position, result.route.position)
    np.testing.assert_array_equal(outcome.arcs.covariance, result.arcs.covariance)
    assert outcome.transmission == result.transmission
    assert not outcome.arcs.angle.flags.writeable


def test_arrays_keep_their_type_and_shape():
    turned = np.arange(6, dtype=np.int8).reshape(2, 3).T
    sent = [turned, np.zeros((0, 3)), np.array([True, False]), np.array(2.5)]
    ((_, outcome),) = unpacked(bytearray(packed("numbers", sent)))
    for before, after in zip(sent, outcome, strict=True):
        np.testing.assert_array_equal(after, before)
        assert after.dtype == before.dtype


def test_a_message_that_has_come_in_part_waits_for_its_rest():
    both = packed("numbers", 1.0) + packed("numbers", 2.0)
    data = bytearray(both[:-3])
    assert list(unpacked(data)) == [("numbers", 1.0)]
    data += both[-3:]
    assert list(unpacked(data)) == [("numbers", 2.0)]
    assert not data
