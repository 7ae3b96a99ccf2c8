#include "core.h"

static const uint64_t POLYNOMIAL = 0x42F0E1EBA9EA3693;

/** CRC-64 of bytes [n], as OpenIGTLink has it: the polynomial of ECMA-182, begun at 0, highest bit first.

Returns its 64 bits as a signed number. */
ENTRY int64_t tss_crc64(int64_t n, const char bytes[n]) {
    uint64_t of_byte[256], crc = 0;
    for (uint64_t i = 0; i < 256; i++) {
        of_byte[i] = i << 56;
        for (int bit = 0; bit < 8; bit++)
            of_byte[i] = (of_byte[i] << 1) ^ (of_byte[i] >> 63 ? POLYNOMIAL : 0);
    }
    for (int64_t i = 0; i < n; i++) crc = (crc << 8) ^ of_byte[(crc >> 56) ^ (uint8_t)bytes[i]];
    return (int64_t)crc;
}
