/* Statistics that several parts use. */
#pragma once
#include "core.h"

/** Return the nearest non-decreasing sequence in weighted least squares (pool adjacent violators).

Parameters: values and positive weights [n]. */
ENTRY void tss_isotonic_regression(
    int64_t n, const double x[n], const double weight[n], OUT double result[n], WORK double work[3][n]);

/** Return the median of some numbers [n]. */
ENTRY double tss_median(int64_t n, const double values[n], WORK double work[n]);
