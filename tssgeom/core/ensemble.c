/* Deviations of members, and readings beside what members expect.

   docs/model.md (204), (251), (252). */
#include "ensemble.h"

#include "route.h"
#include "tendon_bars.h"

/* Take out of a column what it has in common with the others before it, twice as rounding leaves some; returns
   the length that is left over that at first. */
static double make_orthogonal(int64_t n, int64_t before, const double *others, double column[]) {
    double first = sqrt(row_dot(n, column, column));
    for (int twice = 0; twice < 2; twice++)
        for (int64_t a = 0; a < before; a++) {
            const double *other = others + a * n;
            double common = row_dot(n, other, column);
            for (int64_t j = 0; j < n; j++) column[j] -= common * other[j];
        }
    return first > 0.0 ? sqrt(row_dot(n, column, column)) / first : 0.0;
}

void tss_deviations(
    int64_t n, int64_t d, int64_t m, const double random[n][d], const double known[n][m],
    double deviation[n][d], double work[1 + m + d][n]) {
    for (int64_t a = 0; a < 1 + m + d; a++) {
        double *column = work[a];
        for (int64_t j = 0; j < n; j++) column[j] = a == 0 ? 1.0 : a <= m ? known[j][a - 1] : random[j][a - 1 - m];
        int independent = make_orthogonal(n, a, work[0], column) > ROUNDING.relative;
        double length = sqrt(row_dot(n, column, column));
        for (int64_t j = 0; j < n; j++) column[j] = independent ? column[j] / length : 0.0;
    }
    double size = sqrt((double)(n - 1));
    for (int64_t j = 0; j < n; j++)
        for (int64_t a = 0; a < d; a++) deviation[j][a] = size * work[1 + m + a][j];
}

/* What noise of each drive does to one channel, and how far it bends it; sets the steepest way and the mean. */
static double by_drives(
    int64_t n, int64_t q, int64_t c, int64_t h, const double predicted[][c], double farthest[][c],
    double moved[][c]) {
    double bend = 0.0;
    for (int64_t i = 0; i < q; i++) {
        double more = predicted[n + 2 * i][h] - predicted[0][h];
        double less = predicted[n + 2 * i + 1][h] - predicted[0][h];
        moved[i][h] = 0.5 * (more - less), farthest[i][h] = most(fabs(more), fabs(less));
        bend = most(bend, 0.5 * fabs(more + less));
    }
    return bend;
}

void tss_compare_readings(
    int64_t n, int64_t q, int64_t c, int64_t e, const double predicted[n + 2 * q][c],
    const double others[n + 2 * q][e], const double given[c], const double noise[c], const double drive[q][3],
    double felt, double bent, double reading[c], double variance[c], double off[c], double greatest[c], double farthest[q][c],
    double lowest[q], double by_drive[c], double others_by_drive[e], double moved[q][c]) {
    for (int64_t i = 0; i < q; i++) lowest[i] = NAN;
    for (int64_t h = 0; h < c; h++) {
        double mean = 0.0, spread = 0.0, bend = by_drives(n, q, c, h, predicted, farthest, moved);
        for (int64_t j = 0; j < n; j++) mean += predicted[j][h];
        mean /= (double)n;
        for (int64_t j = 0; j < n; j++) spread += squared(predicted[j][h] - mean);
        spread /= (double)(n - 1);
        variance[h] = noise[h], greatest[h] = noise[h] + spread, by_drive[h] = 0.0;
        double besides = off[h] = given[h] - mean;
        for (int64_t i = 0; i < q; i++) {
            variance[h] += squared(moved[i][h]), greatest[h] += squared(farthest[i][h]);
            by_drive[h] += squared(drive[i][1] * moved[i][h]);
            besides -= drive[i][0] * moved[i][h];
        }
        by_drive[h] = sqrt(by_drive[h]);
        reading[h] = bend > bent * sqrt(noise[h]) ? NAN : mean + besides;
        double z = besides / sqrt(variance[h] + spread);
        for (int64_t i = 0; i < q; i++) {
            if (!(fabs(moved[i][h]) > felt * sqrt(noise[h])) || !isfinite(z)) continue;
            double as_if = drive[i][2] * (moved[i][h] > 0.0 ? z : -z);
            if (!(lowest[i] <= as_if)) lowest[i] = as_if;
        }
    }
    for (int64_t a = 0; a < e; a++) {
        double sum = 0.0;
        for (int64_t i = 0; i < q; i++)
            sum += squared(drive[i][1] * 0.5 * (others[n + 2 * i + 1][a] - others[n + 2 * i][a]));
        others_by_drive[a] = sqrt(sum);
    }
}
