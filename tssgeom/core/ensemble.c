/* Deviations of members, and readings beside what members expect.

   docs/model.md (204), (251), (252). */
#include "core.h"

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

/** Return deviations of n members, each column with mean 0 and standard deviation 1; docs/model.md (204).

They are those of `random` [n, d], uncorrelated with `known` [n, m] and with each other; what is left of a column
that depends on those before it is 0. */
ENTRY void tss_deviations(
    int64_t n, int64_t d, int64_t m, const double random[n][d], const double known[n][m],
    OUT double deviation[n][d], WORK double work[1 + m + d][n]) {
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
    WORK double moved[q][c]) {
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
