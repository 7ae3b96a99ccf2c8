"""Peers that are not what they should be: a browser, a sensor with any name, clients that send nothing."""

import json
import selectors
import socket
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
import pyigtl
import pytest

from tests.live.peers import frame, half_circle
from tests.live.test_igtl import transform
from tests.live_process import PATIENCE, live
from tssgeom.io.network import mailbox as mailboxes
from tssgeom.io.network.addresses import Access, Endpoint
from tssgeom.io.network.channel import Channel
from tssgeom.io.network.datagrams import UdpSource
from tssgeom.io.network.listener import LIMITS
from tssgeom.io.network.mailbox import Arrival, Mailbox, Sender
from tssgeom.stream import Frame, Rejected

EVERY_ADDRESS = "00000000"  # 0.0.0.0 in /proc/net/udp


def test_a_request_of_a_browser_is_refused_and_its_body_is_no_frame(stream, source, reader):
    body = frame(1.0, id="by HTTP")
    request = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n" % len(body)
    others = (b"\r\n" + request, b"PROPFIND" + request[4:], b"get http://localhost" + request[5:])
    for parts in ((request + body,), (request[:9], request[9:] + body), *((one, body) for one in others)):
        with stream.source() as browser:
            browser.settimeout(PATIENCE)
            for part in parts:
                browser.sendall(part)
                time.sleep(0.1)
            assert "no web server" in json.loads(browser.recv(1000))["closed"]
    source.sendall(frame(2.0, id="by TCP"))
    answers = reader.until("id", "by TCP")
    assert "by HTTP" not in [one.get("id") for one in answers]
    assert not [one for one in answers if "rejected" in one]


def test_a_request_of_a_browser_to_a_sink_is_refused(stream, source, reader):
    with socket.create_connection(("127.0.0.1", stream.port("sink", "tcp")), PATIENCE) as browser:
        browser.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        last = b""
        while chunk := browser.recv(1 << 16):
            last += chunk
        assert "no web server: connect, and read" in json.loads(last.splitlines()[-1])["closed"]


def test_the_flood_of_one_sender_leaves_another_its_turns():
    mailbox, flood, good, answered = Mailbox(), Sender(), Sender(), 0
    for turn in range(400):
        for _ in range(50):
            mailbox.post(flood, lambda: Rejected(0, 0.0, "bad"))
        if turn % 4 == 0:
            mailbox.post(good, lambda turn=turn: Frame(half_circle(), float(turn)))
        arrival = mailbox.newest()
        mailbox.charge(arrival.sender, 1e-3)
        answered += isinstance(arrival, Arrival)
    assert answered >= 99
    assert len(mailbox) == 1


def test_a_flood_that_begins_late_has_no_time_saved_from_before():
    mailbox, flood, good, answered = Mailbox(), Sender(), Sender(), 0
    for turn in range(1200):
        for _ in range(50 if turn >= 1000 else 0):
            mailbox.post(flood, lambda: Rejected(0, 0.0, "bad"))
        if turn < 1000 or turn % 4 == 0:
            mailbox.post(good, lambda turn=turn: Frame(half_circle(), float(turn)))
        arrival = mailbox.newest()
        mailbox.charge(arrival.sender, 1e-3)
        if isinstance(arrival, Arrival):
            arrival.sender.answered(arrival.frame.time, 0.0, leapt=False)
            answered += 1
    assert answered >= 1000 + 49


def test_the_frames_of_a_sender_that_is_forgotten_are_dropped():
    mailbox, gone = Mailbox(), Sender()
    for _ in range(3):
        mailbox.post(gone, lambda: Rejected(0, 0.0, "bad"))
    mailbox.newest()
    mailbox.forget(gone)
    assert (len(mailbox), mailbox.dropped, mailbox.arrived) == (0, 3, 3)


def test_clients_that_say_nothing_give_way_to_one_that_does(stream, source, reader):
    with ExitStack() as stack:
        for _ in range(LIMITS.peers):
            stack.enter_context(stream.source())
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            source.sendall(frame(time.monotonic(), id="busy"))  # not silent: it stays
            time.sleep(0.2)  # fewer connections in a second than are admitted
            with stream.source() as late:
                late.sendall(frame(1.0, id="late"))
                late.settimeout(0.5)
                try:
                    refused = late.recv(1000)
                except TimeoutError:
                    break
                except ConnectionError:
                    continue
                assert b"which is the most" in refused
        else:
            raise AssertionError("no client gave way")
    source.sendall(frame(time.monotonic(), id="end"))
    answers = reader.until("id", "end")
    assert any(one.get("id") == "late" and "segments" in one for one in answers)


def test_a_sensor_may_have_any_name():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE)
        source = f"igtl://127.0.0.1:{server.getsockname()[1]}"
        with live("--source", source, "--sink", "-") as stream:
            peer, _ = server.accept()
            with peer:
                for moment in (1.0, 2.0, 3.0):
                    for name, position in zip(("²", "٣", "1a", "a", ""), half_circle(5), strict=True):
                        message = bytearray(transform("x", position, moment))
                        message[14:34] = name.encode().ljust(20, b"\0")
                        peer.sendall(message)
                answer = json.loads(stream.output.readline())
                assert "t" in answer
                whole = pyigtl.PointMessage(half_circle(29), timestamp=4.0, device_name="²")
                peer.sendall(whole.pack())
                while answer["t"] != 4.0:
                    answer = json.loads(stream.output.readline())
                assert answer["length_m"] > 0.4
            assert stream.stop() == 0


