/* Fitting a chain of so many arcs to points by Levenberg and Marquardt; docs/model.md (31). */
#include "arcs.h"
#include "route.h"

#include <string.h>

/* Number of values that are fitted. */
int64_t value_count(const Data *data) {
    int64_t points = 0, directions = 0;
    for (int64_t i = 0; i < data->n; i++) {
        points += data->weight[i] > 0.0;
        directions += data->unit_weight != NULL && data->unit_weight[i] > 0.0;
    }
    return (data->free ? 2 : 3) * points + 2 * directions;
}

static int64_t parameter_count(int64_t k, const uint8_t curved[], int64_t free) {
    int64_t count = first_joint_column(free) + k - 1;
    for (int64_t j = 0; j < k; j++) count += curved[j] ? 2 : 0;
    return count;
}

/* Whether arrays that a caller sized fit together. */
int64_t is_sized(int64_t n, int64_t k, int64_t m, const uint8_t curved[], int64_t free) {
    return n > 0 && k > 0 && m == parameter_count(k, curved, free);
}

/* Length of piece j [m]. */
double piece_length(const Data *data, const Chain *chain, int64_t j) {
    double end = j + 1 < chain->k ? chain->form->piece[j + 1].begin : chain->stations[data->n - 1];
    return end - chain->form->piece[j].begin;
}

/* Number of values that are left when the parameters are fitted, at least 1. */
static double freedom_of(const Data *data, const Chain *chain) {
    int64_t left = value_count(data) - chain->m;
    return (double)(left > 1 ? left : 1);
}

/* Noise variance of a coordinate, known or from the residuals [m²]. */
double noise_variance(const Data *data, const Chain *chain) {
    if (data->variance > 0.0) return data->variance;
    return most(chain->cost / freedom_of(data, chain), squared(ROUNDING.relative * data->spacing));
}

/* Greatest mean square of residuals that noise of variance 1 leaves. */
static double highest_mean_square(double freedom) { return 1.0 + CHANCE.never * sqrt(2.0 / freedom); }

/* Noise variance of a coordinate, or the mean square of the residuals where that is more than chance [m²];
   docs/model.md (222). */
double residual_mean_square(const Data *data, const Chain *chain) {
    double freedom = freedom_of(data, chain), variance = noise_variance(data, chain);
    double found = chain->cost / freedom;
    return found > highest_mean_square(freedom) * variance ? found : variance;
}

/* Bayesian information criterion: -2 ln of the greatest likelihood, plus the price of every parameter;
   docs/model.md (125). */
static double criterion_of(const Data *data, const Chain *chain) {
    double n = (double)value_count(data), price = (double)chain->m * log(n);
    if (data->variance > 0.0) return chain->cost / data->variance + n * log(data->variance) + price;
    return n * log(chain->cost / n + 1e-300) + n + price;
}

/* Cost [m²] at which a chain with m parameters has the criterion `least`; docs/model.md (125). */
static double cost_at_criterion(const Data *data, int64_t m, double least_criterion) {
    double n = (double)value_count(data), rest = least_criterion - (double)m * log(n);
    if (data->variance > 0.0) return (rest - n * log(data->variance)) * data->variance;
    return n * exp(least(rest / n - 1.0, 700.0));
}

/* Let a chain begin at the foot of the first point, where that is on the first piece. */
static void from_first_foot(int64_t n, Chain *chain) {
    double begin = chain->stations[0], local[4][3], axes[3][3], moved[3];
    if (chain->k > 1 && !(begin < chain->form->piece[1].begin)) return;
    const double *bend = chain->form->piece[0].bend, h = begin - chain->form->piece[0].begin;
    arc_frame(bend, h, local);
    memcpy(axes, chain->form->axes, sizeof axes);
    in_axes(axes, local[0], moved);
    for (int c = 0; c < 3; c++) {
        chain->form->start[c] += moved[c];
        in_axes(axes, local[1 + c], chain->form->axes[c]);
    }
    for (int64_t j = 0; j < chain->k; j++) chain->form->piece[j].begin -= begin;
    chain->form->piece[0].begin = 0.0;
    for (int64_t i = 0; i < n; i++) chain->stations[i] -= begin;
}

