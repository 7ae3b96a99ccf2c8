/* Many tendons whose numbers differ a little, taken through one step, and what a reading makes of them.

   docs/model.md (201), (203). */
#include "tendon_bars.h"

#include <string.h>

void set_plant(
    int64_t k, int64_t d, const double *middle, const double *slope, int64_t width, const double shift[],
    double *own) {
    int64_t b = k + 1, rows = LAW_ROWS * b + PLANT.curved;
    memcpy(own, middle, plant_bytes(k));
    for (int64_t a = 0; a < d; a++)
        for (int64_t i = 0; i < rows; i++) own[i] += slope[a * width + i] * shift[a];
    own[LAW_ROWS * b + PLANT.swift] = 0.0; /* a reading moves contacts too */
}

void set_cones_of(int64_t k, double *own) {
    int64_t b = k + 1;
    for (int64_t i = 0; i < k; i++) {
        double pulling = own[LAW.pulling * b + i] = most(0.0, own[LAW.pulling * b + i]);
        double releasing = own[LAW.releasing * b + i] = most(0.0, own[LAW.releasing * b + i]);
        double fitting = own[LAW.fitting * b + i];
        own[LAW.low * b + i] = exp(-pulling - fitting), own[LAW.high * b + i] = exp(releasing + fitting);
    }
}

/* What the sensors read of both ends; docs/model.md (61). */
static void read_sensors(const double ends[4], const double sensor[5], double read[3]) {
    double distal = ends[1] + sensor[4] * ends[0];
    read[0] = ends[0] * sensor[0] + sensor[1];
    read[1] = distal * sensor[2] + sensor[3];
    read[2] = ends[2] - ends[3];
}

/** Step n tendons whose plants are straight lines over d numbers; docs/model.md (201), (202).

`slope` [d] is what 1 of each number adds to `plant`, `sensor_slope` [d] what it adds to gain and zero of T_in and of
T_out and to the crosstalk, which are `sensors`; `shift` [w, d] how far the numbers of each of w tendons are from those of
the plant. Tendon j begins as tendon `row[j]` of the w. Where the route has `moved` from that of the plant it is `length`,
`angle` of its pieces times `gain` [w] of each. `position` [w] is where each drive was [m], `drive` [n] where it goes, [N]
or [m]; `warmth` [K]. Returns how many were stepped, fewer where one finds no equilibrium; the memories; T_in, T_out [N],
x_in, x_out [m] of each; and what is read of T_in and T_out [N], and of the elongation [m]. */
ENTRY int64_t tss_step_ensemble(
    int64_t w, int64_t n, int64_t k, const double edge[k], int64_t d, const double plant[17 * (k + 1) + 430],
    const double slope[d][17 * (k + 1) + 430], const double sensors[5], const double sensor_slope[d][5],
    const double shift[w][d], const double memory[w][9 * (k + 1) + 7], const int64_t row[n], int64_t p,
    const double length[p], const double angle[p], const double gain[w], int64_t m, const double bends[m][3],
    int64_t moved, int64_t by_force, int64_t was_by_force, const double position[w], const double drive[n],
    double span, double warmth, OUT double after[n][9 * (k + 1) + 7], OUT double ends[n][4],
    OUT double read[n][3], WORK double own[17 * (k + 1) + 430], WORK double pieces[6][p + 2 * m],
    WORK double work[24][k + 1]) {
    if (k < 2 || p == 0) return 0;
    for (int64_t j = 0; j < n; j++) {
        int64_t of = row[j];
        if (of < 0 || of >= w) return j;
        double recorded[6], sensor[5];
        set_plant(k, d, plant, slope[0], 17 * (k + 1) + 430, shift[of], own);
        memcpy(after[j], memory[of], memory_bytes(k));
        if (moved) {
            for (int64_t i = 0; i < p; i++) pieces[5][i] = angle[i] * gain[of];
            put_on_route(k, edge, own, p, length, pieces[5], m, bends, pieces[0], work[20]);
        } else set_cones_of(k, own);
        bar_laws laws = laws_of(k, own);
        bar_memory kept = memory_of(k, after[j]);
        if (j > 0) memcpy(kept.slip, memory_of(k, after[j - 1]).slip, (size_t)k * sizeof(double));
        if (by_force != was_by_force) switch_drive(&kept, position[of], (int)by_force);
        step_room room = room_of(k, work[0]);
        begin_room(&laws, &room);
        if (!take_sample(&laws, &kept, &room, (int)by_force, span, drive[j], warmth, 1)) return j;
        if (!record(&laws, &kept, (int)by_force, recorded)) return j;
        memcpy(ends[j], recorded, sizeof ends[j]);
        memcpy(sensor, sensors, sizeof sensor);
        for (int64_t a = 0; a < d; a++)
            for (int64_t i = 0; i < 5; i++) sensor[i] += shift[of][a] * sensor_slope[a][i];
        read_sensors(ends[j], sensor, read[j]);
    }
    return n;
}

/* Covariances of what members remember with a reading, from their deviations of it over its variance. */
static void
add_common(int64_t size, const double values[], double y, double common[]) {
    for (int64_t i = 0; i < size; i++) common[i] += values[i] * y;
}

