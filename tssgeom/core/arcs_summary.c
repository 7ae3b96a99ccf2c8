/* What follows from a fitted chain of arcs: its pieces with their errors, and what other pieces promise. */
#include "arcs.h"
#include "route.h"

#include <string.h>

/* Mean square of the curvature that each straight piece may have [1/m²], 0 for a curved one; (124).

   A piece is straight where the criterion prefers it without curvature. It may be curved all the same, with
   the odds that the criterion gives, and then as in the best fit. */
static void hidden_bends(const Data *data, const Chain *chain, const double lower[], const double unit[],
                         double hidden[], Work w) {
    int64_t k = chain->k, m = chain->m, straight = 0;
    for (int64_t j = 0; j < k; j++) hidden[j] = 0.0, straight += !chain->curved[j];
    if (!straight) return;
    int64_t first = first_joint_column(data->free) + k - 1, all = first + 2 * k;
    uint8_t *curved = (uint8_t *)take(&w, k);
    memset(curved, 1, (size_t)k);
    Chain bent = *chain;
    bent.curved = curved, bent.m = all, bent.square = take(&w, data->n);
    bent.matrix = take(&w, all * all), bent.gradient = take(&w, all);
    normal_equations(data, &bent, 0.0, w);
    int64_t *fitted = (int64_t *)take(&w, m); /* where the parameters of the chain are among all */
    for (int64_t a = 0; a < first; a++) fitted[a] = a;
    for (int64_t j = 0, a = first; j < k; j++)
        for (int64_t c = 0; c < 2 && chain->curved[j]; c++) fitted[a++] = first + 2 * j + c;
    double *cross = take(&w, 2 * m), *gradient = take(&w, m);
    double own[4], left[4], rest[2], root[4], units[2], bend[2];
    double variance = noise_variance(data, chain), price = 2.0 * log((double)value_count(data));
    for (int64_t a = 0; a < m; a++) gradient[a] = bent.gradient[fitted[a]];
    for (int64_t j = 0; j < k; j++) {
        if (chain->curved[j]) continue;
        int64_t at = first + 2 * j;
        for (int64_t c = 0; c < 2; c++) {
            for (int64_t a = 0; a < m; a++) cross[2 * a + c] = bent.matrix[fitted[a] * all + at + c];
            for (int64_t e = 0; e < 2; e++) own[2 * c + e] = bent.matrix[(at + c) * all + at + e];
        }
        schur_complement(m, lower, unit, gradient, 2, cross, own, bent.gradient + at, left, rest, w);
        for (int e = 0; e < 4; e += 3) left[e] = most(left[e], ROUNDING.exact * own[e]);
        factor(2, left, ROUNDING.exact, root, units);
        solve(2, root, units, rest, bend);
        const double both[4] = {1.0, 0.0, 0.0, 1.0};
        double spread[4];
        propagated(2, root, units, 2, both, spread, w);
        double saved = bend[0] * rest[0] + bend[1] * rest[1];
        double odds = exp(least(0.5 * (saved / variance - price), 700.0));
        double share = k > 1 ? odds / (1.0 + odds) : 1.0;
        hidden[j] = share * (squared(bend[0]) + squared(bend[1]) + variance * (spread[0] + spread[3]));
    }
}

/* Piece whose bend is known least, if its points do not determine it, or -1. Such a piece may lie beyond
   the last joint that points surround. */
static int64_t unidentifiable_of(
    int64_t k, const double length[], const double covariance[], double spacing) {
    int64_t worst = -1;
    double error = IDENTIFIABLE.largest_se_short;
    for (int64_t j = 0; j < k; j++) {
        double se = sqrt(most(covariance[(k + j) * 2 * k + k + j], 0.0));
        int few = length[j] < IDENTIFIABLE.few_points * spacing;
        double limit = few ? error : most(error, CHAIN_PARAMETERS.half_turn);
        if (!(se < limit)) worst = j, error = se;
    }
    return k > 1 ? worst : -1;
}

