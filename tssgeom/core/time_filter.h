/* A filter in time of points that are sensed again and again; docs/model.md (156) to (159). */
#pragma once
#include "core.h"

/** Carry the filter over one frame of points [m].

Parameters: what it remembers, for each motion the positions [m], then for each the velocities [m per unit of time],
then the last two frames as sensed; probability of each motion; variance of a position, its covariance with the
velocity and the variance of that, over the variance of the noise; of the noise of the smooth part of the motion
and of the rest, values counted and their sum of squares [m²], then the last step; the points, NaN where one is
missing; the time since the last frame; a variance [m²] that the noise of the rest cannot exceed; how many of the
coordinates are sensed, the others being 0; and a unit vector of all coordinates, by whose component alone motions
are distinguished, or zeros for the smoothest components of each. Time is counted in usual steps.
Returns what it remembers then, in the same order; the filtered points; the squared distance of each
point from where it was expected, over the variance of the noise; the variance of a filtered coordinate and of a
sensed one [m²]; and the probability that the route stands. */
ENTRY void tss_filter_in_time(
    int64_t n, const double memory[16][n][3], const double probability[7], const double covariance[7][3],
    const double noise[5], const double points[n][3], double step, double most_variance, int64_t coordinates,
    const double direction[n][3],
    OUT double memory_after[16][n][3], OUT double probability_after[7], OUT double covariance_after[7][3],
    OUT double noise_after[5], OUT double filtered[n][3], OUT double innovation[n], OUT double *variance,
    OUT double *sensed_variance, OUT double *standing, WORK double work[11][n]);
