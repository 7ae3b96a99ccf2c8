/* Rauch-Tung-Striebel smoother of a route: the posterior at all stations from the filter's.

   There are no knots, the time is linear in the number of stations, and a station that was not observed is
   simply not used. Covariances are sums of positive parts, so that long windows cost no digits. */
#include "lanes.h"
#include "spline.h"

#define NUMBER double
#define NAMED(name) name
#include "state.inl"

static void put(Triangle p, double out[10]) {
    out[0] = p.p00, out[1] = p.p01, out[2] = p.p02, out[3] = p.p03, out[4] = p.p11;
    out[5] = p.p12, out[6] = p.p13, out[7] = p.p22, out[8] = p.p23, out[9] = p.p33;
}

/* Smoother gain c = (F p)' predicted^-1 by Cholesky, its columns as rows: the right-hand sides lie side by side. */
INLINE void smoother_gain(const Lanes p[4], const double f[12], const double w[10], Lanes columns[4]) {
    const double tiny = 1e-300;
    double l00 = sqrt(w[0]), i00 = 1.0 / l00;
    double l10 = w[1] * i00, l20 = w[2] * i00, l30 = w[3] * i00;
    double i11 = 1.0 / sqrt(most(w[4] - l10 * l10, tiny));
    double l21 = (w[5] - l20 * l10) * i11, l31 = (w[6] - l30 * l10) * i11;
    double i22 = 1.0 / sqrt(most(w[7] - l20 * l20 - l21 * l21, tiny));
    double l32 = (w[8] - l30 * l20 - l31 * l21) * i22;
    double i33 = 1.0 / sqrt(most(w[9] - l30 * l30 - l31 * l31 - l32 * l32, tiny));
    Lanes z0 = (p[0] + f[0] * p[1] + f[1] * p[2] + f[2] * p[3]) * i00;
    Lanes z1 = (f[3] * p[1] + f[4] * p[2] + f[5] * p[3] - l10 * z0) * i11;
    Lanes z2 = (f[6] * p[1] + f[7] * p[2] + f[8] * p[3] - l20 * z0 - l21 * z1) * i22;
    Lanes z3 = (f[9] * p[1] + f[10] * p[2] + f[11] * p[3] - l30 * z0 - l31 * z1 - l32 * z2) * i33;
    columns[3] = z3 * i33;
    columns[2] = (z2 - l32 * columns[3]) * i22;
    columns[1] = (z1 - l21 * columns[2] - l31 * columns[3]) * i11;
    columns[0] = (z0 - l10 * columns[1] - l20 * columns[2] - l30 * columns[3]) * i00;
}

/* Add b p b' to the rows `out`, for symmetric p; b is given by columns. */
INLINE void add_congruence(const Lanes columns[4], const Lanes p[4], Lanes out[4]) {
    Lanes e[4];
    for (int m = 0; m < 4; m++) e[m] = combined(p[m][0], p[m][1], p[m][2], p[m][3], columns);
    for (int i = 0; i < 4; i++) out[i] += combined(e[0][i], e[1][i], e[2][i], e[3][i], columns);
}

/* Replace p by (1 - cF) p (1 - cF)' + c (Q + following) c': a sum of positive parts, no digits lost. */
INLINE void smooth_covariance(
    double p[10], const Lanes before[4], const Lanes c[4], double h, const double f[12], const double following[10]) {
    double h2 = h * h, h3 = h2 * h, h4 = h2 * h2;
    const double *w = following;
    const double with_noise[10] = {
        w[0] + h3 * h4 / 252, w[1] + h3 * h3 / 72, w[2] + h2 * h3 / 30, w[3] + h4 / 24, w[4] + h2 * h3 / 20,
        w[5] + h4 / 8,        w[6] + h3 / 6,       w[7] + h3 / 3,       w[8] + h2 / 2,  w[9] + h};
    Lanes rest[4], after[4], out[4] = {all(0.0), all(0.0), all(0.0), all(0.0)};
    rest[0] = -c[0];
    rest[1] = -(c[0] * f[0] + c[1] * f[3] + c[2] * f[6] + c[3] * f[9]);
    rest[2] = -(c[0] * f[1] + c[1] * f[4] + c[2] * f[7] + c[3] * f[10]);
    rest[3] = -(c[0] * f[2] + c[1] * f[5] + c[2] * f[8] + c[3] * f[11]);
    for (int j = 0; j < 4; j++) rest[j][j] += 1.0;
    full(with_noise, after);
    add_congruence(rest, before, out);
    add_congruence(c, after, out);
    for (int j = 0, k = 0; j < 4; j++)
        for (int i = j; i < 4; i++, k++) p[k] = out[j][i];
}

/* Add to the sums of the likelihood as `filtered` in spline_filter.c does. */
typedef struct { double log_s, squares, product; int64_t used; } Sums;

INLINE void count(Sums *sums, const double off[3], const double *along, double s, double spread) {
    double part = along ? dot3(off, along) : 0.0;
    sums->squares += (dot3(off, off) - part * part) / spread;
    sums->product *= s;
    if (sums->product > 1e100 || sums->product < 1e-100) sums->log_s += log(sums->product), sums->product = 1.0;
}