/* Variances [k][3] of φ where each piece begins and of κ on it, and their covariance, of unit noise. */
static void variances_of_angle(
    const Chain *chain, int64_t joint, const double length[], const double lower[], const double unit[],
    double variances[][3], Work w) {
    int64_t k = chain->k, m = chain->m, r = 2 * k;
    double *gradient = take(&w, r * m), *spread = take(&w, r * r), before = 0.0;
    memset(gradient, 0, (size_t)(r * m) * sizeof(double));
    for (int64_t j = 0, column = joint + k; j < k; j++) { /* rows of κ, then of φ */
        double *own = gradient + j * m, *level = gradient + (k + j) * m, *last = level - m;
        const double *bend = chain->form->piece[j].bend;
        double kappa = sqrt(bend[0] * bend[0] + bend[1] * bend[1]);
        for (int64_t c = 0; c < 2 && chain->curved[j]; c++, column++)
            if (kappa > 0.0) own[column] = bend[c] / kappa;
        for (int64_t a = 0; a < m && j > 0; a++) level[a] = last[a] + length[j - 1] * own[a - m];
        if (j > 0) level[joint + j] = before - kappa;
        before = kappa;
    }
    propagated(m, lower, unit, r, gradient, spread, w);
    for (int64_t j = 0; j < k; j++) {
        variances[j][0] = spread[(k + j) * r + k + j];
        variances[j][1] = spread[j * r + j];
        variances[j][2] = spread[(k + j) * r + j];
    }
}

/* Lengths, angles, covariance [2k, 2k] and hidden bends of the pieces; returns the noise [m]; (33). Variances
   along the pieces are written unless NULL. */
static double pieces_of(
    const Data *data, const Chain *chain, double length[], double angle[], double covariance[],
    double hidden[], double variances[][3], Work w) {
    int64_t k = chain->k, m = chain->m, r = 2 * k, joint = first_joint_column(data->free) - 1;
    double *gradient = take(&w, r * m), *lower = take(&w, m * m), *unit = take(&w, m);
    double variance = residual_mean_square(data, chain);
    memset(gradient, 0, (size_t)(r * m) * sizeof(double));
    for (int64_t j = 0, column = joint + k; j < k; j++) {
        double *of_length = gradient + j * m, *of_angle = gradient + (k + j) * m;
        const double *bend = chain->form->piece[j].bend;
        double kappa = sqrt(bend[0] * bend[0] + bend[1] * bend[1]);
        double begin = j > 0 ? chain->form->piece[j].begin : chain->stations[0];
        length[j] = (j + 1 < k ? chain->form->piece[j + 1].begin : chain->stations[data->n - 1]) - begin;
        angle[j] = kappa * length[j]; /* docs/model.md (33) */
        if (chain->curved[j]) {
            if (kappa > 0.0)
                for (int c = 0; c < 2; c++) of_angle[column + c] = length[j] * bend[c] / kappa;
            column += 2;
        }
        if (j > 0) of_length[joint + j] = -1.0, of_angle[joint + j] = -kappa;
        if (j + 1 < k) of_length[joint + j + 1] = 1.0, of_angle[joint + j + 1] = kappa;
        else if (data->free) {
            double *slide = unit; /* used before the factor is */
            slide_of_end(data->n, chain, slide, w);
            for (int64_t a = 0; a < m; a++) of_length[a] += slide[a], of_angle[a] += kappa * slide[a];
        }
    }
    factor(m, chain->matrix, ROUNDING.exact, lower, unit);
    propagated(m, lower, unit, r, gradient, covariance, w);
    for (int64_t a = 0; a < r * r; a++) covariance[a] *= variance;
    hidden_bends(data, chain, lower, unit, hidden, w);
    if (variances != NULL) {
        variances_of_angle(chain, joint, length, lower, unit, variances, w);
        for (int64_t j = 0; j < k; j++)
            for (int c = 0; c < 3; c++) variances[j][c] *= variance;
    }
    for (int64_t j = 0; j < k; j++) covariance[(k + j) * r + k + j] += hidden[j] * squared(length[j]);
    if (data->free) /* an unknown station of an end takes its angle along */
        for (int end = 0; end < 2; end++) {
            int64_t j = end ? k - 1 : 0;
            const double *bend = chain->form->piece[j].bend;
            double kappa = sqrt(bend[0] * bend[0] + bend[1] * bend[1]);
            covariance[j * r + j] += variance;
            covariance[j * r + k + j] += variance * kappa;
            covariance[(k + j) * r + j] += variance * kappa;
            covariance[(k + j) * r + k + j] += variance * kappa * kappa;
        }
    return sqrt(variance);
}

