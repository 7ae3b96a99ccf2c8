"""CRC-64 of ECMA-182 in plain Python, bit by bit: what `core.crc64` has to return."""

_POLYNOMIAL = 0x42F0E1EBA9EA3693


def crc64_of(text: bytes) -> int:
    """Return the remainder of the bits, highest first, followed by 64 zeros."""
    crc = 0
    for byte in text:
        for bit in range(7, -1, -1):
            carried = (crc >> 63) ^ (byte >> bit & 1)
            crc = (crc << 1 & (1 << 64) - 1) ^ (_POLYNOMIAL if carried else 0)
    return crc
