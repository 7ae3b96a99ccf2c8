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
