"""Whatever bytes arrive, every decoder gives a frame or one line with the fault.

The corpus holds lines and messages, good and bad; hypothesis cuts, joins and changes them.
"""

import math
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyigtl.messages import CRC64

from tssgeom.errors import SettingsError, ShapeError, TssgeomError
from tssgeom.io.formats.jsonl import frame_or_refusal
from tssgeom.io.formats.paths import LONGEST_LINE
from tssgeom.io.formats.states import read_state
from tssgeom.io.network.addresses import sink_of, source_of
from tssgeom.io.network.igtl import HEADER, Message, header_of, message_of
from tssgeom.io.network.igtl_peers import first_string
from tssgeom.io.network.mailbox import Arrival, Lines, Mailbox, Sender
from tssgeom.io.network.sources import Replay
from tssgeom.stream import Frame, Rejected

Read = TypeVar("Read")
CORPUS = {path.stem: path.read_bytes() for path in sorted((Path(__file__).parent / "corpus").glob("*.bin"))}
LINES = [data for name, data in CORPUS.items() if name.startswith("line")]
MESSAGES = [data for name, data in CORPUS.items() if name.startswith("igtl")]
ADDRESSES = r"(tcp|udp|igtl|replay):/{0,2}[\w.:\[\]?=,@-]{0,30}"
STATES = (b"null", b"[]", b'{"version": 1}', b'{"version": 1, "kind": "corners", "along": {}}')
QUICK = settings(max_examples=150, deadline=None)


@st.composite
def damaged(draw: st.DrawFn, originals: list[bytes]) -> bytes:
    """Draw an original with bytes changed, cut out or put in, or bytes of no origin."""
    data = bytearray(draw(st.sampled_from(originals)))
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(data)))
        until = min(at + draw(st.integers(0, 40)), len(data))
        data[at:until] = draw(st.binary(max_size=40))
    return bytes(data)


def outcome(read: Callable[[], Read]) -> Read | str:
    """What was read, or the reason why not."""
    try:
        return read()
    except TssgeomError as error:
        return str(error)


@QUICK
@given(damaged(LINES), st.sampled_from([None, "mm"]))
@example(b'{"t": 1, "unit": "mm", "points": ' + b"[" * 500_000, None)
@example(b'{"t": 1, "points": [[1e400, 1, 1]], "unit": "mm"}', None)
@example(b'{"t": 1, "points": [[1, 1, 1]], "unit": "mm", "id": ' + b"9" * 400 + b"}", None)
@example(b"x" * (LONGEST_LINE + 1), None)
def test_a_line_gives_a_frame_or_a_reason(text, unit):
    result = frame_or_refusal(text, unit)
    if isinstance(result, Rejected):
        assert result.reason
        assert "\n" not in result.reason
    else:
        assert result.points.dtype == np.float64
        assert result.points.shape[1:] == (3,)


@QUICK
@given(damaged(MESSAGES), st.booleans())
def test_a_message_gives_positions_or_a_reason(data, mended):
    """With `mended`, the checksum is made right, so that the content is read."""
    result = outcome(lambda: message_in(data, mended))
    assert isinstance(result, str | None) or result.positions.shape[1:] == (3,)


def message_in(data: bytes, mended: bool) -> Message | None:
    header = header_of(data)
    body = data[HEADER : HEADER + header.size]
    if mended:
        header = header_of(data[:50] + CRC64(body).to_bytes(8, "big"))
    return message_of(header, body)


@QUICK
@given(damaged(MESSAGES))
def test_a_greeting_gives_a_token_or_is_waited_for(data):
    result = first_string(data)
    assert result is None or all(isinstance(part, bytes) for part in result)


@QUICK
@given(st.lists(damaged(LINES), max_size=5), st.lists(st.integers(1, 2000), min_size=1, max_size=8))
def test_lines_are_the_same_however_their_bytes_arrive(parts, sizes):
    whole = b"".join(part if part.endswith(b"\n") else part + b"\n" for part in parts)
    pieces, lines, at = Lines(), list[bytes](), 0
    for size in cycle(sizes):
        if at >= len(whole):
            break
        lines += pieces.split(whole[at : at + size])[0]
        at += size
    assert lines == [text for text in whole.split(b"\n") if text.strip()]


def test_of_a_line_without_end_no_more_is_kept_than_a_line_may_have():
    pieces = Lines()
    for _ in range(16):
        pieces.split(b"x" * (1 << 16))
    with pytest.raises(ShapeError, match="1048576 bytes"):
        pieces.split(b"x")
    for _ in range(100):
        pieces.split(b"x" * (1 << 16))
    assert len(pieces.rest) <= LONGEST_LINE
    assert pieces.split(b"the end of it\nnext\n")[0] == [b"next"]


@QUICK
@given(st.lists(damaged(LINES), min_size=1, max_size=40))
def test_every_frame_is_answered_rejected_or_counted(texts):
    mailbox, sender, reported = Mailbox(), Sender(), 0
    for text in texts:
        mailbox.post(sender, lambda text=text: frame_or_refusal(text, None))
    while len(mailbox):
        arrival = mailbox.newest()
        reported += len(arrival.rejected) + isinstance(arrival, Arrival)
    assert reported + mailbox.dropped == mailbox.arrived == len(texts)


@QUICK
@given(
    st.text(max_size=40) | st.from_regex(r"(tcp|udp|igtl|replay):/{0,2}[\w.:\[\]?=,@-]{0,30}", fullmatch=True)
)
def test_an_address_is_understood_or_refused_in_one_line(text):
    for read in (source_of, sink_of):
        result = outcome(lambda read=read: read(text))
        assert isinstance(result, str) or result.scheme in ("-", "none", "tcp", "udp", "igtl", "replay")


@settings(max_examples=50, deadline=None)
@given(
    st.binary(max_size=200) | st.just(b"null") | st.just(b'{"version": 1, "kind": "corners", "along": {}}')
)
def test_a_state_file_is_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("state") / "state.json"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match="start anew"):
        read_state(path)


def test_points_and_names_beyond_all_measure_are_refused():
    mailbox, sender = Mailbox(), Sender()
    mailbox.post(sender, lambda: Frame(np.zeros((20_000, 3)), 1.0))
    mailbox.post(sender, lambda: Frame(np.zeros((5, 3)), 2.0, id="x" * 1000))
    mailbox.post(sender, lambda: Frame(np.zeros((5, 3)), math.nan))
    arrivals = [mailbox.newest() for _ in range(3)]  # one is decoded at a time
    assert [len(one.rejected) for one in arrivals] == [0, 0, 3]
    reasons = [one.reason for one in arrivals[-1].rejected]
    assert [next(word for word in ("20000", "1000", "nan") if word in one) for one in reasons] == [
        "20000",
        "1000",
        "nan",
    ]


def test_a_replay_reports_what_is_not_read_of_its_file(tmp_path):
    path = tmp_path / "run.jsonl"
    path.write_text('{"t": 0, "unit": "mm", "points": [[0,0,0],[1,0,0],[2,0,0],[3,1,0]], "colour": "red"}\n')
    replay = Replay(Mailbox(), source_of(f"replay:{path}"), None)
    assert replay.notes == ("'colour' is not read",)
