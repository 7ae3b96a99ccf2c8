/* Normal equations of a few dozen parameters: solved and inverted by Cholesky, each in its own unit. */
#include "arcs.h"

/* Cholesky factor of the matrix scaled to unit diagonal plus `damping`, and the units. What is above the
   diagonal of `lower` holds its columns, side by side. */
void factor(int64_t m, const double matrix[], double damping, double lower[], double unit[]) {
    for (int64_t a = 0; a < m; a++) unit[a] = 1.0 / sqrt(most(matrix[a * m + a], 1e-30));
    for (int64_t a = 0; a < m; a++)
        for (int64_t b = 0; b <= a; b++) lower[a * m + b] = matrix[a * m + b] * unit[a] * unit[b];
    for (int64_t c = 0; c < m; c++) {
        double *column = lower + c * m, pivot = sqrt(most(column[c] + damping, ROUNDING.exact));
        column[c] = pivot;
        for (int64_t a = c + 1; a < m; a++) column[a] = lower[a * m + c] /= pivot;
        for (int64_t a = c + 1; a < m; a++) {
            double *row = lower + a * m, share = row[c];
            for (int64_t b = c + 1; b <= a; b++) row[b] -= share * column[b];
        }
    }
}

/* Forward substitution of one right-hand side that is `stride` numbers apart, in units. */
static void substitute(
    int64_t m, const double lower[], const double unit[], const double right[], int64_t stride, double x[]) {
    for (int64_t a = 0; a < m; a++) {
        double value = right[a * stride] * unit[a];
        for (int64_t c = 0; c < a; c++) value -= lower[a * m + c] * x[c];
        x[a] = value / lower[a * m + a];
    }
}

void solve(int64_t m, const double lower[], const double unit[], const double right[], double x[]) {
    substitute(m, lower, unit, right, 1, x);
    for (int64_t a = m - 1; a >= 0; a--) {
        for (int64_t c = a + 1; c < m; c++) x[a] -= lower[c * m + a] * x[c];
        x[a] /= lower[a * m + a];
    }
    for (int64_t a = 0; a < m; a++) x[a] *= unit[a];
}

/* Covariance [r, r] of r values of gradient [r, m], by the inverse of the factored matrix. */
void propagated(
    int64_t m, const double lower[], const double unit[], int64_t r, const double gradient[], double result[],
    Work w) {
    double *half = take(&w, r * m);
    for (int64_t i = 0; i < r; i++) substitute(m, lower, unit, gradient + i * m, 1, half + i * m);
    for (int64_t i = 0; i < r; i++)
        for (int64_t j = 0; j <= i; j++) {
            double total = 0.0;
            for (int64_t a = 0; a < m; a++) total += half[i * m + a] * half[j * m + a];
            result[i * r + j] = result[j * r + i] = total;
        }
}

/** Return the covariance of r values of gradient [r, m], by the inverse of normal equations and of unit
noise.

`damping` is added to the diagonal of the matrix, scaled to 1. */
ENTRY void tss_propagated(
    int64_t m, int64_t r, const double matrix[m][m], const double gradient[r][m], double damping,
    OUT double covariance[r][r], WORK double work[m * m + r * m + m]) {
    Work w = {work};
    double *lower = take(&w, m * m), *unit = take(&w, m);
    factor(m, matrix[0], damping, lower, unit);
    propagated(m, lower, unit, r, gradient[0], covariance[0], w);
}

/* Information [d, d] and gradient [d] of d more parameters, the m factored ones fitted with them.

   gradient [m] is that of the m parameters, near zero where they are at their best; cross [m, d] and own
   [d, d]: the information between the m and the d parameters and of the d among themselves; slope [d]: the
   gradient of the d. */
void schur_complement(
    int64_t m, const double lower[], const double unit[], const double gradient[], int64_t d,
    const double cross[], const double own[], const double slope[], double left[], double rest[], Work w) {
    double *half = take(&w, m * d), *last = take(&w, m);
    for (int64_t a = 0; a < m; a++) { /* all right-hand sides side by side */
        double *row = half + a * d;
        for (int64_t e = 0; e < d; e++) row[e] = cross[a * d + e] * unit[a];
        for (int64_t c = 0; c < a; c++) {
            double share = lower[a * m + c];
            for (int64_t e = 0; e < d; e++) row[e] -= share * half[c * d + e];
        }
        for (int64_t e = 0; e < d; e++) row[e] /= lower[a * m + a];
    }
    substitute(m, lower, unit, gradient, 1, last);
    for (int64_t e = 0; e < d; e++) {
        double *row = left + e * d;
        rest[e] = slope[e];
        for (int64_t f = 0; f <= e; f++) row[f] = own[e * d + f];
        for (int64_t a = 0; a < m; a++) {
            double share = half[a * d + e];
            rest[e] -= share * last[a];
            for (int64_t f = 0; f <= e; f++) row[f] -= share * half[a * d + f];
        }
        for (int64_t f = 0; f < e; f++) left[f * d + e] = row[f];
    }
}
