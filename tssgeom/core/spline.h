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

void tss_prior_along_curve(
    int64_t n, const double u[n], const double y[n][3], const double weight[n], double ratio, double q,
    const double mean[n][3][4], const double covariance[n][10], int64_t known, double next_u[n],
    double coupling[n][3], double ends[4], double tangent[n][3], double work[5][n]);
