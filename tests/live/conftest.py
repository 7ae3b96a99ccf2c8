"""One stream for the tests that can share it, with a peer at each of its ends."""

import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from pipelines.cli import main
from tests.live.peers import synchronised
from tests.live_process import PATIENCE, Live, Reader, live


class Outcome(NamedTuple):
    """How a command that did not start ended."""

    status: int
    errors: list[str]


class Shared(NamedTuple):
    """A running stream, and sockets at its ends."""

    stream: Live
    datagrams: socket.socket
    """Receives what its UDP sink sends."""
    server: socket.socket
    """Listens at the address of its OpenIGTLink source."""


@pytest.fixture(scope="session")
def shared() -> Iterator[Shared]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams,
        socket.create_server(("127.0.0.1", 0)) as server,
    ):
        datagrams.bind(("127.0.0.1", 0))
        datagrams.settimeout(PATIENCE)
        server.settimeout(PATIENCE)
        here = "127.0.0.1"
        ends = [
            *("--source", f"tcp://{here}:0", "--source", f"udp://{here}:0"),
            *("--source", f"igtl://{here}:{server.getsockname()[1]}"),
            *("--sink", f"tcp://{here}:0", "--sink", f"udp://{here}:{datagrams.getsockname()[1]}"),
            *("--sink", f"igtl://{here}:0"),
        ]
        with live(*ends) as stream:
            yield Shared(stream, datagrams, server)
            assert stream.stop() == 0
            assert not any("Traceback" in text for text in stream.errors)


@pytest.fixture
def stream(shared: Shared) -> Live:
    return shared.stream


@pytest.fixture
def source(stream: Live) -> Iterator[socket.socket]:
    with stream.source() as sock:
        yield sock


@pytest.fixture
def reader(stream: Live, source: socket.socket) -> Iterator[Reader]:
    """A client that is known to be connected: it has read the answer to a frame."""
    client = stream.reader()
    with client.sock:
        synchronised(stream, client)
        yield client


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run the program as the console script does, in this process."""

    def run_command(*arguments: str | Path) -> Outcome:
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        errors = capsys.readouterr().err.splitlines()
        return Outcome(int(ended.value.code or 0), errors)

    return run_command


@pytest.fixture
def free_port() -> int:
    """A port that nothing listens on."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]