/* The filter's mean, covariance after each station, and the one predicted for it. */
static void filter_forward(
    const FilterModel *model, double ratio, double inverse_intensity, double m[][3][4], double covariance[][10],
    double predicted[][10], Likelihood *at) {
    const int64_t n = model->n;
    const double *u = model->u, *ends = model->ends, (*f)[12] = model->transition;
    double off[3], ended[2][3], spread[2];
    Sums sums = {0.0, 0.0, 1.0, 0};
    for (int c = 0; c < 3; c++)
        for (int j = 0; j < 4; j++) m[0][c][j] = model->start[c][j];
    Triangle p = initial_covariance(ends, ratio);
    for (int64_t i = 0; i < n; i++) {
        if (i > 0) {
            p = predict_covariance(p, f[i], u[i] - u[i - 1]);
            put(p, predicted[i]);
            predict_mean(m[i - 1], f[i], m[i]);
        }
        if (model->tangent && model->tangent_variance[i] > 0.0)
            observe_tangent(&p, m[i], model->tangent[i], model->tangent_variance[i] * inverse_intensity, off);
        if (model->weight[i] > 0.0) {
            double s = observe_position(&p, m[i], model->y[i], ratio / model->weight[i], off);
            /* the first two innovations go into the unknown position and direction */
            if (at && ++sums.used > 2) count(&sums, off, model->across_only ? model->curve_tangent[i] : NULL, s, s);
        }
        put(p, covariance[i]);
    }
    double va = ends[2] * ratio, vb = ends[3] * ratio, length = u[n - 1] - u[0];
    double determinant = observe_end(&p, m[n - 1], va, vb, ended, spread);
    put(p, covariance[n - 1]);
    if (!at) return;
    for (int k = 0; k < 2; k++) count(&sums, ended[k], model->across_only ? model->curve_tangent[n - 1] : NULL, 1.0, spread[k]);
    /* the same determinant for a route of which no point was observed */
    double p22 = 2.0 * va + vb * (length * length) + length * length * length / 3.0;
    double p23 = vb * length + length * length / 2.0, p33 = 2.0 * vb + length;
    *at = (Likelihood){ratio, 0.0, 0.0, sums.squares, sums.used - 2};
    at->log_s = sums.log_s + log(sums.product) + log(determinant) - log(p22 * p33 - p23 * p23);
}

static void smooth_backward(
    int64_t n, const double u[], const double f[][12], double m[][3][4], double covariance[][10], double gain[][4][4],
    const double predicted[][10]) {
    double d[3][4];
    for (int64_t i = n - 2; i >= 0; i--) {
        Lanes p[4], c[4];
        full(covariance[i], p);
        smoother_gain(p, f[i + 1], predicted[i + 1], c);
        predict_mean(m[i], f[i + 1], d);
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 4; k++) gain[i][j][k] = c[k][j];
        for (int a = 0; a < 3; a++) {
            double *next = m[i + 1][a];
            Lanes moved = combined(next[0] - d[a][0], next[1] - d[a][1], next[2] - d[a][2], next[3] - d[a][3], c);
            for (int j = 0; j < 4; j++) m[i][a][j] += moved[j];
        }
        smooth_covariance(covariance[i], p, c, u[i + 1] - u[i], f[i + 1], covariance[i + 1]);
    }
}

void smooth(
    const FilterModel *model, double ratio, double inverse_intensity, double m[][3][4],
    double covariance[][10], double gain[][4][4], double predicted[][10], Likelihood *at) {
    filter_forward(model, ratio, inverse_intensity, m, covariance, predicted, at);
    smooth_backward(model->n, model->u, model->transition, m, covariance, gain, (const double(*)[10])predicted);
}

/** Posterior of the curve at all stations, for noise variance λ/weight and q = 1 (Rauch, Tung, Striebel).

Returns the state of each coordinate; the covariance of one coordinate; and the smoother gains, so that
Cov(state i, state i+1) = gain i times covariance i+1. */
ENTRY status tss_smooth(
    int64_t n, const double u[n], const double y[n][3], const double weight[n],
    const double transition[n][12], const double start[3][4], const double ends[4],
    const double curve_tangent[n][3], int64_t across_only, OPTIONAL const double tangent[n][3],
    OPTIONAL const double tangent_variance[n], double ratio, double inverse_intensity,
    OUT double mean[n][3][4], OUT double covariance[n][10], OUT double gain[n - 1][4][4],
    WORK double predicted[n][10]) {
    FilterModel model =
        filter_model(n, u, y, weight, transition, start, ends, curve_tangent, across_only, tangent, tangent_variance);
    smooth(&model, ratio, inverse_intensity, mean, covariance, gain, predicted, NULL);
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++)
            for (int j = 0; j < 4; j++) sum += mean[i][c][j];
    return isfinite(sum) ? DONE : NO_FINITE_CURVE;
}
