/* Constant-curvature pieces of a fitted route: exact dynamic programming on its curvature vector; (27). */
#include "route.h"

#include <string.h>

void normals(const double tangent[3], double first[3], double second[3]) {
    int smallest = 0;
    for (int c = 1; c < 3; c++)
        if (fabs(tangent[c]) < fabs(tangent[smallest])) smallest = c;
    for (int c = 0; c < 3; c++) first[c] = (c == smallest ? 1.0 : 0.0) - tangent[smallest] * tangent[c];
    double length = sqrt(dot3(first, first));
    for (int c = 0; c < 3; c++) first[c] /= length;
    for (int c = 0; c < 3; c++) {
        int d = (c + 1) % 3, e = (c + 2) % 3;
        second[c] = tangent[d] * first[e] - tangent[e] * first[d];
    }
}

/** Two unit vectors normal to a unit tangent and to each other, right-handed with it. */
ENTRY void tss_normals(const double tangent[3], OUT double first[3], OUT double second[3]) { normals(tangent, first, second); }

/** Components of a normal vector field in a frame carried along the tangents without twist. */
ENTRY void tss_parallel_components(
    int64_t n, const double tangent[n][3], const double vector[n][3], OUT double parts[n][2]) {
    double first[3], second[3];
    if (n > 0) normals(tangent[0], first, second);
    for (int64_t i = 0; i < n; i++) {
        const double *here = tangent[i];
        if (i > 0) {
            const double *before = tangent[i - 1];
            double stripped = 1.0 + dot3(before, here) + 1e-12;
            double turned = dot3(first, here) / stripped, other = dot3(second, here) / stripped;
            for (int c = 0; c < 3; c++) {
                double middle = before[c] + here[c];
                first[c] -= turned * middle;
                second[c] -= other * middle;
            }
        }
        parts[i][0] = dot3(vector[i], first);
        parts[i][1] = dot3(vector[i], second);
    }
}

/* Sums of a sequence up to a cut, where a last run may begin, and the least cost up to there. */
typedef struct { double *mass, *first, *second, *square, *cost; } Cuts;

static Cuts cuts_in(double *room, int64_t n) { return (Cuts){room, room + n, room + 2 * n, room + 3 * n, room + 4 * n}; }

static void copy_cut(Cuts to, int64_t k, Cuts from, int64_t i) {
    to.mass[k] = from.mass[i], to.first[k] = from.first[i], to.second[k] = from.second[i];
    to.square[k] = from.square[i], to.cost[k] = from.cost[i];
}

/** Cut a sequence into runs of constant value, exactly least in squared error plus `penalty` a run; (27).

Parameters: vectors and their precisions. Returns how many runs, and the indices at which they begin, with n at
the end. */
ENTRY int64_t tss_best_partition(
    int64_t n, const double value[n][2], const double weight[n], double penalty, OUT int64_t joints[n + 1],
    WORK double work[13][n + 1]) {
    Cuts at = cuts_in(work[0], n + 1), alive = cuts_in(work[5], n + 1); /* alive: where a last run may still begin */
    double *so_far = work[10];
    int64_t *begin = (int64_t *)work[11], *index = (int64_t *)work[12], left = 1, runs = 0;
    at.mass[0] = at.first[0] = at.second[0] = at.square[0] = 0.0;
    for (int64_t i = 0; i < n; i++) {
        double x = value[i][0], y = value[i][1];
        at.mass[i + 1] = at.mass[i] + weight[i];
        at.first[i + 1] = at.first[i] + weight[i] * x;
        at.second[i + 1] = at.second[i] + weight[i] * y;
        at.square[i + 1] = at.square[i] + weight[i] * (x * x + y * y);
    }
    at.cost[0] = -penalty, begin[0] = index[0] = 0;
    copy_cut(alive, 0, at, 0);
    for (int64_t j = 1; j <= n; j++) {
        double mass = at.mass[j], first = at.first[j], second = at.second[j], square = at.square[j], best = INFINITY;
        for (int64_t k = 0; k < left; k++) {
            double a = first - alive.first[k], b = second - alive.second[k];
            double inside = square - alive.square[k] - (a * a + b * b) / (mass - alive.mass[k]);
            so_far[k] = alive.cost[k] + most(inside, 0.0); /* docs/model.md (27) */
        }
        begin[j] = j - 1;
        for (int64_t k = 0; k < left; k++)
            if (so_far[k] + penalty < best) best = so_far[k] + penalty, begin[j] = index[k];
        at.cost[j] = best;
        int64_t kept = 0; /* a begin that is now behind a cut at j stays behind it for good */
        for (int64_t k = 0; k < left; k++)
            if (so_far[k] <= best) {
                if (kept < k) copy_cut(alive, kept, alive, k), index[kept] = index[k];
                kept++;
            }
        copy_cut(alive, kept, at, j);
        index[kept] = j, left = kept + 1;
    }
    for (int64_t j = n; j > 0; j = begin[j]) runs++;
    joints[runs] = n;
    for (int64_t k = runs; k > 0; k--) joints[k - 1] = begin[joints[k]];
    for (int64_t k = runs + 1; k <= n; k++) joints[k] = n;
    return runs;
}

