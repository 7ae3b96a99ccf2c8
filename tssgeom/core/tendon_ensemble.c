/* Many tendons whose numbers differ a little, taken through one step, and what a reading makes of them.

   docs/model.md (201), (203). */
#include "tendon_bars.h"

#include <string.h>

void set_plant(
    int64_t k, int64_t d, const double *middle, const double *slope, int64_t width, const double shift[],
    double *own) {
    int64_t b = k + 1, rows = 16 * b + PLANT.curved;
    memcpy(own, middle, plant_bytes(k));
    for (int64_t a = 0; a < d; a++)
        for (int64_t i = 0; i < rows; i++) own[i] += slope[a * width + i] * shift[a];
    own[16 * b + PLANT.swift] = 0.0; /* a reading moves contacts too */
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

int64_t tss_step_ensemble(
    int64_t n, int64_t k, const double edge[k], int64_t d, const double plant[16 * (k + 1) + 429],
    const double slope[d][16 * (k + 1) + 429], const double shift[n][d],
    const double memory[n][9 * (k + 1) + 7], int64_t p, const double length[p], const double angle[p],
    const double gain[n], int64_t m, const double bends[m][3], int64_t moved, int64_t by_force,
    int64_t was_by_force, const double position[n], const double drive[n], double span, double warmth,
    double after[n][9 * (k + 1) + 7], double ends[n][4], double own[16 * (k + 1) + 429],
    double pieces[6][p + 2 * m], double work[24][k + 1]) {
    if (k < 2 || p == 0) return 0;
    for (int64_t j = 0; j < n; j++) {
        double read[6];
        set_plant(k, d, plant, slope[0], 16 * (k + 1) + 429, shift[j], own);
        memcpy(after[j], memory[j], memory_bytes(k));
        if (moved) {
            for (int64_t i = 0; i < p; i++) pieces[5][i] = angle[i] * gain[j];
            put_on_route(k, edge, own, p, length, pieces[5], m, bends, pieces[0], work[20]);
        } else set_cones_of(k, own);
        bar_laws laws = laws_of(k, own);
        bar_memory kept = memory_of(k, after[j]);
        if (by_force != was_by_force) switch_drive(&kept, position[j], (int)by_force);
        step_room room = room_of(k, work[0]);
        begin_room(&laws, &room);
        if (!take_sample(&laws, &kept, &room, (int)by_force, span, drive[j], warmth, 1)) return j;
        if (!record(&laws, &kept, (int)by_force, read)) return j;
        memcpy(ends[j], read, sizeof ends[j]);
    }
    return n;
}

int64_t tss_assimilate(
    int64_t n, int64_t t, int64_t k, int64_t d, int64_t c, double numbers[n][d],
    double memory[n][t * (9 * (k + 1) + 7)], double predicted[n][c], const double reading[c],
    const double variance[c], double most_off, double innovation[c][2],
    double work[t * (9 * (k + 1) + 7) + d + c]) {
    int64_t b = k + 1, own = 9 * b + 7, size = t * own, used = 0;
    double *of_memory = work, *of_numbers = work + size, *of_predicted = work + size + d;
    for (int64_t h = 0; h < c; h++) {
        double mean = 0.0, spread = 0.0;
        for (int64_t j = 0; j < n; j++) mean += predicted[j][h] / (double)n;
        for (int64_t j = 0; j < n; j++) spread += (predicted[j][h] - mean) * (predicted[j][h] - mean);
        double whole = spread / (double)(n - 1) + variance[h], off = reading[h] - mean;
        innovation[h][0] = off, innovation[h][1] = whole;
        if (!(fabs(off) <= most_off * sqrt(whole))) continue; /* none, or an outlier */
        used++;
        double share = 1.0 / (1.0 + sqrt(variance[h] / whole)), scale = 1.0 / (whole * (double)(n - 1));
        memset(work, 0, (size_t)(size + d + c) * sizeof(double));
        for (int64_t j = 0; j < n; j++) { /* covariance with the reading; of a constant it is 0 */
            double y = (predicted[j][h] - mean) * scale;
            for (int64_t i = 0; i < size; i++) of_memory[i] += memory[j][i] * y;
            for (int64_t i = 0; i < d; i++) of_numbers[i] += numbers[j][i] * y;
            for (int64_t i = 0; i < c; i++) of_predicted[i] += predicted[j][i] * y;
        }
        for (int64_t a = 0; a < t; a++) {
            double *of_tendon = of_memory + a * own, *held = of_tendon + 9 * b;
            memset(of_tendon + MEMORY.slip * b, 0, (size_t)b * sizeof(double));
            memset(of_tendon + MEMORY.speed * b, 0, (size_t)b * sizeof(double));
            held[HELD.drive] = held[HELD.warmth] = held[HELD.rate] = held[HELD.time] = 0.0;
        }
        for (int64_t j = 0; j < n; j++) { /* docs/model.md (203) */
            double by = off - share * (predicted[j][h] - mean);
            for (int64_t i = 0; i < size; i++) memory[j][i] += of_memory[i] * by;
            for (int64_t i = 0; i < d; i++) numbers[j][i] += of_numbers[i] * by;
            for (int64_t i = 0; i < c; i++) predicted[j][i] += of_predicted[i] * by;
            for (int64_t a = 0; a < t; a++)
                for (int64_t i = 0; i < b; i++)
                    memory[j][a * own + i] = most(0.0, memory[j][a * own + i]);
        }
    }
    return used;
}
