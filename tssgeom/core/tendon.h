/* Tension and elongation of the tendon: corner lists on a fixed route, bars elsewhere and with effects.

   A route is p pieces of constant curvature: length [m], angle [rad], covariance of all lengths followed by
   all angles. A tendon of bars has k contacts with the sheath and k + 1 bars: bar 0 drives the proximal end,
   the last one is what the distal end pulls against; `edge` [k] is where the others are cut, as fractions of
   the length from 0 to 1. A `plant` is the rows of LAW, the numbers of PLANT and the tables of CURVE, a `memory`
   the rows of MEMORY followed by the numbers of HELD (constants_tendon_rows.py); each row is k + 1 long. */
#pragma once
#include "core.h"

/* What a step returns where it does not return a status. */
enum { STEPPED = 0, RUNS_AWAY = 3, STUCK_FAST = 4 };

int64_t tss_is_unmoved(
    int64_t p, const double length[p], const double angle[p], const double covariance[2 * p][2 * p],
    int64_t q, const double length_now[q], const double angle_now[q],
    const double covariance_now[2 * q][2 * q]);