/** Return the pieces of a fitted chain: lengths [m], angles [rad], covariance of both, noise [m]; (33),
(124).

`unidentifiable` is the piece whose bend is known least, if its points do not determine it, or -1; `hidden`
the mean square of the curvature that each straight piece may have [1/m²]; `variances` those of the angle where
each piece begins [rad²] and of its curvature [1/m²], and their covariance [1/m], without what is hidden. */
ENTRY status tss_chain_pieces(
    int64_t n, int64_t k, int64_t m, const double points[n][3], const double weight[n], int64_t free,
    double variance, double spacing, OPTIONAL const double unit[n][3], OPTIONAL const double unit_weight[n],
    const double form[k + 4][3], const uint8_t curved[k], const double stations[n], const double matrix[m][m],
    double cost, OUT double length[k], OUT double angle[k], OUT double covariance[2 * k][2 * k],
    OUT double *noise, OUT int64_t *unidentifiable, OUT double hidden[k],
    OUT double variances[k][3], WORK double work[4 * n + 60 * k * k + 600 * k + 400]) {
    if (!is_sized(n, k, m, curved, free)) return WRONG_SIZE;
    Data data = {n, points, weight, free, variance, spacing, unit, unit_weight, 1.0};
    Chain chain = chain_of(k, m, form, curved, stations, matrix[0], cost);
    *noise = pieces_of(&data, &chain, length, angle, covariance[0], hidden, variances, (Work){work});
    *unidentifiable = unidentifiable_of(k, length, covariance[0], spacing);
    return DONE;
}

/** Return the mean spacing of points and the shortest piece of a chain that goes on with them [m], [spacings]. */
ENTRY status tss_chain_scale(
    int64_t n, int64_t rows, const double points[n][3], const double form[rows][3], const double stations[n],
    OUT double *spacing, OUT double *shortest, WORK double work[n]) {
    if (n < 2) return WRONG_SIZE;
    *spacing = tss_spacing_of_pieces(n, points, stations[n - 1] - stations[0], work);
    *shortest = 1.0;
    for (int64_t i = 5; i + 1 < rows; i++) /* a kink is an inner piece that is shorter than the spacing */
        if (form[i + 1][0] - form[i][0] < *spacing) *shortest = CHAIN_FIT.kink;
    return DONE;
}

/** Fit the chain of the last frame to the points of this one, without outliers, and return its pieces; (34).

`last`: noise variance of the last frame [m²]; `spacing` and `shortest` as in `chain_scale`; `fits` as in
`chain_fits`; the rest as in `fit_pieces`, `chain_pieces`. */
ENTRY status tss_follow_chain(
    int64_t n, int64_t k, int64_t m, const double points[n][3], int64_t free, double variance,
    OPTIONAL const double unit[n][3], OPTIONAL const double unit_weight[n], const double form[k + 4][3],
    const uint8_t curved[k], const double stations[n], double last, OUT double *spacing, OUT double *shortest,
    OUT int64_t *fits, OUT double new_weight[n], OUT double new_form[k + 4][3], OUT double new_stations[n],
    OUT double matrix[m][m], OUT double *cost, OUT double square[n], OUT double length[k], OUT double angle[k],
    OUT double covariance[2 * k][2 * k], OUT double *noise, OUT int64_t *unidentifiable,
    WORK double work[6 * n + 60 * k * k + 600 * k + 400]) {
    if (n < 2 || !is_sized(n, k, m, curved, free)) return WRONG_SIZE;
    Work w = {work};
    double *ones = take(&w, n), *hidden = take(&w, k);
    tss_chain_scale(n, k + 4, points, form, stations, spacing, shortest, ones);
    for (int64_t i = 0; i < n; i++) ones[i] = 1.0;
    Data data = {n, points, ones, free, variance, *spacing, unit, unit_weight, *shortest};
    Chain chain =
        begun_chain(n, k, m, form, curved, stations, new_form, new_stations, matrix[0], square, &w);
    fit_pieces(&data, &chain, INFINITY, 1, w);
    int64_t differ = outlier_weights(&data, square, last, new_weight, w);
    data.weight = new_weight;
    if (differ) fit_pieces(&data, &chain, INFINITY, 0, w);
    *fits = chain_fits(&data, &chain, last);
    *cost = chain.cost;
    *noise = pieces_of(&data, &chain, length, angle, covariance[0], hidden, NULL, w);
    *unidentifiable = unidentifiable_of(k, length, covariance[0], *spacing);
    return DONE;
}