def test_a_sink_of_datagrams_listens_on_no_interface_but_its_own():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader:
        reader.bind(("127.0.0.1", 0))
        port = reader.getsockname()[1]
        with live("--source", "tcp://127.0.0.1:0", "--sink", f"udp://127.0.0.1:{port}") as stream:
            with stream.source() as source:
                source.sendall(frame(1.0, id="sent"))
                reader.settimeout(PATIENCE)
                while json.loads(reader.recv(1 << 16)).get("id") != "sent":  # a busy machine is late
                    pass
            names = list[str]()
            for link in Path(f"/proc/{stream.process.pid}/fd").iterdir():
                with suppress(FileNotFoundError):  # closed meanwhile
                    names.append(link.readlink().name)
            inodes = {name.removeprefix("socket:[").rstrip("]") for name in names if "socket" in name}
            rows = [row.split() for row in Path("/proc/net/udp").read_text().splitlines()[1:]]
            bound = [row[1].partition(":")[0] for row in rows if row[9] in inodes]
            assert bound
            assert EVERY_ADDRESS not in bound


def test_a_sink_of_datagrams_without_a_reader_stops_nothing(free_port):
    with live("--source", "tcp://127.0.0.1:0", "--sink", f"udp://127.0.0.1:{free_port}") as other:
        with other.source() as sender:
            for i in range(20):
                sender.sendall(frame(float(i)))
                time.sleep(0.02)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as late:
            late.bind(("127.0.0.1", free_port))
            late.settimeout(PATIENCE)
            with other.source() as sender:
                sender.sendall(frame(1.0, id="heard"))
                while json.loads(late.recv(1 << 16)).get("id") != "heard":
                    pass
        assert other.stop() == 0


def test_the_time_that_a_flood_takes_to_be_read_is_its_own():
    """Else the sender whose frames take longer to fit waits for each datagram of the flood."""
    mailbox = Mailbox()
    with selectors.DefaultSelector() as selector, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood:
        source = UdpSource(selector, mailbox, Endpoint("udp", "udp://", "127.0.0.1"), Access(), None)
        flood.connect(("127.0.0.1", int(source.text.rpartition(":")[2])))
        for _ in range(500):
            flood.send(b'{"t":1}')
            for key, events in selector.select(0.0):
                key.data(events)
        flooding = mailbox.newest().sender
        source.close()
    assert flooding.arrived == 500
    assert flooding.used > 500 * 1e-7  # s; a call of the system alone takes longer


def test_a_sender_is_not_read_while_a_frame_of_one_that_took_less_time_waits():
    """Else reading the flood takes the time in which the frame would be answered."""
    mailbox, good = Mailbox(), Sender(latest=0.0)
    with selectors.DefaultSelector() as selector, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood:
        source = UdpSource(selector, mailbox, Endpoint("udp", "udp://", "127.0.0.1"), Access(), None)
        flood.connect(("127.0.0.1", int(source.text.rpartition(":")[2])))

        def arrived() -> int:
            for _ in range(3):
                flood.send(b'{"t":1}')
                for key, events in selector.select(0.0):
                    key.data(events)
            return mailbox.arrived

        assert arrived() == 3
        mailbox.post(good, lambda: Frame(half_circle(), 1.0))
        mailbox.charge(mailbox.newest().sender, 1.0)
        before = mailbox.arrived
        mailbox.post(good, lambda: Frame(half_circle(), 2.0))
        assert arrived() > before + 1  # the good sender took more time
        while mailbox.newest().sender is not good:
            pass
        mailbox.charge(Sender(), 2.0)
        mailbox.post(good, lambda: Frame(half_circle(), 3.0))
        before = mailbox.arrived
        assert arrived() == before
        assert mailbox.newest().sender is good
        assert arrived() >= before + 3
        source.close()


def test_bytes_wait_in_the_system_while_others_come_first():
    ours, theirs = socket.socketpair()
    has_to_wait, received = [True], list[bytes]()
    with theirs, selectors.DefaultSelector() as selector:
        channel = Channel(selector, ours, received.append, list, has_to_wait=lambda: has_to_wait[0])
        theirs.sendall(b"a frame")
        for waits in (True, False):
            has_to_wait[0] = waits
            for key, events in selector.select(0.0):
                key.data(events)
            assert bool(received) != waits
        channel.close()


def test_bad_frames_of_a_flood_are_reported_a_few_at_a_time():
    """They waited until none came any more: hundreds were reported at once, for up to 80 ms."""
    mailbox, flood, most, reported = Mailbox(), Sender(), 0, 0
    for _ in range(300):
        mailbox.post(flood, lambda: Rejected(0, 0.0, "bad"))
        mailbox.post(flood, lambda: Rejected(0, 0.0, "bad"))
        one = mailbox.newest()
        most, reported = max(most, len(one.rejected)), reported + len(one.rejected)
    assert most == mailboxes.LIMITS.waiting
    while len(mailbox):
        reported += len(mailbox.newest().rejected)
    assert reported + mailbox.dropped == mailbox.arrived == 600


@pytest.mark.parametrize("size", [1, 1000, 50_000])
def test_messages_that_a_peer_does_not_take_at_once_all_come_in_their_order(size):
    ours, theirs = socket.socketpair()
    lost, rng = list[int](), np.random.default_rng(size)
    messages = [rng.bytes(int(rng.integers(1, 2 * size))) for _ in range(400)]
    with theirs, selectors.DefaultSelector() as selector:
        channel = Channel(selector, ours, list, lambda: lost.append(1), 1 << 30)
        assert all(channel.send(one) for one in messages)
        wanted, received = b"".join(messages), bytearray()
        while len(received) < len(wanted):
            received += theirs.recv(10_007)
            for key, events in selector.select(0.0):
                key.data(events)
        assert received == wanted
        assert channel.waiting == 0
        assert [key.events for key in selector.get_map().values()] == [selectors.EVENT_READ]
        channel.close()
    assert not lost
