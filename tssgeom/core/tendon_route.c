/* What a sensed route makes of the tendon: whether it moved, where bars and contacts lie on it, hidden bends.
 */
#include "tendon_bars.h"

#include <string.h>

enum {
    SHARES = 8
}; /* even shares of the length at which the curve angles of two routes are compared; chosen */

double total(int64_t n, const double values[]) {
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++) sum += values[i];
    return sum;
}

/* Sum of products in four sums side by side, which are independent of each other. */
double row_dot(int64_t n, const double a[], const double b[]) {
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int64_t lane = 0; lane < 4; lane++) sum[lane] += a[i + lane] * b[i + lane];
    for (; i < n; i++) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* aᵀ·M·a for a block of a matrix whose rows are `width` long. */
double quadratic_form(int64_t n, const double a[], const double *matrix, int64_t width) {
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++)
        if (a[i] != 0.0) sum += a[i] * row_dot(n, matrix + i * width, a);
    return sum;
}

/* A route at even shares of its length. */
typedef struct {
    double length, length_variance;
    double phi[SHARES], variance[SHARES];
} route_shares;

/* Accumulated curve angle at even shares of the length, and its variance; docs/model.md (80).

   At the share σ, in piece i, the derivative is κ(σ − u) by the lengths and u by the angles, where u is 1
   before that piece, the part passed in it, and 0 behind. So the variance follows from sums over
   leading blocks. */
static void at_shares(
    int64_t p, const double length[], const double angle[], const double *covariance, route_shares *result) {
    double whole = total(p, length), begin = 0.0, phi = 0.0;
    double lengths = 0.0, mixed = 0.0, angles = 0.0; /* over the leading blocks before piece i */
    double row_lengths = 0.0, row_mixed = 0.0; /* over all of the rows before piece i */
    double by_length[SHARES], all_lengths = 0.0;
    int share = 0;
    for (int64_t i = 0; i < p; i++) {
        const double *of_length = covariance + i * 2 * p, *of_angle = covariance + (p + i) * 2 * p;
        double before_l = 0.0, before_la = 0.0, before_al = 0.0, before_a = 0.0, behind_l = 0.0,
               behind_al = 0.0;
        for (int64_t j = 0; j < i; j++) {
            before_l += of_length[j], before_la += of_length[p + j];
            before_al += of_angle[j], before_a += of_angle[p + j];
        }
        for (int64_t j = i; j < p; j++) behind_l += of_length[j], behind_al += of_angle[j];
        double own_l = of_length[i], own_m = of_angle[i], own_a = of_angle[p + i];
        double row_l = before_l + behind_l, row_al = before_al + behind_al;
        for (; share < SHARES; share++) {
            double sigma = (share + 1) / (double)SHARES;
            if (i < p - 1 && begin + length[i] < sigma * whole) break;
            double u = least(1.0, (sigma * whole - begin) / length[i]), kappa = angle[i] / length[i];
            double uu_lengths = lengths + 2.0 * u * before_l + u * u * own_l;
            double uu_mixed = mixed + u * (before_la + before_al) + u * u * own_m;
            double uu_angles = angles + 2.0 * u * before_a + u * u * own_a;
            double one_u_lengths = row_lengths + u * row_l, one_u_mixed = row_mixed + u * row_al;
            result->phi[share] = phi + u * angle[i];
            by_length[share] = squared(kappa * sigma);
            result->variance[share] = kappa * kappa * (uu_lengths - 2.0 * sigma * one_u_lengths)
                                      + 2.0 * kappa * (sigma * one_u_mixed - uu_mixed) + uu_angles;
        }
        lengths += 2.0 * before_l + own_l, mixed += before_la + before_al + own_m,
            angles += 2.0 * before_a + own_a;
        row_lengths += row_l, row_mixed += row_al, all_lengths += row_l;
        begin += length[i], phi += angle[i];
    }
    for (int k = 0; k < share; k++) result->variance[k] += by_length[k] * all_lengths;
    result->length = whole, result->length_variance = all_lengths;
}

/** Return whether two sensed routes differ by no more than their errors; docs/model.md (80). */
ENTRY int64_t tss_is_unmoved(
    int64_t p, const double length[p], const double angle[p], const double covariance[2 * p][2 * p],
    int64_t q, const double length_now[q], const double angle_now[q],
    const double covariance_now[2 * q][2 * q]) {
    if (p == 0 || q == 0) return 0;
    route_shares before, now;
    at_shares(p, length, angle, covariance[0], &before);
    at_shares(q, length_now, angle_now, covariance_now[0], &now);
    double sd = sqrt(most(0.0, before.length_variance + now.length_variance));
    double room = CHANCE.clear * sd + ROUNDING.relative * before.length;
    if (fabs(now.length - before.length) > room) return 0;
    for (int share = 0; share < SHARES; share++) {
        sd = sqrt(most(0.0, before.variance[share] + now.variance[share]));
        if (fabs(now.phi[share] - before.phi[share]) > CHANCE.clear * sd + ROUNDING.relative) return 0;
    }
    return 1;
}

