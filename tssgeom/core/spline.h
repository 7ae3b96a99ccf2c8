/* The smoothing spline of a route: Kalman filter, smoother, and the search for its smoothness.

   Lengths are in units of the mean spacing of the points unless said otherwise. λ is the noise variance of a
   point over the intensity q of the white noise that moves the fourth derivative; docs/model.md (20) to (22). */
#pragma once
#include "core.h"

/* Points and prior as the filter takes them. */
typedef struct {
    int64_t n;
    const double *u;                 /* stations [n] */
    const double (*y)[3];            /* points [n][3] */
    const double *weight;            /* of each point, 0 where it was not observed or is an outlier [n] */
    const double (*transition)[12];  /* of the state over the interval before each station [n][12] */
    const double (*start)[4];        /* guess of the state at the first station [3][4] */
    const double *ends;              /* variances of r and T at the first station, of a and b at both ends, over
                                        the noise variance [4] */
    const double (*curve_tangent)[3]; /* unit tangents of the curve of the last pass [n][3] */
    int64_t across_only;             /* whether only the part of an innovation normal to these counts */
    const double (*tangent)[3];      /* sensed directions, NULL for none [n][3] */
    const double *tangent_variance;  /* of a component of each, 0 where none is used [n] [rad²] */
} FilterModel;

/* The model of an entry's parameters; directions count where they have variances. */
static inline FilterModel filter_model(
    int64_t n, const double u[], const double y[][3], const double weight[], const double transition[][12],
    const double start[][4], const double ends[], const double curve_tangent[][3], int64_t across_only,
    const double tangent[][3], const double tangent_variance[]) {
    return (FilterModel){
        n, u, y, weight, transition, start, ends, curve_tangent, across_only, tangent_variance ? tangent : NULL,
        tangent_variance};
}

/* What a filter or a search ends with. */
typedef struct {
    double ratio, intensity; /* λ and q */
    double log_s, squares;   /* sum of ln of the innovation variances; of squared standardised innovations */
    int64_t values;          /* innovations of one coordinate */
} Likelihood;

double best_ratio(const FilterModel *model, double variance, double guess);
void set_intensity(const FilterModel *model, double variance, Likelihood *at);
/* Posterior as `tss_smooth` returns it; `at`, where not NULL, gets log_s, squares and values without directions. */
void smooth(
    const FilterModel *model, double ratio, double inverse_intensity, double mean[][3][4],
    double covariance[][10], double gain[][4][4], double predicted[][10], Likelihood *at);
void transitions(int64_t n, const double u[], const double coupling[][3], double out[][12]);
double spline_deviance(Likelihood at, double spacing);

/** Carry the state over every interval before a station.

Parameters: stations; κ² and κκ' on the interval before each station, and ω². */
ENTRY void tss_transitions(
    int64_t n, const double u[n], const double coupling[n][3], OUT double transition[n][12]);

/** Stations, coupling, variances at the ends and tangents for the next pass; docs/model.md (20) to (22).

Unknown stations move to the feet of the points on the curve of this pass. */
ENTRY void tss_prior_along_curve(
    int64_t n, const double u[n], const double y[n][3], const double weight[n], double ratio, double q,
    const double mean[n][3][4], const double covariance[n][10], int64_t known, OUT double next_u[n],
    OUT double coupling[n][3], OUT double ends[4], OUT double tangent[n][3], WORK double work[5][n]);

/** Filter forward, for noise variance λ/weight and q = 1.

Returns standardised innovations; log_s and squares, the sums of the logarithms of the innovation variances,
less what the prior of the ends would be worth without any point, and of the squared standardised innovations;
and how many. `inverse_intensity` is 1/q, in which the variances of sensed directions are counted. */
ENTRY void tss_innovations(
    int64_t n, const double u[n], const double y[n][3], const double weight[n],
    const double transition[n][12], const double start[3][4], const double ends[4],
    const double curve_tangent[n][3], int64_t across_only, OPTIONAL const double tangent[n][3],
    OPTIONAL const double tangent_variance[n], double ratio, double inverse_intensity,
    OUT double standardised[n][3], OUT double *log_s, OUT double *squares, OUT int64_t *values);

/** λ of greatest restricted likelihood, its intensity q, and log_s, squares and values of `innovations` there.

`variance` is the known noise variance, or 0; it is not 0 beside sensed directions. `guess` is the λ to begin
with; where it is not positive, everything from interpolation to one cubic through all points is tried. */
ENTRY void tss_best_ratio(
    int64_t n, const double u[n], const double y[n][3], const double weight[n],
    const double transition[n][12], const double start[3][4], const double ends[4],
    const double curve_tangent[n][3], int64_t across_only, OPTIONAL const double tangent[n][3],
    OPTIONAL const double tangent_variance[n], double variance, double guess, OUT double *ratio,
    OUT double *intensity, OUT double *log_s, OUT double *squares, OUT int64_t *values);

/** Posterior of the curve at all stations, for noise variance λ/weight and q = 1 (Rauch, Tung, Striebel).

Returns the state of each coordinate; the covariance of one coordinate; and the smoother gains, so that
Cov(state i, state i+1) = gain i times covariance i+1. */
ENTRY status tss_smooth(
    int64_t n, const double u[n], const double y[n][3], const double weight[n],
    const double transition[n][12], const double start[3][4], const double ends[4],
    const double curve_tangent[n][3], int64_t across_only, OPTIONAL const double tangent[n][3],
    OPTIONAL const double tangent_variance[n], double ratio, double inverse_intensity,
    OUT double mean[n][3][4], OUT double covariance[n][10], OUT double gain[n - 1][4][4],
    WORK double predicted[n][10]);

/** Mark points whose leave-one-out residual is beyond chance and a jump of curvature; count those with a weight. */
ENTRY int64_t tss_outlying_points(
    int64_t n, const double u[n], const double y[n][3], const double weight[n], double variance, double ratio,
    const double mean[n][3][4], const double covariance[n][10], OUT uint8_t outlier[n], WORK double work[3][n]);

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
    WORK double work[120][rows]);

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
    WORK double work[60][rows]);
