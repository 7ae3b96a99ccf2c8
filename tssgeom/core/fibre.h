/* Curvatures sensed along a fibre; docs/model.md (36). */
#pragma once
#include "core.h"

/** Average all partitions of n gratings into pieces of constant curvature, and find the likeliest; (36).

Joints come at random with a rate a metre, half of the pieces are straight, the others have curvature
components of a variance [1/m²]. Sums over all partitions take time quadratic in n (Barry and Hartigan 1992).

s [n]: arc lengths [m]; bend [n][2]: components [1/m]; precision [n]: of each component [m²]; cell [n + 1]:
bounds of the stretch that each grating stands for [m]. Returned are ln of the evidence, mean [rad] and
variance [rad²] of the whole angle, and of the likeliest partition before each grating, and at the end,
where its last piece begins, and whether that is curved [n + 1]. */
ENTRY void tss_average_partitions(
    int64_t n, const double s[n], const double bend[n][2], const double precision[n],
    const double cell[n + 1], double rate, double variance, OUT double *log_evidence, OUT double *mean,
    OUT double *angle_variance, OUT int64_t origin[n + 1], OUT uint8_t curved[n + 1],
    WORK double work[14 * n + 12]);
