/* Statistics that several parts use. */
#pragma once
#include "core.h"

void tss_isotonic_regression(
    int64_t n, const double x[n], const double weight[n], double result[n], double work[3][n]);
