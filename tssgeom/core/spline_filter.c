/* A Kalman filter for a route, four λ side by side, and the λ of greatest restricted likelihood. */
#include "lanes.h"
#include "spline.h"

enum { DIFFUSE = 2 }; /* innovations spent on the unknown position and direction at the start */

#define NUMBER Lanes
#define NAMED(name) name##_lanes
#include "state.inl"

INLINE Lanes square_sum(const Lanes v[3], const double *along) {
    Lanes square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    if (!along) return square;
    Lanes part = v[0] * along[0] + v[1] * along[1] + v[2] * along[2];
    return square - part * part;
}

INLINE void add_logarithms(Lanes *log_s, Lanes *product) {
    for (int l = 0; l < LANES; l++) (*log_s)[l] += log((*product)[l]);
    *product = all(1.0);
}

/* Filter forward for four λ and 1/q; returns the count of innovations. `out` [n][3] or NULL is that of lane 0. */
static int64_t filtered(
    const FilterModel *model, Lanes ratio, Lanes inverse_intensity, Lanes *log_sum, Lanes *square_total,
    double (*out)[3]) {
    const int64_t n = model->n;
    const double *u = model->u, *ends = model->ends;
    Lanes m[3][4], off[3], log_s = all(0.0), squares = all(0.0), product = all(1.0);
    for (int c = 0; c < 3; c++)
        for (int j = 0; j < 4; j++) m[c][j] = all(model->start[c][j]);
    Triangle_lanes p = initial_covariance_lanes(ends, ratio);
    int64_t used = 0;
    int position_known = 0, direction_known = 0; /* whether the first innovations went into them */
    for (int64_t i = 0; i < n; i++) {
        const double *along = model->across_only ? model->curve_tangent[i] : NULL;
        if (i > 0) {
            p = predict_covariance_lanes(p, model->transition[i], u[i] - u[i - 1]);
            predict_mean_lanes(m, model->transition[i], m);
        }
        if (model->tangent && model->tangent_variance[i] > 0.0) {
            Lanes variance = model->tangent_variance[i] * inverse_intensity;
            Lanes s = observe_tangent_lanes(&p, m, model->tangent[i], variance, off);
            used++;
            if (direction_known) {
                squares += square_sum(off, along) / s;
                add_logarithms(&log_s, &s);
            }
            direction_known = 1;
        }
        if (!(model->weight[i] > 0.0)) continue;
        Lanes s = observe_position_lanes(&p, m, model->y[i], ratio / model->weight[i], off);
        used++;
        if (!(position_known && direction_known)) {
            direction_known = position_known || direction_known;
            position_known = 1;
            continue;
        }
        product *= s;
        int far = 0;
        for (int l = 0; l < LANES; l++) far |= product[l] > 1e100 || product[l] < 1e-100;
        if (far) add_logarithms(&log_s, &product);
        squares += square_sum(off, along) / s;
        if (out) {
            double part = along ? off[0][0] * along[0] + off[1][0] * along[1] + off[2][0] * along[2] : 0.0;
            for (int c = 0; c < 3; c++)
                out[i][c] = (off[c][0] - (along ? part * along[c] : 0.0)) / sqrt(s[0]);
        }
    }
    Lanes va = ends[2] * ratio, vb = ends[3] * ratio, white[2][3], spread[2];
    Lanes determinant = observe_end_lanes(&p, m, va, vb, white, spread);
    for (int k = 0; k < 2; k++)
        squares += square_sum(white[k], model->across_only ? model->curve_tangent[n - 1] : NULL) / spread[k];
    /* the same determinant for a route of which no point was observed */
    double length = u[n - 1] - u[0];
    Lanes p22 = 2.0 * va + vb * (length * length) + length * length * length / 3.0;
    Lanes p23 = vb * length + length * length / 2.0, p33 = 2.0 * vb + length;
    Lanes unobserved = p22 * p33 - p23 * p23;
    for (int l = 0; l < LANES; l++)
        log_s[l] += log(product[l]) + log(determinant[l]) - log(unobserved[l]);
    *log_sum = log_s, *square_total = squares;
    return used - DIFFUSE;
}

/* Intensity that goes with a known noise variance, or the likeliest one above rounding. */
static double intensity_of(double squares, int64_t values, double ratio, double variance) {
    double floor = squared(PRIOR.rounding) / ratio;
    return variance > 0.0 ? variance / ratio : most(squares / most((double)values, 1.0), floor);
}

/* Likelihoods at four λ; where directions are sensed, q follows from λ and the noise. */
static void likelihoods(const FilterModel *model, double variance, const double ratio[LANES], Likelihood at[LANES]) {
    Lanes ratios = {ratio[0], ratio[1], ratio[2], ratio[3]}, log_s, squares;
    Lanes inverse_intensity = model->tangent ? ratios / variance : all(0.0);
    int64_t values = filtered(model, ratios, inverse_intensity, &log_s, &squares, NULL);
    for (int l = 0; l < LANES; l++) {
        double q = intensity_of(squares[l], (model->across_only ? 2 : 3) * values, ratio[l], variance);
        at[l] = (Likelihood){ratio[l], q, log_s[l], squares[l], values};
    }
}

/* -2 ln of the posterior of λ = 10^x at four x, the noise known or put where it is likeliest; (21). */
static void criteria(const FilterModel *model, double variance, const double x[LANES], double value[LANES]) {
    double ratio[LANES];
    Likelihood at[LANES];
    for (int l = 0; l < LANES; l++) ratio[l] = pow(10.0, x[l]);
    likelihoods(model, variance, ratio, at);
    int dimensions = model->across_only ? 2 : 3;
    for (int l = 0; l < LANES; l++)
        value[l] = dimensions * (at[l].values * log(at[l].intensity) + at[l].log_s) +
                   at[l].squares / at[l].intensity + SEARCH.price_per_decade * x[l];
}

