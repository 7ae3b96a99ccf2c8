"""The checksum of a message: the compiled entry against its twin, and the value that the catalogue states."""

import numpy as np

from tests.core.twins.checksum import crc64_of
from tssgeom import core


def compiled(text: bytes) -> int:
    return core.crc64(np.frombuffer(text, np.uint8)) % (1 << 64)


def test_the_checksum_of_random_bytes_is_that_of_the_twin():
    rng = np.random.default_rng(0)
    for size in range(200):
        text = rng.bytes(size)
        assert compiled(text) == crc64_of(text)


def test_the_checksum_of_nine_digits_is_that_of_the_catalogue():
    assert compiled(b"123456789") == 0x6C40DF5F0B497347  # CRC-64/ECMA-182, "check"
