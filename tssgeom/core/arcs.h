/* A chain of circular arcs fitted to points; docs/model.md (30) to (34).

   Every entry takes the points and the chain in the same way.
     points [n][3] [m]; weight [n], 0 for an outlier; free: 1 where stations are unknown, so that only
     distances across the chain count; variance: known noise of a coordinate, 0 where unknown [m²]; spacing:
     mean spacing of the points [m]; shortest: shortest piece [spacings]; unit [n][3] and unit_weight [n]:
     sensed directions, and the noise variance of the points over that of each direction, 0 where it is not
     used [m²], or NULL.
     form [k + 4][3]: position where the chain begins [m]; its axes there: tangent, both normals; then of each
     piece the arc length at which it begins [m], and its curvature components on the normals [1/m].
     curved [k]: 0 for a straight piece. stations [n]: arc length of the foot of each point [m].
   The m parameters in order: start (2 across where free, else 3), turns about both normals (2), inner joints
   (k - 1), curvature components of the curved pieces. matrix [m][m]: normal equations of Gauss and Newton;
   cost: weighted sum of squares [m²]; square [n]: squared distance of each point, across the chain where
   free [m²]. */
#pragma once
#include "core.h"

typedef struct {
    int64_t n;
    const double (*points)[3], *weight;
    int64_t free;
    double variance, spacing;
    const double (*unit)[3], *unit_weight;
    double shortest;
} Data;

typedef struct {
    double start[3], axes[3][3];
    struct {
        double begin, bend[2];
    } piece[];
} Form;

typedef struct {
    int64_t k, m;
    Form *form;
    const uint8_t *curved;
    double *stations, *matrix, *gradient, *square, cost;
} Chain;

/** Return position [m] and axes (tangent, both normals) of a chain at arc lengths `s` [r] [m]; (30).

`form` has rows = k + 4 rows. */
ENTRY status tss_along_chain(
    int64_t r, int64_t rows, const double s[r], const double form[rows][3], OUT double position[r][3],
    OUT double frame[r][3][3], WORK double work[12 * rows]);

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
    OUT double square[n], WORK double work[4 * n + 60 * k * k + 600 * k + 400]);

/** Return weights by distance from a chain: 0 for an outlier; and before these whether they differ from those
given.

`last`: least noise variance that is assumed where none is known [m²]. */
ENTRY int64_t tss_outlier_weights(
    int64_t n, const double square[n], const double weight[n], int64_t free, double variance, double spacing,
    double last, OUT double new_weight[n], WORK double work[n]);

/** Return whether a chain of m parameters is off the points by no more than noise, as it was in the last
frame.

`form` has rows = k + 4 rows; `last`: noise variance of the last frame [m²]. A chain that turns unobserved
between its points fits nothing, however small the residuals of the inliers. */
ENTRY int64_t tss_chain_fits(
    int64_t n, int64_t rows, int64_t m, const double weight[n], int64_t free, double variance, double spacing,
    OPTIONAL const double unit_weight[n], const double form[rows][3], const double stations[n], double cost,
    double last);

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
    OUT double variances[k][3], WORK double work[4 * n + 60 * k * k + 600 * k + 400]);

/** Return the mean spacing of points and the shortest piece of a chain that goes on with them [m], [spacings]. */
ENTRY status tss_chain_scale(
    int64_t n, int64_t rows, const double points[n][3], const double form[rows][3], const double stations[n],
    OUT double *spacing, OUT double *shortest, WORK double work[n]);

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
    WORK double work[6 * n + 60 * k * k + 600 * k + 400]);

/** Return the covariance of r values of gradient [r, m], by the inverse of normal equations and of unit
noise.

`damping` is added to the diagonal of the matrix, scaled to 1. */
ENTRY void tss_propagated(
    int64_t m, int64_t r, const double matrix[m][m], const double gradient[r][m], double damping,
    OUT double covariance[r][r], WORK double work[m * m + r * m + m]);

/** Return what a joint in each piece would save at best, and at which part of it, and what slopes would save.

`saved` [k] in noise variances; `part` [k]: part of the piece before which the joint is; `by_slopes`: what
sloping curvature in every piece would save beyond chance [noise variances]. The steps of a staircase that
stands for a smooth route fit better with a slope; those of true pieces do not. */
ENTRY status tss_saved_by_parts(
    int64_t n, int64_t k, int64_t m, const double points[n][3], const double weight[n], int64_t free,
    double variance, double spacing, OPTIONAL const double unit[n][3], OPTIONAL const double unit_weight[n],
    const double form[k + 4][3], const uint8_t curved[k], const double stations[n], const double matrix[m][m],
    double cost, OUT double saved[k], OUT int64_t part[k], OUT double *by_slopes,
    WORK double work[4 * n + 500 * k * k + 2400 * k + 800]);

