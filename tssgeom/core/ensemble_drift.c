/* How fast followed numbers drift: a filter of each for every rate, and the probability of each rate.

   docs/model.md (253), (268), (269). */
#include "core.h"

#include <string.h>

#include "arcs.h"
#include "tendon_bars.h"

enum { OF_VALUE, OF_VARIANCE, OF_RATES, OF_SHARE, KEPT }; /* what is kept of a number */

/* Logarithm of how well a rate expected a reading, but for a constant; docs/model.md (269). */
static double log_chance(double off, double expected) {
    return -0.5 * (least(off * off / expected, squared(CHANCE.never)) + log(expected));
}

/* Let each rate take in what members have read since the last drift, as one reading; docs/model.md (253), (269). */
static void read_number(
    int64_t s, double value, double variance, const double last[KEPT], double chance[s], double mean[s],
    double spread[s]) {
    double before = last[OF_VARIANCE], highest = -INFINITY, sum = 0.0;
    if (!(variance > 0.0 && variance < (1.0 - ROUNDING.relative) * before)) return;
    double reading = last[OF_VALUE] + (value - last[OF_VALUE]) * before / (before - variance);
    double noise = before * variance / (before - variance);
    for (int64_t j = 0; j < s; j++)
        highest = most(log_chance(reading - mean[j], spread[j] + noise), highest);
    for (int64_t j = 0; j < s; j++) {
        double expected = spread[j] + noise, off = reading - mean[j], gain = spread[j] / expected;
        sum += chance[j] *= exp(log_chance(off, expected) - highest);
        mean[j] += gain * off, spread[j] *= 1.0 - gain;
    }
    for (int64_t j = 0; j < s; j++) chance[j] /= sum;
}

/* Let a share of each rate's probability become that of another one, with its filter; docs/model.md (269).

   Returns the variance between the rates. */
static double change(
    int64_t s, double share, const double first[s], double chance[s], double mean[s], double spread[s]) {
    double middle = row_dot(s, chance, mean), between = 0.0, whole = row_dot(s, chance, spread);
    for (int64_t j = 0; j < s; j++) between += chance[j] * squared(mean[j] - middle);
    whole += between;
    for (int64_t j = 0; j < s; j++) {
        double stays = (1.0 - share) * chance[j], comes = share * first[j];
        if (!(stays + comes > 0.0)) continue;
        double part = comes / (stays + comes), apart = middle - mean[j];
        spread[j] += part * (whole - spread[j] + (1.0 - part) * squared(apart));
        mean[j] += part * apart, chance[j] = stays + comes;
    }
    return between;
}

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
    OUT double sd[d]) {
    for (int64_t i = 0; i < d; i++) {
        double value = 0.0, variance = 0.0, *kept = last[i];
        for (int64_t j = 0; j < n; j++) value += numbers[j][i];
        value /= (double)n;
        for (int64_t j = 0; j < n; j++) variance += squared(numbers[j][i] - value);
        variance /= (double)(n - 1);
        if (isnan(kept[OF_VARIANCE])) {
            for (int64_t j = 0; j < s; j++) mean[i][j] = value, spread[i][j] = variance;
            kept[OF_VALUE] = value, kept[OF_VARIANCE] = variance;
        }
        read_number(s, value, variance, kept, chance[i], mean[i], spread[i]);
        kept[OF_RATES] = change(s, least(changes * span[i], 1.0), first, chance[i], mean[i], spread[i]);
        for (int64_t j = 0; j < s; j++) spread[i][j] += share[j] * stated[i] * span[i];
        kept[OF_SHARE] = within(row_dot(s, chance[i], share), least_share, most_share);
        double added = kept[OF_SHARE] * stated[i] * span[i];
        sd[i] = sqrt(added), kept[OF_VALUE] = value, kept[OF_VARIANCE] = variance + added;
    }
}

/* Inverse of a covariance [d, d]. */
static void invert(int64_t d, const double covariance[], double result[], Work w) {
    double *lower = take(&w, d * d), *unit = take(&w, d), *same = take(&w, d * d);
    factor(d, covariance, 0.0, lower, unit);
    for (int64_t i = 0; i < d * d; i++) same[i] = i % (d + 1) == 0;
    propagated(d, lower, unit, d, same, result, w);
}

/* Standard deviation of members after the last drift, the unit of what is known beyond them. */
static double unit_of(const double last[KEPT]) {
    return last[OF_VARIANCE] > 0.0 ? sqrt(last[OF_VARIANCE]) : 1.0;
}

/** Return d numbers and their covariance, from `values` and `covariance` of members; docs/model.md (268).

`last` is that of `compare_drifts`; `beyond` what is known beyond the members: information, and in its last column the
product with the numbers, about the values and in the standard deviations of `last`. */
ENTRY void tss_known_numbers(
    int64_t d, const double values[d], const double covariance[d][d], const double last[d][4],
    const double beyond[d][d + 1], OUT double known[d], OUT double spread[d][d],
    WORK double work[5 * d * d + 2 * d]) {
    Work w = {work};
    double *information = take(&w, d * d), *pull = take(&w, d);
    memcpy(known, values, (size_t)d * sizeof *known);
    memcpy(spread, covariance, (size_t)(d * d) * sizeof **spread);
    for (int64_t i = 0; i < d; i++)
        if (isnan(last[i][OF_VARIANCE])) return; /* members are all that is known */
    invert(d, covariance[0], information, w);
    for (int64_t i = 0; i < d; i++) {
        pull[i] = beyond[i][d] / unit_of(last[i]);
        for (int64_t j = 0; j < d; j++) {
            double more = beyond[i][j] / (unit_of(last[i]) * unit_of(last[j]));
            pull[i] -= more * (values[j] - last[j][OF_VALUE]), information[i * d + j] += more;
        }
    }
    invert(d, information, spread[0], w);
    for (int64_t i = 0; i < d; i++) known[i] += row_dot(d, spread[i], pull);
}

/** Return `beyond` of `known_numbers`, from what is known and the members' values and covariance after a drift. */
ENTRY void tss_known_beyond(
    int64_t d, const double values[d], const double covariance[d][d], const double known[d],
    const double spread[d][d], const double last[d][4], OUT double beyond[d][d + 1],
    WORK double work[5 * d * d + 2 * d]) {
    Work w = {work};
    double *information = take(&w, d * d), *of_members = take(&w, d * d);
    invert(d, spread[0], information, w), invert(d, covariance[0], of_members, w);
    for (int64_t i = 0; i < d; i++) {
        beyond[i][d] = 0.0;
        for (int64_t j = 0; j < d; j++) {
            double in_units = unit_of(last[i]) * unit_of(last[j]);
            beyond[i][j] = (information[i * d + j] - of_members[i * d + j]) * in_units;
            beyond[i][d] += information[i * d + j] * (known[j] - values[j]) * unit_of(last[i]);
        }
    }
}