/* Shift and turn the start of a chain by the first parameters of a step. */
static void turn_start(const double step[], int64_t free, const Form *from, Form *to) {
    int64_t shifts = free ? 2 : 3;
    double unit[3], size;
    for (int i = 0; i < 3; i++) {
        unit[i] = step[shifts] * from->axes[1][i] + step[shifts + 1] * from->axes[2][i];
        to->start[i] += free ? step[0] * from->axes[1][i] + step[1] * from->axes[2][i] : step[i];
    }
    size = sqrt(dot3(unit, unit));
    if (!(size > 0.0)) return;
    double half = sin(0.5 * size), sine = sin(size);
    for (int i = 0; i < 3; i++) unit[i] /= size;
    for (int i = 0; i < 3; i++) { /* Rodrigues */
        const double *axis = from->axes[i];
        double along = dot3(unit, axis);
        for (int c = 0; c < 3; c++) {
            int d = (c + 1) % 3, e = (c + 2) % 3;
            to->axes[i][c] += sine * (unit[d] * axis[e] - unit[e] * axis[d]);
            to->axes[i][c] += 2 * half * half * (unit[c] * along - axis[c]);
        }
    }
}

static size_t form_size(int64_t k) { return (size_t)(12 + 3 * k) * sizeof(double); }

/* Apply a parameter step, joints kept in order and at least `shortest` [m] apart.

   Where joints move, the turn of a piece follows its step, not the curvature: that of a short piece would
   need many steps along a bent valley. */
static void step_chain(
    const double step[], int64_t free, double shortest, double end, const Chain *chain, Form *to) {
    int64_t k = chain->k, row = first_joint_column(free);
    const Form *from = chain->form;
    memcpy(to, from, form_size(k));
    turn_start(step, free, from, to);
    for (int64_t j = 1; j < k; j++)
        to->piece[j].begin = most(from->piece[j].begin + step[row++], to->piece[j - 1].begin + shortest);
    for (int64_t j = k - 1; j > 0; j--)
        to->piece[j].begin = least(to->piece[j].begin, (j + 1 < k ? to->piece[j + 1].begin : end) - shortest);
    for (int64_t j = 0; j < k; j++) {
        if (!chain->curved[j]) continue;
        double before = (j + 1 < k ? from->piece[j + 1].begin : end) - from->piece[j].begin;
        double after = (j + 1 < k ? to->piece[j + 1].begin : end) - to->piece[j].begin;
        double scale = most(before, shortest) / most(after, shortest);
        for (int c = 0; c < 2; c++) to->piece[j].bend[c] += scale * step[row++];
    }
}

static double curvature(const double bend[2]) { return sqrt(bend[0] * bend[0] + bend[1] * bend[1]); }

/* Angle by which a chain turns from `here`, on piece *j, to `there` [rad]; *j becomes the piece there. */
static double turned_to(double there, double here, const Chain *chain, int64_t *j) {
    double turned = 0.0;
    for (; *j + 1 < chain->k && chain->form->piece[*j + 1].begin <= there; ++*j) {
        double next = chain->form->piece[*j + 1].begin;
        turned += most(next - here, 0.0) * curvature(chain->form->piece[*j].bend);
        here = most(next, here);
    }
    return turned + most(there - here, 0.0) * curvature(chain->form->piece[*j].bend);
}

/* Whether the chain turns so little from one point to the next that the points can determine it. */
static int64_t turn_is_identifiable(const Data *data, const Chain *chain) {
    const double *s = chain->stations;
    int64_t j = 0, before = -1;
    double here = s[0];
    for (int64_t i = 0; i < data->n; i++) {
        if (!(data->weight[i] > 0.0)) continue;
        double turned = turned_to(s[i], here, chain, &j);
        int64_t wide = before >= 0 && s[i] - s[before] > CHAIN_FIT.wide * data->spacing;
        double limit = wide ? 2.0 * CHAIN_FIT.most_turn : CHAIN_FIT.most_turn;
        if (before >= 0 && !(turned < limit)) return 0;
        before = i, here = s[i];
    }
    double end = most(s[data->n - 1], chain->form->piece[chain->k - 1].begin); /* where no point counts */
    return turned_to(end, here, chain, &j) < 2.0 * CHAIN_FIT.most_turn;
}

Chain chain_of(
    int64_t k, int64_t m, const double form[][3], const uint8_t curved[], const double stations[],
    const double matrix[], double cost) {
    return (Chain){.k = k, .m = m, .form = (Form *)form, .curved = curved, .stations = (double *)stations,
                   .matrix = (double *)matrix, .cost = cost};
}

/* Fit a chain by Levenberg and Marquardt, in place, and return how often the normal equations were built; see
   tss_fit_pieces. */
