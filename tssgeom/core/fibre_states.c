#include "fibre.h"

#include <string.h>

enum {
    MOMENTS = 2 * STATES - 1,
    TERMS = 20, /* derived: 2^20 7!/27!, the next one, is below rounding */
};
static const double FACTORIAL[MOMENTS] = {1.0, 1.0, 2.0, 6.0, 24.0, 120.0, 720.0};

static double power(double x, int64_t n) { return n > 0 ? x * power(x, n - 1) : 1.0; }

/* ∫ u^m exp(−2λu) du from 0 to h, for each m; the greatest by a series or in closed form, the others from it. */
static void moments(double decay, double h, double out[MOMENTS]) {
    const int64_t top = MOMENTS - 1;
    double rate = 2.0 * decay, x = rate * h, less = exp(-x), sum = 0.0;
    if (isinf(h)) {
        for (int64_t m = 0; m < MOMENTS; m++) out[m] = FACTORIAL[m] / power(rate, m + 1);
        return;
    }
    double term = x < 2.0 ? 1.0 / (double)MOMENTS : 1.0, whole = FACTORIAL[top] / power(rate, top + 1);
    if (x < 2.0)
        for (int64_t i = 0; i < TERMS; i++) sum += term, term *= x / (double)(MOMENTS + 1 + i);
    else
        for (int64_t i = 0; i <= top; i++) sum += term, term *= x / (double)(i + 1);
    out[top] = x < 2.0 ? less * power(h, top + 1) * sum : whole * (1.0 - less * sum);
    for (int64_t m = top; m > 0; m--) out[m - 1] = (rate * out[m] + power(h, m) * less) / (double)m;
}

void grown(double variance, double decay, double h, double out[STATES][STATES]) {
    memset(out, 0, STATES * sizeof *out);
    if (decay == 0.0) {
        out[0][0] = isinf(h) ? variance : 0.0;
        return;
    }
    const int64_t p = STATES - 1;
    double intensity = variance * power(2.0 * decay, 2 * p + 1) * squared(FACTORIAL[p]) / FACTORIAL[2 * p];
    double moment[MOMENTS];
    moments(decay, h, moment);
    for (int64_t i = 0; i < STATES; i++)
        for (int64_t j = i; j < STATES; j++)
            out[i][j] = out[j][i] = intensity * moment[2 * p - i - j] / (FACTORIAL[p - i] * FACTORIAL[p - j]);
}

Step step_over(double h, double variance, double decay) {
    Step step = {.decay = decay};
    double less = exp(-decay * h);
    for (int64_t i = 0; i < STATES; i++)
        for (int64_t j = i; j < STATES; j++)
            if (i == j || decay > 0.0)
                step.over[i][j] = step.columns[j][i] = less * power(h, j - i) / FACTORIAL[j - i];
    grown(variance, decay, h, step.added);
    return step;
}

void root_of(const double covariance[STATES][STATES], double root[STATES][STATES]) {
    memset(root, 0, STATES * sizeof *root);
    for (int64_t a = 0; a < STATES; a++)
        for (int64_t b = 0; b <= a; b++) {
            double sum = covariance[a][b];
            for (int64_t c = 0; c < b; c++) sum -= root[a][c] * root[b][c];
            root[a][b] = a == b ? sqrt(most(sum, 0.0)) : root[b][b] > 0.0 ? sum / root[b][b] : 0.0;
        }
}

void columns_of(const double covariance[STATES][STATES], double column[STATES][STATES]) {
    double root[STATES][STATES];
    root_of(covariance, root);
    for (int64_t a = 0; a < STATES; a++)
        for (int64_t b = 0; b < STATES; b++) column[b][a] = root[a][b];
}