contact_grid grid_of(int64_t k, double *work) {
    return (contact_grid){work, work + k, work + 2 * k, work + 3 * k};
}

/* Bars and contacts on a route: lengths, and angles from mean to mean; docs/model.md (41). */
void discretise(
    int64_t k, const double edge[], int64_t p, const double length[], const double angle[],
    contact_grid grid) {
    double whole = total(p, length);
    int64_t piece = 0;
    double begin = 0.0, phi = 0.0; /* where the piece begins, and φ there */
    double s = 0.0, phi_here = 0.0, phi_before = 0.0, middle_before = 0.0;
    for (int64_t j = 0; j < k - 1; j++) {
        double start = s, end = j == k - 2 ? whole : edge[j + 1] * whole, moment = 0.0;
        for (int inside = 1; inside;) {
            double stop = begin + length[piece];
            if (piece == p - 1 || stop > end) stop = end;
            double phi_stop = phi + angle[piece] * (stop - begin) / length[piece];
            moment += 0.5 * (phi_here + phi_stop) * (stop - s);
            s = stop, phi_here = phi_stop;
            inside = s < end && piece < p - 1;
            if (inside) begin += length[piece], phi += angle[piece], piece++;
        }
        grid.length[j] = end - start;
        grid.mean_angle[j] = moment / grid.length[j];
        grid.angle[j] = most(0.0, grid.mean_angle[j] - phi_before);
        grid.span[j] = 0.5 * (start + end) - middle_before;
        phi_before = grid.mean_angle[j], middle_before = 0.5 * (start + end);
    }
    grid.angle[k - 1] = most(0.0, phi_here - phi_before);
    grid.span[k - 1] = whole - middle_before;
}

/** Return what a route makes of bars and contacts; docs/model.md (41).

`bars` [2, k - 1] is the length [m] of each bar in the sheath and the mean φ over it [rad]; `contacts` [2, k]
is the curve angle of each contact [rad] and the length of sheath that belongs to it [m]. */
ENTRY void tss_discretise(
    int64_t k, const double edge[k], int64_t p, const double length[p], const double angle[p],
    OUT double bars[2][k - 1], OUT double contacts[2][k]) {
    if (k < 2 || p == 0) return;
    discretise(k, edge, p, length, angle, (contact_grid){bars[0], bars[1], contacts[0], contacts[1]});
}

/* Add one bend to p pieces; returns how many there are then, two more at most. */
static int64_t add_bend(
    int64_t p, const double length[], const double angle[], const double bend[3], double new_length[],
    double new_angle[]) {
    double middle = bend[0], extra = bend[1], width = bend[2], whole = total(p, length);
    double start = within(middle - 0.5 * width, 0.0, whole), stop = within(middle + 0.5 * width, 0.0, whole);
    if (stop - start < 1e-9 * whole) start = most(0.0, start - width), stop = least(whole, stop + width);
    double end = 0.0, phi = 0.0, last_knot = 0.0, last_phi = 0.0;
    int64_t count = 0;
    for (int64_t i = 0; i < p; i++) {
        double begin = end, phi_begin = phi;
        end += length[i], phi += angle[i];
        double knots[3] = {start, stop, end};
        for (int each = 0; each < 3; each++) {
            double knot = knots[each];
            int inside = begin < knot && knot < end && knot > last_knot;
            if (each < 2 && (!inside || count >= i + 2)) continue;
            double here = each == 2 ? phi : phi_begin + (knot - begin) * (angle[i] / (end - begin));
            here += extra * within((knot - start) / (stop - start), 0.0, 1.0); /* docs/model.md (60) */
            new_length[count] = knot - last_knot, new_angle[count++] = here - last_phi;
            last_knot = knot, last_phi = here;
        }
    }
    return count;
}

/* Add bends one after the other; the result is in `pieces`, length and angle. */
int64_t add_bends(
    int64_t p, const double length[], const double angle[], int64_t m, const double bends[][3],
    double *pieces[2], double *spare[2]) {
    for (int64_t i = 0; i < p; i++) pieces[0][i] = length[i], pieces[1][i] = angle[i];
    for (int64_t each = 0; each < m; each++) {
        for (int64_t i = 0; i < p; i++) spare[0][i] = pieces[0][i], spare[1][i] = pieces[1][i];
        p = add_bend(p, spare[0], spare[1], bends[each], pieces[0], pieces[1]);
    }
    return p;
}

/** Return the number of pieces of a route with hidden bends added, and the pieces; docs/model.md (60).

`bends` [m, 3] holds middle [m], angle [rad] and width [m] of each; `pieces` is lengths, then angles. */
ENTRY int64_t tss_add_bends(
    int64_t p, const double length[p], const double angle[p], int64_t m, const double bends[m][3],
    OUT double pieces[2][p + 2 * m], WORK double work[2][p + 2 * m]) {
    memset(pieces, 0, (size_t)(2 * (p + 2 * m)) * sizeof(double));
    return add_bends(
        p, length, angle, m, bends, (double *[2]){pieces[0], pieces[1]}, (double *[2]){work[0], work[1]});
}