int64_t fit_pieces(const Data *data, Chain *chain, double goal, int64_t restart, Work w) {
    int64_t m = chain->m, n = data->n, evaluations = 1;
    double *lower = take(&w, m * m), *unit = take(&w, m), *step = take(&w, m);
    double damping = CHAIN_FIT.first_damping, reach = CHAIN_FIT.reach * data->spacing;
    double values = (double)value_count(data);
    Chain now = *chain, tried = *chain;
    tried.form = (Form *)take(&w, 12 + 3 * chain->k), tried.stations = take(&w, n);
    tried.square = take(&w, n), tried.matrix = take(&w, m * m), tried.gradient = take(&w, m);
    if (restart && data->free) from_first_foot(n, &now);
    normal_equations(data, &now, reach, w);
    for (int64_t count = 0; count < CHAIN_FIT.most_steps; count++) {
        factor(m, now.matrix, damping, lower, unit); /* docs/model.md (32) */
        solve(m, lower, unit, now.gradient, step);
        double enough = CHAIN_FIT.converged * (data->variance > 0.0 ? data->variance : now.cost / values);
        double promised = 0.0;
        for (int64_t a = 0; a < m; a++) promised += step[a] * now.gradient[a];
        if (!(promised >= enough) || damping * CHAIN_FIT.damping_of_failure > 1.0) break;
        if (count && now.cost - CHAIN_FIT.still_expected * promised > goal) break;
        step_chain(step, data->free, data->shortest * data->spacing, now.stations[n - 1], &now, tried.form);
        memcpy(tried.stations, now.stations, (size_t)n * sizeof(double));
        normal_equations(data, &tried, reach, w);
        evaluations++;
        if (tried.cost < now.cost && turn_is_identifiable(data, &tried)) {
            double saved = now.cost - tried.cost;
            Chain before = now;
            now = tried, tried = before;
            if (saved < enough && damping <= CHAIN_FIT.damping_of_failure) break;
            damping = most(CHAIN_FIT.easier * damping, ROUNDING.exact);
        } else {
            damping = most(CHAIN_FIT.harder * damping, CHAIN_FIT.damping_of_failure);
        }
    }
    if (now.form != chain->form) { /* the result is in the memory of the other */
        memcpy(chain->form, now.form, form_size(chain->k));
        memcpy(chain->stations, now.stations, (size_t)n * sizeof(double));
        memcpy(chain->square, now.square, (size_t)n * sizeof(double));
        memcpy(chain->gradient, now.gradient, (size_t)m * sizeof(double));
        memcpy(chain->matrix, now.matrix, (size_t)(m * m) * sizeof(double));
    }
    chain->cost = now.cost;
    return evaluations;
}

/* Whether the points are off the chain by no more than noise, of a variance as in the last frame [m²]. */
int64_t chain_fits(const Data *data, const Chain *chain, double last) {
    if (!turn_is_identifiable(data, chain)) return 0;
    double freedom = freedom_of(data, chain), highest = highest_mean_square(freedom);
    if (data->variance > 0.0) return chain->cost < highest * data->variance * freedom;
    double usual = most(last, squared(ROUNDING.relative * data->spacing)) * freedom;
    double lowest = squared(PRIOR.rounding * data->spacing) * freedom;
    if (squared(CHANCE.never) * most(chain->cost, lowest) < usual) return 0; /* the last frame is no measure of this one */
    return chain->cost < most(PASSES.warm_noise, 1.5 * highest) * usual;
}

/* Weights by the distance across a chain, and whether they differ from those of `data`; see
   tss_outlier_weights. */
int64_t outlier_weights(const Data *data, const double square[], double last, double weight[], Work w) {
    int64_t n = data->n, outliers = 0, differ = 0;
    double known = data->variance > 0.0 ? data->variance : last, robust = 0.0, *values = take(&w, n);
    double limit = outlier_limit(n, residual_variance(known, 0.0, data->spacing));
    for (int64_t i = 0; i < n; i++) differ |= !(square[i] <= limit) || data->weight[i] == 0.0;
    memcpy(weight, data->weight, (size_t)n * sizeof(double));
    if (!differ) return 0;
    if (!(data->variance > 0.0)) {
        memcpy(values, square, (size_t)n * sizeof(double));
        robust = median_of(n, values) / (data->free ? MEDIANS.square_2 : MEDIANS.square_3);
        limit = outlier_limit(n, residual_variance(known, robust, data->spacing)); /* docs/model.md (29) */
    }
    for (int64_t i = 0; i < n; i++) outliers += square[i] > limit;
    if ((double)outliers > OUTLIERS.share * (double)n) return 0;
    differ = 0;
    for (int64_t i = 0; i < n; i++) {
        weight[i] = square[i] > limit ? 0.0 : 1.0;
        differ |= weight[i] != data->weight[i];
    }
    return differ;
}

