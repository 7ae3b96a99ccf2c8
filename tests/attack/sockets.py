"""The attack on sockets, `python -m tests.attack.sockets [--seconds S]`: any bytes, in any pieces.

Changed frames and messages go to each socket of a stream: at once, in pieces with pauses, half of them, with
a size that is never sent, closed or reset. A good sender beside them has to go on. Each round has a new
stream; `--seed S --first N` begins with case N.
"""

from __future__ import annotations

import argparse
import signal
import socket
import struct
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from tests.attack.live import peak
from tests.attack.live_lines import HARD
from tests.attack.live_target import Target, hang
from tests.attack.mutations import mutated
from tests.attack.structures import rebuilt
from tests.attack.trial import LARGE
from tests.live_process import line, live, points_mm
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.states import read_state
from tssgeom.io.network.igtl import HEADER, checksum

CORPUS = Path(__file__).parent.parent / "live" / "corpus"
_ROUND = 60.0  # s of one stream; chosen: all its answers fit into memory
_PAUSE = 0.025  # s between cases: fewer connections in a second than are admitted
_HEADER = struct.Struct(">H12s20sIIQQ")
_SIZES = (0, 1, 57, 58, 1 << 10, 1 << 20, (1 << 20) + 1, 1 << 31, 1 << 63, (1 << 64) - 1)
_KINDS = (b"POINT", b"POLYDATA", b"POSITION", b"TRANSFORM", b"STRING", b"\xff")
_LINES = [line(points_mm(count, 0.0), 1.0) for count in (4, 12, 60)]


def sent_bytes(kind: str, random: np.random.Generator) -> bytes:
    """Return what one case sends: a message of OpenIGTLink, a line of JSON, or noise."""
    files = sorted(CORPUS.glob("igtl_*" if kind == "igtl" else "line_*"))
    raw = files[int(random.integers(len(files)))].read_bytes()
    way = int(random.integers(6))
    if way == 0:
        return random.bytes(int(random.integers(0, 3000)))
    if kind == "igtl":
        return _message(raw, random) if way < 5 else mutated(raw, random)
    if way < 4:
        good = _LINES[int(random.integers(len(_LINES)))]
        return rebuilt("frame.jsonl", good, random).replace(b"\n", b" ") + b"\n"
    return mutated(raw if way == 4 else line(next(iter(HARD.values()))(), 2.0), random) + b"\n"


def _message(raw: bytes, random: np.random.Generator) -> bytes:
    """Change a body under a sound header, or the header before a sound body."""
    version, kind, device, seconds, fraction, _, _ = _HEADER.unpack_from(raw)
    body = mutated(raw[HEADER:], random) if random.integers(3) else raw[HEADER:]
    size = len(body)
    match int(random.integers(6)):
        case 0:
            size = _SIZES[int(random.integers(len(_SIZES)))]
        case 1:
            kind = _KINDS[int(random.integers(len(_KINDS)))]
        case 2:
            version = int(random.integers(5))
        case 3:
            seconds, fraction = (int(each) for each in random.integers(0, 1 << 32, 2))
        case 4:
            device = random.bytes(20)
        case _:
            pass
    return _HEADER.pack(version, kind, device, seconds, fraction, size, checksum(body)) + body


class Round:
    """One stream, its good sender, and a server of OpenIGTLink that it connects to."""

    def __init__(self, target: Target, server: socket.socket) -> None:
        self.target, self.server = target, server

    def case(self, random: np.random.Generator) -> str:
        """Send something to a socket; return which one."""
        what = ("tcp source", "udp source", "tcp sink", "igtl sink", "igtl source")[int(random.integers(5))]
        scheme, side = what.split()
        data = b"".join(sent_bytes(scheme, random) for _ in range(int(random.integers(1, 4))))
        if what == "igtl source":
            with suppress(TimeoutError):  # the client waits longer after each failure
                sock, _ = self.server.accept()
                with sock:
                    sock.sendall((CORPUS / "igtl_point.bin").read_bytes())
                    _send(sock, data, random)
            return what
        port = self.target.stream.port(side, scheme)
        kind = socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM
        with socket.socket(socket.AF_INET, kind) as sock:
            sock.connect(("127.0.0.1", port))
            _send(sock, data[:60_000] if scheme == "udp" else data, random)
        return what


