/* The smooth fit of a route that moves, one frame in one call; and its outliers and nodes. */
#include "route.h"
#include "spline.h"
#include "statistics.h"

#include <string.h>

/* Hand out a part of the working memory. */
static double *take(double **room, int64_t count) {
    double *part = *room;
    *room += count;
    return part;
}

/** Mark points whose leave-one-out residual is beyond chance and a jump of curvature; count those with a weight. */
ENTRY int64_t tss_outlying_points(
    int64_t n, const double u[n], const double y[n][3], const double weight[n], double variance, double ratio,
    const double mean[n][3][4], const double covariance[n][10], OUT uint8_t outlier[n], WORK double work[3][n]) {
    double *size = work[0], *left_out = work[1], *sizes = work[2], sharpest = 0.0;
    int64_t used = 0, count = 0;
    for (int64_t i = 0; i < n; i++) {
        double t[3], a[3], apart[3], off = 0.0, bend = 0.0;
        for (int c = 0; c < 3; c++) t[c] = mean[i][c][1], a[c] = mean[i][c][2], apart[c] = y[i][c] - mean[i][c][0];
        double square = most(dot3(t, t), 1e-24), along = dot3(apart, t), a_along = dot3(a, t);
        for (int c = 0; c < 3; c++) {
            off += squared(apart[c] - along * t[c] / square);
            bend += squared(a[c] - a_along * t[c] / square);
        }
        if (weight[i] > 0.0) {
            double own = most(1.0 - covariance[i][0] / ratio, 1e-12);
            size[i] = sizes[used++] = sqrt(off / own), left_out[i] = sqrt(off) / own;
            sharpest = most(sharpest, bend / (square * square));
        } else {
            size[i] = sqrt(off / (1.0 + covariance[i][0] / ratio)), left_out[i] = sqrt(off);
        }
    }
    double robust = squared(median_of(used, sizes) / MEDIANS.length_2);
    double limit = sqrt(outlier_limit(n, residual_variance(variance, robust, 1.0))); /* docs/model.md (29) */
    sharpest = least(sqrt(sharpest), OUTLIERS.sharpest);
    for (int64_t i = 0; i < n; i++) {
        outlier[i] = 0;
        if (size[i] <= limit) continue;
        double share = OUTLIERS.bend_share, worst = 0.0;
        if (i == 0 || i == n - 1) share = OUTLIERS.bend_share_at_end;
        else if (i == 1 || i == n - 2) share = 0.5 * OUTLIERS.bend_share_at_end;
        int64_t left = i > 0 ? i - 1 : 0, right = i + 1 < n ? i + 1 : n - 1, is_used = weight[i] > 0.0;
        double step = (u[right] - u[left]) / (double)(right - left);
        for (int64_t k = i - OUTLIERS.neighbours; k <= i + OUTLIERS.neighbours && is_used; k++)
            if (k >= 0 && k < n && weight[k] > 0.0) worst = most(worst, size[k]);
        if (left_out[i] > share * sharpest * step * step && size[i] >= worst) outlier[i] = 1, count += is_used;
    }
    return count;
}

/* Whether a point without weight is no outlier any more, so that the weights no longer hold. */
static int64_t may_return(int64_t n, const double weight[], const uint8_t outlier[]) {
    for (int64_t i = 0; i < n; i++)
        if (weight[i] <= 0.0 && !outlier[i]) return 1;
    return 0;
}

/* Nodes of a route in SI. */
typedef struct {
    double *s, (*position)[3], (*tangent)[3], (*bend)[3], (*covariance)[10], (*gain)[4][4];
} Nodes;

/* Arc length, positions, tangents, curvature vectors, covariance and gains in SI; the covariance may be its own. */
static void in_metres(
    int64_t n, const double u[], const double mean[][3][4], const double covariance[][10], const double gain[][4][4],
    const double origin[3], double spacing, double q, int64_t known, Nodes out) {
    const double unit[4] = {spacing, 1.0, 1.0 / spacing, 1.0 / (spacing * spacing)};
    double pair[10], arc = 0.0, before = 0.0;
    for (int i = 0, k = 0; i < 4; i++)
        for (int j = i; j < 4; j++, k++) pair[k] = unit[i] * unit[j] * q;
    for (int64_t i = 0; i < n; i++) {
        double t[3], a[3];
        for (int c = 0; c < 3; c++) t[c] = mean[i][c][1], a[c] = mean[i][c][2];
        double square = most(dot3(t, t), 1e-24), speed = sqrt(square), along = dot3(t, a) / square;
        for (int c = 0; c < 3; c++) {
            out.position[i][c] = mean[i][c][0] * spacing + origin[c];
            out.tangent[i][c] = t[c] / speed;
            out.bend[i][c] = (a[c] - along * t[c]) / (square * spacing);
        }
        if (i > 0) arc += 0.5 * (speed + before) * (u[i] - u[i - 1]);
        before = speed;
        out.s[i] = (known ? u[i] : arc) * spacing;
        for (int k = 0; k < 10; k++) out.covariance[i][k] = covariance[i][k] * pair[k];
        for (int j = 0; j < 4 && i < n - 1; j++)
            for (int k = 0; k < 4; k++) out.gain[i][j][k] = gain[i][j][k] * unit[j] / unit[k];
    }
}

