/* Four numbers side by side, and 4 by 4 matrices of them by rows. */
#pragma once
#include "core.h"

typedef double Lanes __attribute__((vector_size(32)));
enum { LANES = 4 };
#define INLINE static inline __attribute__((always_inline))

INLINE Lanes all(double x) { return (Lanes){x, x, x, x}; }
INLINE Lanes load(const double x[4]) { return (Lanes){x[0], x[1], x[2], x[3]}; }
INLINE void store(Lanes v, double out[4]) {
    for (int l = 0; l < LANES; l++) out[l] = v[l];
}

/* Rows of the symmetric matrix of a triangle. */
INLINE void full(const double p[10], Lanes rows[4]) {
    rows[0] = (Lanes){p[0], p[1], p[2], p[3]};
    rows[1] = (Lanes){p[1], p[4], p[5], p[6]};
    rows[2] = (Lanes){p[2], p[5], p[7], p[8]};
    rows[3] = (Lanes){p[3], p[6], p[8], p[9]};
}

/* a0 times row 0 of a matrix, and so on, summed. */
INLINE Lanes combined(double a0, double a1, double a2, double a3, const Lanes rows[4]) {
    return a0 * rows[0] + a1 * rows[1] + a2 * rows[2] + a3 * rows[3];
}