/* Nodes at which pieces of constant curvature meet, by the least cost; docs/model.md (27). */
int64_t pieces_of_curvature(
    int64_t n, const double s[], const double tangent[][3], const double bend[][3], const double covariance[][10],
    double freedom, double points, int64_t joints[], double *work) {
    for (int64_t k = 0; k <= n; k++) joints[k] = 0;
    if (n < 2) return 0;
    int64_t cells = n - 1 < STAIRCASE.most_cells ? n - 1 : STAIRCASE.most_cells;
    double(*parts)[2] = (double(*)[2])work, (*mean)[2] = parts + n, *weight = work + 4 * n;
    int64_t *nodes = (int64_t *)(weight + n);
    double *room = weight + 2 * n + 1, sharpest = 0.0;
    for (int64_t j = 0; j <= cells; j++) nodes[j] = (int64_t)rint((double)j * ((double)(n - 1) / (double)cells));
    tss_parallel_components(n, tangent, bend, parts);
    for (int64_t i = 0; i < n; i++) sharpest = most(sharpest, squared(parts[i][0]) + squared(parts[i][1]));
    for (int64_t j = 0; j < cells; j++) {
        double length = s[nodes[j + 1]] - s[nodes[j]], variance = 0.0;
        mean[j][0] = mean[j][1] = 0.0;
        for (int64_t i = nodes[j]; i < nodes[j + 1]; i++) {
            double half = 0.5 * (s[i + 1] - s[i]);
            mean[j][0] += half * (parts[i][0] + parts[i + 1][0]) / length;
            mean[j][1] += half * (parts[i][1] + parts[i + 1][1]) / length;
            variance += half * (covariance[i][7] + covariance[i + 1][7]);
        }
        variance += squared(STAIRCASE.least_step) * sharpest * length;
        /* the errors are correlated: the whole route is worth as many values as the fit has parameters */
        weight[j] = freedom * length * length / (s[n - 1] * most(variance, 1e-300));
    }
    double penalty = CHAIN_PARAMETERS.joint * log(most(points, 2.0));
    int64_t pieces = tss_best_partition(cells, mean, weight, penalty, joints, (double(*)[cells + 1])room);
    for (int64_t k = 0; k <= pieces; k++) joints[k] = nodes[joints[k]];
    for (int64_t k = pieces + 1; k <= n; k++) joints[k] = n - 1;
    return pieces;
}

/* Integrals of phi between two nodes with what rises from 0 to 1 there, and with what falls; phi is linear between
   nodes. */
static void with_ramps(const double s[], const double phi[], int64_t from, int64_t to, double *rising, double *falling) {
    double rise = 0.0, whole = 0.0;
    for (int64_t i = from; i < to; i++) {
        double h = s[i + 1] - s[i], u = (s[i] - s[from]) / (s[to] - s[from]), v = (s[i + 1] - s[from]) / (s[to] - s[from]);
        rise += h / 6.0 * (2.0 * (u * phi[i] + v * phi[i + 1]) + u * phi[i + 1] + v * phi[i]);
        whole += 0.5 * h * (phi[i] + phi[i + 1]);
    }
    *rising = rise, *falling = whole - rise;
}

/* Angles of the pieces whose phi(s) is nearest to that of the route, with its ends; none is negative. Work holds twice
   as many numbers as there are joints; docs/model.md (340). */
void angles_of_pieces(
    const double s[], const double phi[], int64_t count, const int64_t joints[], double angle[], double *work) {
    double *ratio = work, *at = work + count + 1, rising, falling, next;
    ratio[0] = 0.0, at[0] = phi[joints[0]], at[count] = phi[joints[count]];
    with_ramps(s, phi, joints[0], joints[1], &rising, &falling);
    for (int64_t j = 1; j < count; j++) {
        double before = (s[joints[j]] - s[joints[j - 1]]) / 6.0, after = (s[joints[j + 1]] - s[joints[j]]) / 6.0;
        with_ramps(s, phi, joints[j], joints[j + 1], &next, &falling);
        double pivot = 2.0 * (before + after) - before * ratio[j - 1];
        ratio[j] = after / pivot;
        at[j] = (rising + falling - before * at[j - 1]) / pivot;
        rising = next;
    }
    for (int64_t j = count - 1; j > 0; j--) at[j] -= ratio[j] * at[j + 1];
    for (int64_t j = 1; j < count; j++) at[j] = least(most(at[j], at[j - 1]), at[count]);
    for (int64_t j = 0; j < count; j++) angle[j] = at[j + 1] - at[j];
}

/** Nodes at which pieces of constant curvature meet, with both ends; (27). Returns how many pieces. */
ENTRY int64_t tss_joints(
    int64_t n, const double s[n], const double tangent[n][3], const double bend[n][3],
    const double covariance[n][10], double freedom, int64_t points, OUT int64_t joints[n + 1],
    WORK double work[20][n + 1]) {
    return pieces_of_curvature(n, s, tangent, bend, covariance, freedom, (double)points, joints, work[0]);
}

/** Sums of a fit: length of all pieces, and the standard error of their angle; finite or not, by the sum of every
number; how many points have no weight, and the path through the others [m]. Parameters: length [m] and angle [rad] of
each piece, their covariance, and the points with their weights. */
ENTRY void tss_totals(
    int64_t k, const double length[k], const double angle[k], int64_t values, const double covariance[values][values],
    int64_t n, const double points[n][3], const double weight[n], OUT double *total_length,
    OUT double *total_angle_se, OUT double *shortest, OUT double *all, OUT int64_t *ignored, OUT double *path) {
    double lengths = 0.0, angles = 0.0, variance = 0.0, sum = 0.0;
    *shortest = INFINITY;
    for (int64_t j = 0; j < k; j++) {
        lengths += length[j], angles += angle[j];
        *shortest = least(length[j], *shortest);
    }
    for (int64_t j = 0; j < values; j++)
        for (int64_t i = 0; i < values; i++) {
            sum += covariance[j][i];
            if (j >= values / 2 && i >= values / 2) variance += covariance[j][i];
        }
    *total_length = lengths, *total_angle_se = sqrt(most(variance, 0.0));
    *all = lengths + angles + sum;
    tss_path_length(n, points, weight, ignored, path);
}