/* Split every interval longer than a part of the whole; returns how many nodes, and which are the stations. */
static int64_t insert_nodes(int64_t n, const double u[], int64_t rows, double nodes[], int64_t where[]) {
    double longest = u[n - 1] / (double)(NODES.fewest);
    int64_t count = 1;
    nodes[0] = u[0], where[0] = 0;
    for (int64_t i = 1; i < n; i++) {
        double h = u[i] - u[i - 1], wanted = most(ceil(h / longest - 1e-9), 1.0);
        int64_t room = rows - count - (n - 1 - i), parts = wanted < (double)room ? (int64_t)wanted : room;
        for (int64_t k = 1; k < parts; k++) nodes[count++] = u[i - 1] + h / (double)parts * (double)k;
        where[i] = count;
        nodes[count++] = u[i];
    }
    return count;
}

/* The posterior of a fit at its stations, and on nodes in between where these are few. */
static int64_t spline_nodes(
    const FilterModel *given, const double coupling[][3], Likelihood at, const double mean[][3][4],
    const double covariance[][10], const double gain[][4][4], const double origin[3], double spacing, int64_t known,
    int64_t rows, Nodes out, int64_t where[], double *room) {
    int64_t n = given->n;
    if (n >= NODES.fewest) {
        for (int64_t i = 0; i < n; i++) where[i] = i;
        in_metres(n, given->u, mean, covariance, gain, origin, spacing, at.intensity, known, out);
        return n;
    }
    double *u = take(&room, rows), *weight = take(&room, rows), (*y)[3] = (double(*)[3])take(&room, 3 * rows);
    double(*step)[3] = (double(*)[3])take(&room, 3 * rows), (*tangent)[3] = (double(*)[3])take(&room, 3 * rows);
    double *tangent_variance = take(&room, rows), (*f)[12] = (double(*)[12])take(&room, 12 * rows);
    double(*state)[3][4] = (double(*)[3][4])take(&room, 12 * rows), (*predicted)[10] = (double(*)[10])take(&room, 10 * rows);
    int64_t count = insert_nodes(n, given->u, rows, u, where);
    for (int64_t k = 0, i = 0; k < count; k++) {
        int here = k == where[i];
        weight[k] = here ? given->weight[i] : 0.0;
        tangent_variance[k] = here && given->tangent ? given->tangent_variance[i] : 0.0;
        for (int c = 0; c < 3; c++) {
            y[k][c] = here ? given->y[i][c] : 0.0;
            tangent[k][c] = here && given->tangent ? given->tangent[i][c] : 0.0;
            step[k][c] = coupling[i][c];
        }
        if (here && i < n - 1) i++;
    }
    transitions(count, u, step, f);
    FilterModel model = {count, u, y, weight, f, given->start, given->ends, y, given->across_only, given->tangent ? tangent : NULL, tangent_variance};
    smooth(&model, at.ratio, 1.0 / at.intensity, state, out.covariance, out.gain, predicted, NULL);
    in_metres(count, u, state, out.covariance, out.gain, origin, spacing, at.intensity, known, out);
    return count;
}

/** Nodes of a fitted route in SI: the stations, and more in between where these are few.

Parameters: stations, points and weights of the last pass; guess at the first station, variances at the ends and
coupling of its prior; sensed directions; λ and q; the posterior at the stations; the first point [m]; the
spacing [m]; whether stations are known. Returned as by `spline_frame`, and which nodes are the stations. */
ENTRY status tss_spline_nodes(
    int64_t n, const double u[n], const double y[n][3], const double weight[n], const double start[3][4],
    const double ends[4], int64_t across_only, const double coupling[n][3],
    OPTIONAL const double tangent[n][3], OPTIONAL const double tangent_variance[n], double ratio,
    double intensity, const double mean[n][3][4], const double covariance[n][10],
    const double gain[n - 1][4][4], const double origin[3], double spacing, int64_t known, int64_t rows,
    OUT int64_t *count, OUT double s[rows], OUT double vectors[3][rows][3],
    OUT double node_covariance[rows][10], OUT double node_gain[rows][4][4], OUT int64_t where[n],
    WORK double work[60][rows]) {
    if (n < 2 || rows < n) return WRONG_SIZE;
    FilterModel model = filter_model(n, u, y, weight, NULL, start, ends, NULL, across_only, tangent, tangent_variance);
    Likelihood at = {ratio, intensity, 0.0, 0.0, 0};
    Nodes out = {s, vectors[0], vectors[1], vectors[2], node_covariance, node_gain};
    *count = spline_nodes(&model, coupling, at, mean, covariance, gain, origin, spacing, known, rows, out, where, work[0]);
    return isfinite(s[*count - 1]) ? DONE : NO_FINITE_CURVE;
}

