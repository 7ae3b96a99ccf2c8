"""Addresses of sources and sinks as the user writes them, and the permission to connect."""

from __future__ import annotations

import hmac
import ipaddress
import os
import select
import socket
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from urllib.parse import parse_qsl, urlsplit

from tssgeom.errors import SettingsError

SOURCES = "-, tcp://127.0.0.1:PORT, udp://127.0.0.1:PORT, igtl://HOST:18944 or replay:FILE?speed=2"
SINKS = "-, tcp://127.0.0.1:PORT, udp://127.0.0.1:PORT, igtl://127.0.0.1:PORT or none"

_SHORTEST_TOKEN, LONGEST_TOKEN = 16, 1024  # bytes; chosen: 16 random bytes cannot be guessed
_TOKEN_WAIT = 5.0  # s in which a pipe brings the token; chosen: a program that asks a store of secrets
_SOCKETS = ("tcp", "udp", "igtl")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One source or sink."""

    scheme: str
    """`-`, `none`, `replay`, `tcp`, `udp` or `igtl`."""
    text: str
    """As the user wrote it."""
    host: str = ""
    port: int = 0
    path: Path = Path()
    """The file to replay."""
    options: Mapping[str, str] = field(default_factory=dict)

    def speed(self) -> float:
        """Speed of a replay over that of the recording [1].

        Raises SettingsError where it is no number above 0.
        """
        text = self.options.get("speed", "1")
        try:
            speed = float(text)
        except ValueError:
            speed = 0.0
        if not speed > 0.0:
            raise SettingsError(f"{self.text}: speed is {text!r}: give a number > 0, or inf for no waiting")
        return speed

    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors along the route, proximal to distal, where the user gave them."""
        return tuple(name for name in self.options.get("sensors", "").split(",") if name)

    def at(self, address: tuple) -> str:
        """Return the text of the address that a socket is bound to."""
        host = f"[{address[0]}]" if ":" in address[0] else address[0]
        return f"{self.scheme}://{host}:{address[1]}"


def source_of(text: str) -> Endpoint:
    """Read the address of a source; raises SettingsError where the text is no such address."""
    if text == "-":
        return Endpoint("-", text)
    if text.startswith("replay:"):
        return _file(text)
    return _socket(text, SOURCES, "source", {"igtl": ("sensors",)})


def each_once(given: Sequence[str], option: str) -> Sequence[str]:
    """Refuse a value that is given twice to an option; raises SettingsError where there is one."""
    twice = [one for one in given if given.count(one) > 1]
    if twice:
        raise SettingsError(f"{option} {twice[0]} is given twice: give it once")
    return given


def sink_of(text: str) -> Endpoint:
    """Read the address of a sink; raises SettingsError where the text is no such address."""
    if text in ("-", "none"):
        return Endpoint(text, text)
    sink = _socket(text, SINKS, "sink", {})
    if sink.scheme == "udp" and not sink.port:
        raise SettingsError(f"--sink {text}: answers cannot be sent to port 0: give a port")
    return sink


def _file(text: str) -> Endpoint:
    path, mark, options = text.removeprefix("replay:").rpartition("?speed=")
    replay = Endpoint(
        "replay", text, path=Path(path if mark else options), options={"speed": options} if mark else {}
    )
    replay.speed()
    return replay


def _socket(text: str, known: str, what: str, options: Mapping[str, Collection[str]]) -> Endpoint:
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
        given = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)))
    except ValueError as error:
        raise SettingsError(f"--{what} {text}: {error}: give {known}") from error
    if parts.scheme not in _SOCKETS or not host or port is None or parts.path.strip("/") or parts.username:
        raise SettingsError(f"--{what} {text}: no {what} is written so: give {known}")
    if unknown := set(given) - set(options.get(parts.scheme, ())):
        raise SettingsError(f"--{what} {text}: unknown option {', '.join(sorted(unknown))}: give {known}")
    return Endpoint(parts.scheme, text, host, port, options=given)


@dataclass(frozen=True, slots=True)
class Access:
    """The permission to connect."""

    remote: bool = False
    """Whether addresses of other machines may be used."""
    token: bytes = b""
    """Bytes that a client has to send first; empty: none."""

    def admits(self, token: bytes) -> bool:
        """Whether this is the token; the comparison takes constant time."""
        return hmac.compare_digest(token.strip(), self.token)


def access(*, allow_remote: bool, token_file: Path | None) -> Access:
    """Read the permission to connect.

    Raises SettingsError where remote access has no token, or the token is too short or cannot be read.
    """
    if token_file is None:
        if allow_remote:
            raise SettingsError("--allow-remote needs --token-file FILE: each client has to send its token")
        return Access()
    try:
        token = _token_in(token_file)
    except OSError as error:
        raise SettingsError(f"{token_file}: cannot be read ({error.strerror}): check the path") from error
    if not _SHORTEST_TOKEN <= len(token) <= LONGEST_TOKEN or len(token.splitlines()) != 1:
        raise SettingsError(
            f"{token_file}: the token has {len(token)} bytes: write one line of {_SHORTEST_TOKEN} to "
            f"{LONGEST_TOKEN}, such as python -c 'import secrets; print(secrets.token_hex())'"
        )
    return Access(allow_remote, token)


def _token_in(path: Path) -> bytes:
    """Read a token; a pipe may take a while to bring it, and has no more than that."""
    file, until, data = os.open(path, os.O_RDONLY | os.O_NONBLOCK), monotonic() + _TOKEN_WAIT, b""
    try:
        while len(data) <= LONGEST_TOKEN and select.select([file], [], [], max(until - monotonic(), 0.0))[0]:
            if not (part := os.read(file, LONGEST_TOKEN + 1)):
                break
            data += part
    finally:
        os.close(file)
    return data.strip()


def resolved(endpoint: Endpoint, allowed: Access, kind: int) -> tuple[int, tuple]:
    """Return family and address of a socket.

    Raises SettingsError where the host is unknown, or is not this machine and remote access is not allowed.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(endpoint.host, endpoint.port, type=kind)[0]
    except OSError as error:
        raise SettingsError(f"{endpoint.text}: unknown host ({error.strerror}): check the name") from error
    if not allowed.remote and not ipaddress.ip_address(str(address[0]).partition("%")[0]).is_loopback:
        raise SettingsError(
            f"{endpoint.text}: {address[0]} is not this machine: use 127.0.0.1, "
            "or --allow-remote with --token-file"
        )
    return family, address