/* What d sums of more parameters save of the cost [m²]: left and rest are the information and the gradient of
   these, the rest of the chain fitted with them, and own the information without that; rows are `stride`
   apart. Sum e is of `width` parameters from the one at begin[e]. */
static double saved_by_sums(
    int64_t width, int64_t stride, const double left[], const double own[], const double rest[], int64_t d,
    const double sums[], const int64_t begin[], Work w) {
    double *matrix = take(&w, d * d), *slope = take(&w, d), *step = take(&w, d);
    double *lower = take(&w, d * d), *unit = take(&w, d), saved = 0.0;
    for (int64_t e = 0; e < d; e++) {
        const double *sum = sums + e * width;
        double whole = 0.0;
        slope[e] = 0.0;
        for (int64_t a = 0; a < width; a++) {
            const double *row = own + (begin[e] + a) * stride + begin[e];
            slope[e] += sum[a] * rest[begin[e] + a];
            for (int64_t b = 0; b < width; b++) whole += sum[a] * row[b] * sum[b];
        }
        for (int64_t f = 0; f <= e; f++) {
            const double *other = sums + f * width;
            double value = 0.0;
            for (int64_t a = 0; a < width; a++) {
                const double *row = left + (begin[e] + a) * stride + begin[f];
                for (int64_t b = 0; b < width; b++) value += sum[a] * row[b] * other[b];
            }
            if (e == f) value = most(value, ROUNDING.exact * whole);
            matrix[e * d + f] = value; /* what is above the diagonal is not read */
        }
    }
    factor(d, matrix, ROUNDING.exact, lower, unit);
    solve(d, lower, unit, slope, step);
    for (int64_t e = 0; e < d; e++) saved += step[e] * slope[e];
    return saved;
}

/* Write the normal equations of a chain with every piece cut into equal parts that have curvatures of their
   own.

   What is left of the information on these p = 2 parts k curvatures [p, p] and of their gradient [p], the
   parameters of the chain fitted with them, and their information before that: `left`, `rest` and `own`. */
static void part_equations(
    const Data *data, const Chain *chain, double left[], double rest[], double own[], Work w) {
    int64_t k = chain->k, m = chain->m, parts = CHAIN_MOVES.parts, n = parts * k, p = 2 * n;
    int64_t base = first_joint_column(data->free), first = base + n - 1, all = first + p, row = base + k - 1;
    uint8_t *curved = (uint8_t *)take(&w, n);
    memset(curved, 1, (size_t)n);
    Chain cut = *chain;
    cut.k = n, cut.m = all, cut.curved = curved, cut.form = (Form *)take(&w, 12 + 3 * n);
    cut.matrix = take(&w, all * all), cut.gradient = take(&w, all), cut.square = take(&w, data->n);
    memcpy(cut.form, chain->form, sizeof *cut.form);
    for (int64_t i = 0; i < n; i++) {
        int64_t j = i / parts;
        double share = (double)(i % parts) / (double)parts;
        cut.form->piece[i].begin = chain->form->piece[j].begin + piece_length(data, chain, j) * share;
        memcpy(cut.form->piece[i].bend, chain->form->piece[j].bend, sizeof cut.form->piece[i].bend);
    }
    normal_equations(data, &cut, 0.0, w);
    double *cross = take(&w, m * p), *gradient = take(&w, m), *lower = take(&w, m * m), *unit = take(&w, m);
    memset(cross, 0, (size_t)(m * p) * sizeof(double));
    memset(gradient, 0, (size_t)m * sizeof(double));
    /* joints inside a piece have no effect, the curvature being the same; a piece's is that of its parts */
    for (int64_t a = 0; a < row; a++) {
        int64_t source = a < base ? a : base + parts * (a - base + 1) - 1;
        gradient[a] = cut.gradient[source];
        memcpy(cross + a * p, cut.matrix + source * all + first, (size_t)p * sizeof(double));
    }
    for (int64_t i = 0; i < p; i++) {
        memcpy(own + i * p, cut.matrix + (first + i) * all + first, (size_t)p * sizeof(double));
        if (i > 0 && i % (2 * parts) == 0) row += chain->curved[i / (2 * parts) - 1] ? 2 : 0;
        if (!chain->curved[i / (2 * parts)]) continue;
        int64_t a = row + i % 2;
        gradient[a] += cut.gradient[first + i];
        for (int64_t b = 0; b < p; b++) cross[a * p + b] += own[i * p + b];
    }
    factor(m, chain->matrix, ROUNDING.exact, lower, unit);
    schur_complement(m, lower, unit, gradient, p, cross, own, cut.gradient + first, left, rest, w);
}