/** Go on with the smooth fit of a route that moves: one pass that begins with the last one, and its nodes.

Parameters: points of this frame [m]; stations, points and weights of the last pass, its posterior, λ and q; the
factor up to which the noise variance may have changed since; its spacing [m]; the known noise variance or 0;
known stations. `rows` is room for the nodes, n where that is 120 or more and else n + 120. `result` has λ, q,
the effective number of parameters of a coordinate, -2 ln of the evidence [ln m²], and whether the last λ, noise
and weights still held, without which the rest has no meaning.
Returned are also u, y and the posterior at the stations for the next frame; and in SI, on `count` nodes: arc
length; positions, tangents and curvature vectors; covariance of the state of (20); gains; and the nodes at
which pieces of constant curvature meet. `station` are the nodes of the points [m]. */
ENTRY status tss_spline_frame(
    int64_t n, const double points[n][3], const double last_u[n], const double last_y[n][3],
    const double weight[n], const double last_mean[n][3][4], const double last_covariance[n][10],
    double last_ratio, double last_intensity, double growth, double spacing, double variance,
    OPTIONAL const double stations[n], int64_t rows, OUT double result[5], OUT double u[n], OUT double y[n][3],
    OUT double mean[n][3][4], OUT double covariance[n][10], OUT int64_t *count, OUT double s[rows],
    OUT double vectors[3][rows][3], OUT double node_covariance[rows][10], OUT double node_gain[rows][4][4],
    OUT double station[n], OUT double residual[n][3], OUT int64_t joints[rows + 1], OUT int64_t *pieces,
    WORK double work[120][rows]) {
    if (n < 2 || rows < n) return WRONG_SIZE;
    double *room = work[0], ends[4], start[3][4];
    double(*coupling)[3] = (double(*)[3])take(&room, 3 * n), (*curve_tangent)[3] = (double(*)[3])take(&room, 3 * n);
    double(*f)[12] = (double(*)[12])take(&room, 12 * n), (*gain)[4][4] = (double(*)[4][4])take(&room, 16 * n);
    int64_t *where = (int64_t *)take(&room, n), known = stations != NULL;
    uint8_t *outlier = (uint8_t *)take(&room, n);
    Likelihood at;
    for (int k = 0; k < 5; k++) result[k] = 0.0;
    *count = *pieces = 0;
    for (int64_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) y[i][c] = (points[i][c] - points[0][c]) / spacing;
    tss_prior_along_curve(
        n, last_u, last_y, weight, last_ratio, last_intensity, last_mean, last_covariance, known, u, coupling, ends,
        curve_tangent, (double(*)[n])room);
    for (int64_t i = 0; i < n && known; i++) u[i] = stations[i] / spacing;
    transitions(n, u, coupling, f);
    memcpy(start, last_mean[0], sizeof start);
    for (int c = 0; c < 3; c++) start[c][0] = y[0][c];
    FilterModel model = {n, u, y, weight, f, start, ends, curve_tangent, 1, NULL, NULL};
    double ratio = best_ratio(&model, variance, last_ratio);
    if (!(ratio > 0.0)) return DONE;
    smooth(&model, ratio, 0.0, mean, covariance, gain, (double(*)[10])room, &at);
    set_intensity(&model, variance, &at);
    double change = at.ratio * at.intensity / most(last_ratio * last_intensity, 1e-300);
    double lowest = least(growth, 1.0) / PASSES.warm_noise, highest = most(growth, 1.0) * PASSES.warm_noise;
    result[0] = at.ratio, result[1] = at.intensity, result[3] = spline_deviance(at, spacing);
    if (!(lowest < change && change < highest)) return DONE;
    if (tss_outlying_points(n, u, y, weight, variance, at.ratio, mean, covariance, outlier, (double(*)[n])room)) return DONE;
    if (may_return(n, weight, outlier)) return DONE;
    Nodes nodes = {s, vectors[0], vectors[1], vectors[2], node_covariance, node_gain};
    *count = spline_nodes(&model, coupling, at, mean, covariance, gain, points[0], spacing, known, rows, nodes, where, room);
    if (!isfinite(s[*count - 1])) return DONE;
    double freedom = 0.0;
    for (int64_t i = 0; i < n; i++) {
        freedom += weight[i] * covariance[i][0] / at.ratio;
        station[i] = s[where[i]];
        for (int c = 0; c < 3; c++) residual[i][c] = points[i][c] - nodes.position[where[i]][c];
    }
    *pieces = pieces_of_curvature(*count, s, nodes.tangent, nodes.bend, node_covariance, freedom, (double)n, joints, room);
    result[2] = freedom, result[4] = 1.0;
    return DONE;
}