/* Forget what a reading does not shift: what contacts did last, and what drives are at. */
static void keep_steps(int64_t t, int64_t b, double common[]) {
    for (int64_t a = 0; a < t; a++) {
        double *of_tendon = common + a * (9 * b + 7), *held = of_tendon + 9 * b;
        memset(of_tendon + MEMORY.slip * b, 0, (size_t)b * sizeof(double));
        memset(of_tendon + MEMORY.speed * b, 0, (size_t)b * sizeof(double));
        held[HELD.drive] = held[HELD.warmth] = held[HELD.rate] = held[HELD.time] = 0.0;
    }
}

/* Shift what a member remembers; no tension is below 0. */
static void
shift_memory(int64_t t, int64_t b, const double common[], double by, double memory[]) {
    add_common(t * (9 * b + 7), common, by, memory);
    for (int64_t a = 0; a < t; a++)
        for (int64_t i = 0; i < b; i++) memory[a * (9 * b + 7) + i] = most(0.0, memory[a * (9 * b + 7) + i]);
}

/* Mean and variance of column h of values [n, c]. */
static void moments_of(int64_t n, int64_t c, const double *values, int64_t h, double moments[2]) {
    double mean = 0.0, sum = 0.0;
    for (int64_t j = 0; j < n; j++) mean += values[j * c + h];
    mean /= (double)n;
    for (int64_t j = 0; j < n; j++) sum += squared(values[j * c + h] - mean);
    moments[0] = mean, moments[1] = sum / (double)(n - 1);
}

/** Shift n members by c readings, one after the other, as an ensemble square-root filter; docs/model.md (203).

`numbers` [n, d], the memories `kept` and `now` [n] of t tendons, `predicted` [n, c] and `others` [n, e] of each member are
changed, and the numbers then held within their bounds. A reading of NaN is none, and one further off than `most_off`
standard deviations is an outlier. Returns how many were used; the innovation of each and its variance; mean and
covariance of the numbers; and mean and variance of what is expected of each channel, and of the others. */
ENTRY int64_t tss_assimilate(
    int64_t n, int64_t t, int64_t k, int64_t d, int64_t c, int64_t e, INOUT double numbers[n][d],
    INOUT double kept[n][t * (9 * (k + 1) + 7)], INOUT double now[n][t * (9 * (k + 1) + 7)],
    INOUT double predicted[n][c], INOUT double others[n][e], const double reading[c], const double variance[c],
    double most_off, const double lower[d], const double upper[d], OUT double innovation[c][2],
    OUT double values[d], OUT double covariance[d][d], OUT double expected[c][2], OUT double moments[e][2],
    WORK double work[2 * t * (9 * (k + 1) + 7) + d + c + e]) {
    int64_t b = k + 1, size = t * (9 * b + 7), used = 0;
    double *of_kept = work, *of_now = work + size, *of_numbers = of_now + size, *of_predicted = of_numbers + d,
           *of_others = of_predicted + c;
    for (int64_t h = 0; h < c; h++) {
        double mean = 0.0, spread = 0.0;
        for (int64_t j = 0; j < n; j++) mean += predicted[j][h] / (double)n;
        for (int64_t j = 0; j < n; j++) spread += (predicted[j][h] - mean) * (predicted[j][h] - mean);
        double whole = spread / (double)(n - 1) + variance[h], off = reading[h] - mean;
        innovation[h][0] = off, innovation[h][1] = whole;
        if (!(fabs(off) <= most_off * sqrt(whole))) continue; /* none, or an outlier */
        used++;
        double share = 1.0 / (1.0 + sqrt(variance[h] / whole)), scale = 1.0 / (whole * (double)(n - 1));
        memset(work, 0, (size_t)(2 * size + d + c + e) * sizeof(double));
        for (int64_t j = 0; j < n; j++) { /* covariance with the reading; of a constant it is 0 */
            double y = (predicted[j][h] - mean) * scale;
            add_common(size, kept[j], y, of_kept);
            add_common(size, now[j], y, of_now);
            add_common(d, numbers[j], y, of_numbers);
            add_common(c, predicted[j], y, of_predicted);
            add_common(e, others[j], y, of_others);
        }
        keep_steps(t, b, of_kept);
        keep_steps(t, b, of_now);
        for (int64_t j = 0; j < n; j++) { /* docs/model.md (203) */
            double by = off - share * (predicted[j][h] - mean);
            shift_memory(t, b, of_kept, by, kept[j]);
            shift_memory(t, b, of_now, by, now[j]);
            add_common(d, of_numbers, by, numbers[j]);
            add_common(c, of_predicted, by, predicted[j]);
            add_common(e, of_others, by, others[j]);
        }
    }
    for (int64_t j = 0; j < n; j++)
        for (int64_t i = 0; i < d; i++) numbers[j][i] = within(numbers[j][i], lower[i], upper[i]);
    for (int64_t i = 0; i < d; i++) {
        double both[2];
        moments_of(n, d, numbers[0], i, both);
        values[i] = both[0], covariance[i][i] = both[1];
        for (int64_t a = 0; a < i; a++) {
            double sum = 0.0;
            for (int64_t j = 0; j < n; j++) sum += (numbers[j][i] - values[i]) * (numbers[j][a] - values[a]);
            covariance[i][a] = covariance[a][i] = sum / (double)(n - 1);
        }
    }
    for (int64_t h = 0; h < c; h++) moments_of(n, c, predicted[0], h, expected[h]);
    for (int64_t h = 0; h < e; h++) moments_of(n, e, others[0], h, moments[h]);
    return used;
}