/** Return weights by distance from a chain: 0 for an outlier; and before these whether they differ from those
given.

`last`: least noise variance that is assumed where none is known [m²]. */
ENTRY int64_t tss_outlier_weights(
    int64_t n, const double square[n], const double weight[n], int64_t free, double variance, double spacing,
    double last, OUT double new_weight[n], WORK double work[n]) {
    Data data = {.n = n, .weight = weight, .free = free, .variance = variance, .spacing = spacing};
    return outlier_weights(&data, square, last, new_weight, (Work){work});
}

/** Return whether a chain of m parameters is off the points by no more than noise, as it was in the last
frame.

`form` has rows = k + 4 rows; `last`: noise variance of the last frame [m²]. A chain that turns unobserved
between its points fits nothing, however small the residuals of the inliers. */
ENTRY int64_t tss_chain_fits(
    int64_t n, int64_t rows, int64_t m, const double weight[n], int64_t free, double variance, double spacing,
    OPTIONAL const double unit_weight[n], const double form[rows][3], const double stations[n], double cost,
    double last) {
    if (n < 1 || rows < 5) return 0;
    Data data = {.n = n, .weight = weight, .free = free, .variance = variance, .spacing = spacing,
                 .unit_weight = unit_weight};
    Chain chain = chain_of(rows - 4, m, form, NULL, stations, NULL, cost);
    return chain_fits(&data, &chain, last);
}

/* Whether there is a point on every piece, or it is a kink between two points. */
static int64_t is_observed(const Data *data, const Chain *chain, Work w) {
    uint8_t *occupied = (uint8_t *)take(&w, chain->k);
    memset(occupied, 0, (size_t)chain->k);
    for (int64_t i = 0, j = 0; i < data->n; i++) {
        j = piece_of(chain, chain->stations[i], j);
        occupied[j] |= data->weight[i] > 0.0;
    }
    for (int64_t j = 0; j < chain->k; j++)
        if (!occupied[j] && !(piece_length(data, chain, j) < data->spacing)) return 0;
    return 1;
}

/* A chain that a fit writes into arrays of the caller's, as it is before. */
Chain begun_chain(
    int64_t n, int64_t k, int64_t m, const double form[][3], const uint8_t curved[], const double stations[],
    double new_form[][3], double new_stations[], double matrix[], double square[], Work *w) {
    Chain chain = chain_of(k, m, new_form, curved, new_stations, matrix, 0.0);
    chain.square = square, chain.gradient = take(w, m);
    memcpy(new_form, form, form_size(k));
    memcpy(new_stations, stations, (size_t)n * sizeof(double));
    return chain;
}

/** Fit a chain with its number of pieces by Levenberg and Marquardt; (31).

With a finite `least` it is a candidate: `better` is whether its criterion comes below that, with a point on
every piece or kink; the fit is given up, unfinished, where that is out of reach. With `restart` it begins
anew at the foot of the first point, where stations are unknown: in a fit its start moves only across
itself, so the ends of a route that moves would run away from it. `evaluations`: how often the normal equations
were built. */
ENTRY status tss_fit_pieces(
    int64_t n, int64_t k, int64_t m, const double points[n][3], const double weight[n], int64_t free,
    double variance, double spacing, OPTIONAL const double unit[n][3], OPTIONAL const double unit_weight[n],
    double shortest, const double form[k + 4][3], const uint8_t curved[k], const double stations[n],
    double least_criterion, int64_t restart, OUT int64_t *better, OUT int64_t *evaluations,
    OUT double new_form[k + 4][3], OUT double new_stations[n], OUT double matrix[m][m], OUT double *cost,
    OUT double square[n], WORK double work[4 * n + 60 * k * k + 600 * k + 400]) {
    if (!is_sized(n, k, m, curved, free)) return WRONG_SIZE;
    Work w = {work};
    Data data = {n, points, weight, free, variance, spacing, unit, unit_weight, shortest};
    Chain chain =
        begun_chain(n, k, m, form, curved, stations, new_form, new_stations, matrix[0], square, &w);
    double goal = isinf(least_criterion) ? INFINITY : cost_at_criterion(&data, m, least_criterion);
    *evaluations = fit_pieces(&data, &chain, goal, restart, w);
    /* a straightened, merged, dropped or split piece stays where the criterion falls; docs/model.md (126) */
    *better = criterion_of(&data, &chain) < least_criterion && is_observed(&data, &chain, w);
    /* a fit that came down slowly may have stopped short of its best */
    if (*better && !isinf(least_criterion)) *evaluations += fit_pieces(&data, &chain, INFINITY, 0, w);
    *cost = chain.cost;
    return DONE;
}