def _send(sock: socket.socket, data: bytes, random: np.random.Generator) -> None:
    """Send bytes in one of many manners; the peer may close the connection at any moment."""
    with suppress(OSError):
        match int(random.integers(5)):
            case 0:
                cuts = sorted(int(each) for each in random.integers(0, len(data) + 1, 4))
                for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
                    sock.sendall(data[begin:end])
                    time.sleep(float(random.uniform(0.0, 0.05)))
            case 1:
                sock.sendall(data[: int(random.integers(len(data) + 1))])
            case 2:
                sock.sendall(data[: int(random.integers(len(data) + 1))])
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            case 3:
                sock.sendall(data * int(random.integers(2, 20)))
            case _:
                sock.sendall(data)
                sock.settimeout(0.05)
                sock.recv(1 << 16)


def round_of(seconds: float, seed: int, first: int, folder: Path) -> Iterator[tuple[int, str]]:
    """Yield the number and the fault of each case of one stream; "" for none."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.3)
        other = f"igtl://127.0.0.1:{server.getsockname()[1]}"
        ends = [*("--source", "tcp://127.0.0.1:0", "--source", "udp://127.0.0.1:0", "--source", other)]
        ends += ["--sink", "tcp://127.0.0.1:0", "--sink", "igtl://127.0.0.1:0"]
        with live(*ends, "--state", folder / "state.json") as stream:
            target, until, number, said = Target(stream), time.monotonic() + seconds, first, 0
            attack = Round(target, server)
            while time.monotonic() < until and stream.alive:
                what = attack.case(np.random.default_rng([seed, number]))
                time.sleep(_PAUSE)
                begun = time.monotonic()
                goes_on = target.reaction(
                    lambda one: str(one.get("id")).startswith("good"), len(target.lines)
                )
                took = time.monotonic() - begun
                new, said = stream.errors[said:], len(stream.errors)
                wrong = [f"{what}: {text[:300]}" for text in new if "Traceback" in text or "Warning" in text]
                wrong += [] if goes_on and took < hang() else [f"{what}: hang: no answer for {took:.1f} s"]
                yield from ((number, each) for each in wrong or [""])
                number += 1
            target.end()
            memory, silence, missing = peak(stream), target.longest_silence(), target.missing()
            print(f"{target.summary()}, longest silence {silence:.2f} s; {memory >> 20} MiB", flush=True)  # noqa: T201
            wrong = [f"memory {memory >> 20} MiB"] * (memory > LARGE) + [f"lost {missing}"] * (missing > 0)
            wrong += [f"hang: silence of {silence:.1f} s"] if silence > hang() else []
            status = stream.stop(signal.SIGTERM)
            wrong += [f"status {status}: {stream.errors[-3:]}"] if status else []
            try:
                read_state(folder / "state.json")
            except TssgeomError as error:
                wrong.append(f"lost state: {error}")
            yield from ((number - 1, f"the end: {each}") for each in wrong)


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=_ROUND)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="case to begin with")
    given = parser.parse_args()
    number, faults, begun = given.first - 1, 0, time.monotonic()
    while (left := begun + given.seconds - time.monotonic()) > 0.0:
        with tempfile.TemporaryDirectory() as home:
            cases = round_of(min(left, _ROUND), given.seed, number + 1, Path(home))
            for number, fault in cases:
                if fault:
                    faults += 1
                    print(f"--seed {given.seed} --first {number}: {fault}", flush=True)  # noqa: T201
    print(f"{number + 1 - given.first} cases in {time.monotonic() - begun:.0f} s; {faults} faults")  # noqa: T201
    return int(bool(faults))


if __name__ == "__main__":
    raise SystemExit(main())
