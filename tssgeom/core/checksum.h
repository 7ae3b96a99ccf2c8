/* Checksum of a message. */
#pragma once
#include "core.h"

/** CRC-64 of bytes [n], as OpenIGTLink has it: the polynomial of ECMA-182, begun at 0, highest bit first.

Returns its 64 bits as a signed number. */
ENTRY int64_t tss_crc64(int64_t n, const char bytes[n]);
