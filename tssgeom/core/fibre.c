#include "fibre.h"

#include <string.h>

enum { NEGLIGIBLE = 28 }; /* of ln evidence below the likeliest: e^-28 is rounding */
static const double TAU = 6.283185307179586476925;

/* Sums over the gratings before one: precision, precision times both components, and -2 ln likelihood about
   zero. */
typedef struct {
    double mass, first[2], square;
} Sums;

/* Of all partitions of the gratings before one: ln evidence, mean and mean square of φ, and of |κ| of the
   last piece; ln evidence of the likeliest. */
typedef struct {
    double total, best, phi, phi2, kappa, kappa2;
} Average;

/* Sums over all partitions of the gratings into pieces, and the likeliest partition; docs/model.md (36). */
void tss_average_partitions(
    int64_t n, const double s[n], const double bend[n][2], const double precision[n],
    const double cell[n + 1], double rate, double variance, double *log_evidence, double *mean,
    double *angle_variance, int64_t origin[n + 1], uint8_t curved[n + 1], double work[14 * n + 12]) {
    Sums *sum = (Sums *)work;
    Average *at = (Average *)(work + 4 * (n + 1));
    double(*log_of)[2] = (double(*)[2])(work + 10 * (n + 1));
    double *joint = work + 12 * n + 10, *interval2 = joint + n;
    memset(work, 0, (size_t)(10 * (n + 1)) * sizeof(double));
    memset(origin, 0, (size_t)(n + 1) * sizeof(int64_t));
    memset(curved, 0, (size_t)(n + 1));
    for (int64_t i = 0; i < n; i++) {
        double p = precision[i], step = i > 0 ? s[i] - s[i - 1] : 0.0;
        sum[i + 1].mass = sum[i].mass + p;
        for (int c = 0; c < 2; c++) sum[i + 1].first[c] = sum[i].first[c] + p * bend[i][c];
        double size = squared(bend[i][0]) + squared(bend[i][1]);
        sum[i + 1].square = sum[i].square + 0.5 * p * size - log(p / TAU);
        joint[i] = i > 0 ? log(-expm1(-rate * step) + 1e-300) : 0.0; /* no joint is before the first */
        interval2[i] = step * step / 12.0;
    }
    for (int64_t j = 1; j <= n; j++) {
        Average here = {.best = -INFINITY};
        double top = -INFINITY, weight = 0.0;
        for (int64_t i = 0; i < j; i++) {
            double mass = sum[j].mass - sum[i].mass;
            double a = sum[j].first[0] - sum[i].first[0], b = sum[j].first[1] - sum[i].first[1];
            double prior = -rate * (s[j - 1] - s[i]) - log(2.0) + joint[i];
            double straight = prior - (sum[j].square - sum[i].square);
            double bent = straight + 0.5 * (a * a + b * b) / (mass + 1.0 / variance) - log1p(mass * variance);
            double likelier = most(straight, bent);
            log_of[i][0] = at[i].total + straight, log_of[i][1] = at[i].total + bent;
            top = most(top, at[i].total + likelier);
            if (at[i].best + likelier > here.best)
                here.best = at[i].best + likelier, origin[j] = i, curved[j] = bent > straight;
        }
        for (int64_t i = 0; i < j; i++) {
            double span = cell[j] - cell[i], mass = sum[j].mass - sum[i].mass;
            for (int kind = 0; kind < 2; kind++) {
                if (log_of[i][kind] < top - NEGLIGIBLE) continue;
                double w = exp(log_of[i][kind] - top), k = 0.0, v = 0.0;
                if (kind == 1) { /* curvature without the bias of a magnitude, and its variance */
                    double a = sum[j].first[0] - sum[i].first[0], b = sum[j].first[1] - sum[i].first[1];
                    k = sqrt(most((a * a + b * b) / (mass * mass) - 1.0 / mass, 0.0));
                    v = 1.0 / (mass + 1.0 / variance);
                }
                double square = k * k + v, shifted = at[i].kappa2 - 2 * at[i].kappa * k + square;
                double own = span * span * v + interval2[i] * shifted;
                weight += w;
                here.phi += w * (at[i].phi + span * k);
                here.phi2 += w * (at[i].phi2 + 2 * at[i].phi * span * k + squared(span * k) + own);
                here.kappa += w * k;
                here.kappa2 += w * square;
            }
        }
        here.total = top + log(weight);
        here.phi /= weight, here.phi2 /= weight, here.kappa /= weight, here.kappa2 /= weight;
        at[j] = here;
    }
    *log_evidence = at[n].total, *mean = at[n].phi;
    *angle_variance = most(at[n].phi2 - squared(at[n].phi), 0.0);
}
