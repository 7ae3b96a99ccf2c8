/* Members of an ensemble that is shifted by readings: what they expect, how they drift. */
#pragma once
#include "core.h"

/** Return deviations of n members, each column with mean 0 and standard deviation 1; docs/model.md (204).

They are those of `random` [n, d], uncorrelated with `known` [n, m] and with each other; what is left of a column
that depends on those before it is 0. */
ENTRY void tss_deviations(
    int64_t n, int64_t d, int64_t m, const double random[n][d], const double known[n][m],
    OUT double deviation[n][d], WORK double work[1 + m + d][n]);

/** Compare c readings with what n members expect of them; docs/model.md (251).

Behind the members stand two of each of q drives, with one noise more and less of it than the first member.
`predicted` is what a channel should read, `others` all else that a reading shifts; `noise` the variances of the
channels; `drive` what each drive reads beyond its position, and the error of that, over its noise, and its way.
`felt` and `bent` are shares of the noise of a channel: by how much a drive that shows in it has to move it, and by how much
a drive may bend what is used. Returns the readings where the drives are, NaN where they are bent, and their variances;
how far they are off, and what noise, rig and drives explain of that at most, as a variance; how far one noise of each drive goes at most; of the readings that each
drive moves the least, in standard deviations and > 0 as if it were farther on its way, NaN where there is none; and
what the errors of all drives do to the channels and to the others. */
ENTRY void tss_compare_readings(
    int64_t n, int64_t q, int64_t c, int64_t e, const double predicted[n + 2 * q][c],
    const double others[n + 2 * q][e], const double given[c], const double noise[c], const double drive[q][3],
    double felt, double bent, OUT double reading[c], OUT double variance[c], OUT double off[c], OUT double greatest[c],
    OUT double farthest[q][c], OUT double lowest[q], OUT double by_drive[c], OUT double others_by_drive[e],
    WORK double moved[q][c]);

/** Compare how fast d numbers may drift, once readings have shifted them; docs/model.md (253), (269).

`numbers` [n, d] are those of the members, `span` the time whose drift each is to have now [s], `stated` the variances
of a drift in a second, `share` [s] the rates, over that, and `first` their probabilities at the start; `changes` is the
probability in a second that a rate becomes another [1/s]. Changed are the probability of each rate, value and variance
of its filter, and of each number what it was after the last drift: value, variance, variance between the rates, and the
share for which the members are made, which is at least `least_share` and at most `most_share`. Returns the standard deviation of
the drift that members are to have. */
ENTRY void tss_compare_drifts(
    int64_t n, int64_t d, int64_t s, const double numbers[n][d], const double span[d], const double stated[d],
    const double share[s], const double first[s], double changes, double least_share, double most_share,
    INOUT double chance[d][s], INOUT double mean[d][s], INOUT double spread[d][s], INOUT double last[d][4],
    OUT double sd[d]);

/** Return d numbers and their covariance, from `values` and `covariance` of members; docs/model.md (268).

`last` is that of `compare_drifts`; `beyond` what is known beyond the members: information, and in its last column the
product with the numbers, about the values and in the standard deviations of `last`. */
ENTRY void tss_known_numbers(
    int64_t d, const double values[d], const double covariance[d][d], const double last[d][4],
    const double beyond[d][d + 1], OUT double known[d], OUT double spread[d][d],
    WORK double work[5 * d * d + 2 * d]);

/** Return `beyond` of `known_numbers`, from what is known and the members' values and covariance after a drift. */
ENTRY void tss_known_beyond(
    int64_t d, const double values[d], const double covariance[d][d], const double known[d],
    const double spread[d][d], const double last[d][4], OUT double beyond[d][d + 1],
    WORK double work[5 * d * d + 2 * d]);