/* Best of trials over the whole range of x. */
static double coarse_search(const FilterModel *model, double variance) {
    double top = least(8.0 * log10((double)model->n) + 1.0, SEARCH.most);
    double x[LANES], value[LANES], best = INFINITY, result = SEARCH.least;
    for (double first = SEARCH.least; first <= top; first += LANES * SEARCH.coarse) {
        for (int l = 0; l < LANES; l++) x[l] = least(first + l * SEARCH.coarse, SEARCH.most + SEARCH.coarse);
        criteria(model, variance, x, value);
        for (int l = 0; l < LANES; l++)
            if (x[l] <= top && value[l] < best) best = value[l], result = x[l];
    }
    return result;
}

double best_ratio(const FilterModel *model, double variance, double guess) {
    double width = SEARCH.fine, x, at[LANES], value[LANES];
    if (guess > 0.0) {
        x = within(log10(guess), SEARCH.least, SEARCH.most);
    } else {
        x = coarse_search(model, variance);
        width = SEARCH.coarse;
    }
    at[0] = x - width, at[1] = x, at[2] = x + width, at[3] = x;
    criteria(model, variance, at, value);
    double left = value[0], middle = value[1], right = value[2];
    for (;; width = most(0.5 * width, SEARCH.fine)) {
        for (double walked = SEARCH.least; walked < SEARCH.most; walked += width) {
            double way = 0.0;
            if (left < middle && left <= right && x > SEARCH.least) way = -width;
            else if (right < middle && x < SEARCH.most) way = width;
            else break;
            x += way;
            for (int l = 0; l < LANES; l++) at[l] = x + way;
            criteria(model, variance, at, value);
            if (way < 0.0) right = middle, middle = left, left = value[0];
            else left = middle, middle = right, right = value[0];
        }
        if (width <= SEARCH.fine) break;
        double half = most(0.5 * width, SEARCH.fine);
        at[0] = x - half, at[1] = x + half, at[2] = x, at[3] = x;
        criteria(model, variance, at, value);
        left = value[0], right = value[1];
    }
    double bend = left - 2.0 * middle + right;
    if (bend > 0.0) x += within(0.5 * width * (left - right) / bend, -width, width);
    return pow(10.0, x);
}

void set_intensity(const FilterModel *model, double variance, Likelihood *at) {
    at->intensity = intensity_of(at->squares, (model->across_only ? 2 : 3) * at->values, at->ratio, variance);
}

double spline_deviance(Likelihood at, double spacing) {
    double q = most(at.intensity, 1e-280), points = (double)at.values + 2.0;
    double variance = most(at.ratio * q, 1e-280) * spacing * spacing;
    double information = log(points * (points * (points * points - 1.0) / 12.0));
    double fitted = 2.0 * ((double)at.values * log(q) + at.log_s) + at.squares / q;
    fitted += 4.0 * (points - 2.0) * log(spacing);
    return fitted + 4.0 * log(variance) - 2.0 * information + 6.0 * log(2.0 * points); /* (34) */
}

/** Filter forward, for noise variance λ/weight and q = 1.

Returns standardised innovations; log_s and squares, the sums of the logarithms of the innovation variances,
less what the prior of the ends would be worth without any point, and of the squared standardised innovations;
and how many. `inverse_intensity` is 1/q, in which the variances of sensed directions are counted. */
ENTRY void tss_innovations(
    int64_t n, const double u[n], const double y[n][3], const double weight[n],
    const double transition[n][12], const double start[3][4], const double ends[4],
    const double curve_tangent[n][3], int64_t across_only, OPTIONAL const double tangent[n][3],
    OPTIONAL const double tangent_variance[n], double ratio, double inverse_intensity,
    OUT double standardised[n][3], OUT double *log_s, OUT double *squares, OUT int64_t *values) {
    FilterModel model =
        filter_model(n, u, y, weight, transition, start, ends, curve_tangent, across_only, tangent, tangent_variance);
    Lanes logarithms = all(0.0), total = all(0.0);
    for (int64_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) standardised[i][c] = 0.0;
    *values = n < 1 ? 0 : filtered(&model, all(ratio), all(inverse_intensity), &logarithms, &total, standardised);
    *log_s = logarithms[0], *squares = total[0];
}

/** λ of greatest restricted likelihood, its intensity q, and log_s, squares and values of `innovations` there.

`variance` is the known noise variance, or 0; it is not 0 beside sensed directions. `guess` is the λ to begin
with; where it is not positive, everything from interpolation to one cubic through all points is tried. */
ENTRY void tss_best_ratio(
    int64_t n, const double u[n], const double y[n][3], const double weight[n],
    const double transition[n][12], const double start[3][4], const double ends[4],
    const double curve_tangent[n][3], int64_t across_only, OPTIONAL const double tangent[n][3],
    OPTIONAL const double tangent_variance[n], double variance, double guess, OUT double *ratio,
    OUT double *intensity, OUT double *log_s, OUT double *squares, OUT int64_t *values) {
    FilterModel model =
        filter_model(n, u, y, weight, transition, start, ends, curve_tangent, across_only, tangent, tangent_variance);
    double best = n < 1 ? NAN : best_ratio(&model, variance, guess), ratios[LANES] = {best, best, best, best};
    Likelihood at[LANES] = {{NAN, NAN, NAN, NAN, 0}};
    if (n > 0) likelihoods(&model, variance, ratios, at);
    *ratio = best, *intensity = at[0].intensity, *log_s = at[0].log_s;
    *squares = at[0].squares, *values = at[0].values;
}
