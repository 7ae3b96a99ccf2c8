/* How fast followed numbers drift: a filter of each for every rate, and the probability of each rate.

   docs/model.md (253), (268), (269). */
#include "ensemble.h"

#include "tendon_bars.h"

enum { OF_VALUE, OF_VARIANCE, OF_RATIO, OF_SHARE }; /* what is kept of a number */

/* Logarithm of how well a rate expected a reading, but for a constant; docs/model.md (269). */
static double log_chance(double off, double expected) {
    return -0.5 * (least(off * off / expected, squared(CHANCE.never)) + log(expected));
}

/* Let each rate take in what members have read since the last drift, as one reading; docs/model.md (253), (269). */
static void read_number(
    int64_t s, double value, double variance, const double last[4], double chance[s], double mean[s],
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

void tss_compare_drifts(
    int64_t n, int64_t d, int64_t s, const double numbers[n][d], const double span[d], const double stated[d],
    const double share[s], const double first[s], double changes, double least_share, double most_share,
    double chance[d][s], double mean[d][s], double spread[d][s], double last[d][4], double sd[d]) {
    for (int64_t i = 0; i < d; i++) {
        double value = 0.0, variance = 0.0, off = 0.0, *kept = last[i];
        for (int64_t j = 0; j < n; j++) value += numbers[j][i];
        value /= (double)n;
        for (int64_t j = 0; j < n; j++) variance += squared(numbers[j][i] - value);
        variance /= (double)(n - 1);
        if (isnan(kept[OF_VARIANCE])) {
            for (int64_t j = 0; j < s; j++) mean[i][j] = value, spread[i][j] = variance;
            kept[OF_VALUE] = value, kept[OF_VARIANCE] = variance;
        }
        read_number(s, value, variance, kept, chance[i], mean[i], spread[i]);
        for (int64_t j = 0; j < s; j++) off += chance[i][j] * (spread[i][j] + squared(mean[i][j] - value));
        if (variance > 0.0) kept[OF_RATIO] = off / variance;
        double changed = least(changes * span[i], 1.0);
        for (int64_t j = 0; j < s; j++) {
            chance[i][j] += changed * (first[j] - chance[i][j]);
            spread[i][j] += share[j] * stated[i] * span[i];
        }
        kept[OF_SHARE] = within(row_dot(s, chance[i], share), least_share, most_share);
        double added = kept[OF_SHARE] * stated[i] * span[i];
        sd[i] = sqrt(added), kept[OF_VALUE] = value, kept[OF_VARIANCE] = variance + added;
    }
}

void tss_true_variances(
    int64_t d, int64_t s, const double variance[d], const double waiting[d], const double stated[d],
    const double share[s], const double chance[d][s], const double last[d][4], double whole[d],
    double ratio[d]) {
    for (int64_t i = 0; i < d; i++) {
        double drift = stated[i] * waiting[i];
        whole[i] = variance[i] + last[i][OF_SHARE] * drift;
        double right = last[i][OF_RATIO] * variance[i] + row_dot(s, chance[i], share) * drift;
        ratio[i] = whole[i] > 0.0 ? right / whole[i] : 1.0;
    }
}