/** Return what a joint in each piece would save at best, and at which part of it, and what slopes would save.

`saved` [k] in noise variances; `part` [k]: part of the piece before which the joint is; `by_slopes`: what
sloping curvature in every piece would save beyond chance [noise variances]. The steps of a staircase that
stands for a smooth route fit better with a slope; those of true pieces do not. */
ENTRY status tss_saved_by_parts(
    int64_t n, int64_t k, int64_t m, const double points[n][3], const double weight[n], int64_t free,
    double variance, double spacing, OPTIONAL const double unit[n][3], OPTIONAL const double unit_weight[n],
    const double form[k + 4][3], const uint8_t curved[k], const double stations[n], const double matrix[m][m],
    double cost, OUT double saved[k], OUT int64_t part[k], OUT double *by_slopes,
    WORK double work[4 * n + 500 * k * k + 2400 * k + 800]) {
    if (!is_sized(n, k, m, curved, free)) return WRONG_SIZE;
    Work w = {work};
    Data data = {n, points, weight, free, variance, spacing, unit, unit_weight, 1.0};
    Chain chain = chain_of(k, m, form, curved, stations, matrix[0], cost);
    if (CHAIN_MOVES.parts > 4) return WRONG_SIZE; /* the header's working memory is that of four */
    int64_t parts = CHAIN_MOVES.parts, of_piece = 2 * parts, p = of_piece * k;
    double *left = take(&w, p * p), *rest = take(&w, p), *own = take(&w, p * p);
    double *sums = take(&w, (2 * k + 2) * of_piece);
    int64_t *begin = (int64_t *)take(&w, 2 * k + 2);
    double noise = noise_variance(&data, &chain);
    part_equations(&data, &chain, left, rest, own, w);
    for (int64_t j = 0; j < k; j++) {
        saved[j] = 0.0, part[j] = 0;
        if (!(piece_length(&data, &chain, j) >= (double)CHAIN_MOVES.parts * spacing)) continue;
        for (int64_t e = 0; e < 4; e++) begin[e] = of_piece * j;
        for (int64_t cut = 1; cut < parts; cut++) {
            /* the level of a curved piece is a parameter already: one side of the joint is enough */
            int64_t d = curved[j] ? 2 : 4;
            for (int64_t e = 0; e < d; e++)
                for (int64_t a = 0; a < of_piece; a++)
                    sums[e * of_piece + a] = a % 2 == e % 2 && (a / 2 >= cut) == (e >= 2);
            double here = saved_by_sums(of_piece, p, left, own, rest, d, sums, begin, w);
            if (here / noise > saved[j]) saved[j] = here / noise, part[j] = cut;
        }
    }
    for (int64_t e = 0; e < 2 * k; e++) {
        begin[e] = of_piece * (e / 2);
        for (int64_t a = 0; a < of_piece; a++)
            sums[e * of_piece + a] =
                a % 2 == e % 2 ? (double)(a / 2) - 0.5 * (double)(parts - 1) : 0.0;
    }
    *by_slopes = saved_by_sums(of_piece, p, left, own, rest, 2 * k, sums, begin, w) / noise - (double)(2 * k);
    return DONE;
}