/* Memory of an entry, from which functions take parts; it is passed by value, so that they need not give it
   back. */
typedef struct {
    double *next;
} Work;
static inline double *take(Work *w, int64_t count) {
    double *part = w->next;
    w->next += count;
    return part;
}

/* Functions of q = θ²: sin θ/θ, (1 - cos θ)/θ², (θ - sin θ)/θ³, derivatives of the first two */
typedef struct {
    double a, b, c, da, db;
} ArcFunctions;
static inline ArcFunctions arc_functions(double q) {
    ArcFunctions f;
    if (q < 1e-2) {
        f.a = 1 + q * (-1. / 6 + q * (1. / 120 + q * (-1. / 5040 + q * (1. / 362880))));
        f.b = 0.5 + q * (-1. / 24 + q * (1. / 720 + q * (-1. / 40320 + q * (1. / 3628800))));
        f.c = 1. / 6 + q * (-1. / 120 + q * (1. / 5040 + q * (-1. / 362880 + q * (1. / 39916800))));
        f.da = -1. / 6 + q * (1. / 60 + q * (-1. / 1680 + q * (1. / 90720 + q * (-1. / 7983360))));
        f.db = -1. / 24 + q * (1. / 360 + q * (-1. / 13440 + q * (1. / 907200 + q * (-1. / 95800320))));
        return f;
    }
    double t = sqrt(q), cosine = cos(t);
    f.a = sin(t) / t, f.b = (1 - cosine) / q, f.c = (1 - f.a) / q;
    f.da = 0.5 * (cosine - f.a) / q, f.db = (0.5 * f.a - f.b) / q;
    return f;
}

/* Piece that holds arc length s; whatever lies beyond the ends belongs to the first or last piece. */
static inline int64_t piece_of(const Chain *chain, double s, int64_t guess) {
    while (guess + 1 < chain->k && s >= chain->form->piece[guess + 1].begin) guess++;
    while (guess > 0 && s < chain->form->piece[guess].begin) guess--;
    return guess;
}

/* arcs_moments.c */
ArcFunctions arc_frame(const double bend[2], double h, double local[4][3]);
void in_axes(double axes[3][3], const double local[3], double world[3]);
void joint_frames(const Chain *chain, double position[][3], double frame[][3][3]);
void position_by_curvature(ArcFunctions f, const double bend[2], double h, double moved[2][3]);
void turn_by_curvature(ArcFunctions f, const double bend[2], double h, double turned[2][3]);
double moments_of_points(
    const Data *data, Chain *chain, double position[][3], double frame[][3][3], double reach,
    double moments[][9][9], Work w);

/* arcs_equations.c */
void normal_equations(const Data *data, Chain *chain, double reach, Work w);
void slide_of_end(int64_t n, const Chain *chain, double slide[], Work w);

/* arcs_dense.c: matrices are m by m; `unit` [m] scales them to unit diagonal */
void factor(int64_t m, const double matrix[], double damping, double lower[], double unit[]);
void solve(int64_t m, const double lower[], const double unit[], const double right[], double x[]);
void propagated(
    int64_t m, const double lower[], const double unit[], int64_t r, const double gradient[], double result[],
    Work w);
void schur_complement(
    int64_t m, const double lower[], const double unit[], const double gradient[], int64_t d,
    const double cross[], const double own[], const double slope[], double left[], double rest[], Work w);

/* arcs_fit.c */
int64_t value_count(const Data *data);
double noise_variance(const Data *data, const Chain *chain);
double residual_mean_square(const Data *data, const Chain *chain);
double piece_length(const Data *data, const Chain *chain, int64_t j);
int64_t is_sized(int64_t n, int64_t k, int64_t m, const uint8_t curved[], int64_t free);
static inline int64_t first_joint_column(int64_t free) { return (free ? 2 : 3) + 2; }
Chain chain_of(
    int64_t k, int64_t m, const double form[][3], const uint8_t curved[], const double stations[],
    const double matrix[], double cost);
int64_t fit_pieces(const Data *data, Chain *chain, double goal, int64_t restart, Work w);
int64_t outlier_weights(const Data *data, const double square[], double last, double weight[], Work w);
int64_t chain_fits(const Data *data, const Chain *chain, double last);
Chain begun_chain(
    int64_t n, int64_t k, int64_t m, const double form[][3], const uint8_t curved[], const double stations[],
    double new_form[][3], double new_stations[], double matrix[], double square[], Work *w);
