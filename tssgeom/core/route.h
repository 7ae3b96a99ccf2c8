/* Sensed points before a fit, and what follows from a fitted route: curvature, angle and pieces. SI units. */
#pragma once
#include "core.h"

void normals(const double tangent[3], double first[3], double second[3]);
int64_t pieces_of_curvature(
    int64_t n, const double s[], const double tangent[][3], const double bend[][3], const double covariance[][10],
    double freedom, double points, int64_t joints[], double *work);
void angles_of_pieces(
    const double s[], const double phi[], int64_t count, const int64_t joints[], double angle[], double *work);
double outlier_limit(int64_t count, double variance);
double residual_variance(double known, double robust, double spacing);

/** Two unit vectors normal to a unit tangent and to each other, right-handed with it. */
ENTRY void tss_normals(const double tangent[3], OUT double first[3], OUT double second[3]);

/** Components of a normal vector field in a frame carried along the tangents without twist. */
ENTRY void tss_parallel_components(
    int64_t n, const double tangent[n][3], const double vector[n][3], OUT double parts[n][2]);

/** Cut a sequence into runs of constant value, exactly least in squared error plus `penalty` a run; (27).

Parameters: vectors and their precisions. Returns how many runs, and the indices at which they begin, with n at
the end. */
ENTRY int64_t tss_best_partition(
    int64_t n, const double value[n][2], const double weight[n], double penalty, OUT int64_t joints[n + 1],
    WORK double work[13][n + 1]);

/** Nodes at which pieces of constant curvature meet, with both ends; (27). Returns how many pieces. */
ENTRY int64_t tss_joints(
    int64_t n, const double s[n], const double tangent[n][3], const double bend[n][3],
    const double covariance[n][10], double freedom, int64_t points, OUT int64_t joints[n + 1],
    WORK double work[20][n + 1]);

/** Curvature and accumulated angle of a fitted route, and its pieces, in one pass; (23) to (27), (340).

Parameters: arc length, tangents and curvature vectors of the nodes; covariance of the state of (20) and gains;
the effective number of parameters; noise [m]; whether stations are known; the relative error of all angles that
neighbours share; the share of the parameters that directions determine; the nodes of the points [m]; and the
nodes at which the pieces meet. Returns κ [1/m], φ [rad] and their standard errors on the nodes; length [m] and
angle [rad] of each piece; and the covariance of all lengths followed by all angles. */
ENTRY status tss_curvature_profile(
    int64_t n, const double s[n], const double tangent[n][3], const double bend[n][3],
    const double covariance[n][10], int64_t gains, const double gain[gains][4][4], double freedom, double noise,
    int64_t known, double shared_angle_error, double tangent_share, int64_t points,
    const double station[points], int64_t joint_count, const int64_t joints[joint_count],
    OUT double profile[4][n], OUT double pieces[2][joint_count - 1],
    OUT double piece_covariance[2 * joint_count - 2][2 * joint_count - 2], WORK double work[41][n + joint_count]);

/** Whether points may be used as they are: finite, apart, of a usual extent, in order, none an outlier.

Returns 1 if so, 0 where they are not plain, and -1 where only the quick bounds on order and outliers fail. */
ENTRY int64_t tss_clearly_sound(int64_t n, const double points[n][3], WORK double work[3][n]);

/** Points between which straight lines pass all others within a distance `off` [m], both ends among them.

Returns how many, and marks them; where there are more than `highest`, it stops at one more, so that the work is
linear in the points. */
ENTRY int64_t tss_corners(
    int64_t n, const double points[n][3], double off, int64_t highest, OUT uint8_t kept[n], WORK double work[2 * n]);

/** The greatest outlier among eight points or more of a median spacing [m], the ends first; -1 for none. */
ENTRY int64_t tss_worst_outlier(int64_t n, const double points[n][3], double spacing, WORK double work[n]);

/** Sums of a fit: length and angle of all pieces, and the standard error of that angle; finite or not, by the sum
of every number. Parameters: length [m] and angle [rad] of each piece, and their covariance. */
ENTRY void tss_totals(
    int64_t k, const double length[k], const double angle[k], int64_t values, const double covariance[values][values],
    OUT double *total_length, OUT double *total_angle, OUT double *total_angle_se, OUT double *shortest,
    OUT double *all);

/** How many points have no weight, and the length of the path through the others [m]. */
ENTRY void tss_path_length(
    int64_t n, const double points[n][3], const double weight[n], OUT int64_t *ignored, OUT double *path);

/** Median distance of neighbours [m], or the chord of all over their number where that is longer. */
ENTRY double tss_mean_spacing(int64_t n, const double points[n][3], WORK double work[n]);

/** The spacing that bounds the pieces of a route of a length [m] from below [m].

It is the mean, except for points that crowd in a part of the route: a bend may lie among them. */
ENTRY double tss_spacing_of_pieces(int64_t n, const double points[n][3], double length, WORK double work[n]);

/** Path from point to point [m]; chords over `every` points over their stations [1]; and whether stations are
finite and none lies before the last. */
ENTRY void tss_against_stations(
    int64_t n, const double points[n][3], const double stations[n], int64_t every, OUT double *path,
    OUT double *over, OUT int64_t *increasing);
