/* Tension over the curve angle as a list of corners: one step of it, and what it means on a route. */
#include "tendon_bars.h"

#include <string.h>

/** Return the corner list after a step to the tension exp(`drive`), a play operator; docs/model.md (3), (4).

The list `angle` [rad], `log_tension` [ln N] becomes max(u, ln T − μφ) on a pull and min(u, ln T + μφ) on a
release. Returns how many of `corners` (φ, ln T) there are, below 0 on a release, 0 where nothing moves. */
ENTRY int64_t tss_step_corners(
    int64_t c, const double angle[c], const double log_tension[c], double drive, double friction,
    OUT double corners[2][c + 1]) {
    memset(corners, 0, (size_t)(2 * (c + 1)) * sizeof(double));
    if (c == 0) return 0;
    double change = drive - log_tension[0];
    if (!(fabs(change) > ROUNDING.exact)) return 0;
    double way = change > 0.0 ? 1.0 : -1.0;
    double before = way * change; /* excess of the front over the old profile [1] */
    int64_t wiped = 1;
    double meeting = NAN; /* φ*, where the front meets the old profile */
    for (; wiped < c; wiped++) {
        double here = way * (drive - log_tension[wiped]) - friction * angle[wiped];
        if (here <= -ROUNDING.exact) {
            double piece = angle[wiped] - angle[wiped - 1];
            meeting = angle[wiped - 1] + piece * before / (before - here); /* docs/model.md (4) */
            break;
        }
        before = most(0.0, here);
    }
    if (wiped == c) meeting = angle[c - 1] + before / friction; /* docs/model.md (4) */
    corners[1][0] = drive;
    corners[0][1] = meeting, corners[1][1] = drive - way * friction * meeting; /* docs/model.md (3) */
    for (int64_t i = wiped; i < c; i++)
        corners[0][2 + i - wiped] = angle[i], corners[1][2 + i - wiped] = log_tension[i];
    if (wiped == c)
        corners[1][1] = log_tension[c - 1]; /* the constant rest keeps its tension to the last digit */
    return (int64_t)way * (2 + c - wiped);
}

/* Mean of exp(−xτ) over 0 ≤ τ ≤ 1; docs/model.md (8). */
static double mean_decay(double x) { return x == 0.0 ? 1.0 : -expm1(-x) / x; }

/* Mean of τ·exp(−xτ) over 0 ≤ τ ≤ 1; docs/model.md (12). */
static double mean_decay_moment(double x) {
    if (fabs(x) < 0.01) /* from there on the next term of the series, x⁶/5760, is no longer rounding */
        return 1.0 / 2 - x * (1.0 / 3 - x * (1.0 / 8 - x * (1.0 / 30 - x * (1.0 / 144 - x / 840))));
    return (mean_decay(x) - exp(-x)) / x;
}

/* A profile of corners, and ln T and its slope over φ at the distal end of a route. */
typedef struct {
    int64_t count;
    const double *angle, *log_tension;
    double log_tension_out, slope_out;
} profile;

/* Means over the arc length of each piece [3, p]: of T [N]; of dT/dφ, which is the derivative of the first by
   the angle of any earlier piece [N/rad]; of t·dT/dφ with t from 0 to 1 along the piece, its derivative by
   the piece's own angle [N/rad]. */
static void means_on_pieces(int64_t p, const double piece_angle[], profile *along, double *means) {
    const double *angle = along->angle, *log_tension = along->log_tension;
    int64_t segment = 0, last = along->count - 1;
    double at = 0.0, here = log_tension[0], slope = 0.0;
    for (int64_t piece = 0; piece < p; piece++) {
        double start = at, end = at + piece_angle[piece], sum[3] = {0.0, 0.0, 0.0};
        for (int64_t run = 0; run <= last + 1; run++) {
            while (segment < last && angle[segment + 1] <= at) segment++;
            double stop = segment == last ? end : least(angle[segment + 1], end), before = 0.0, share = 1.0;
            if (end > start) before = (at - start) / (end - start), share = (stop - at) / (end - start);
            slope = segment == last ? 0.0
                                    : (log_tension[segment + 1] - log_tension[segment])
                                          / (angle[segment + 1] - angle[segment]);
            here = log_tension[segment] + slope * (at - angle[segment]);
            double fall =
                fabs(slope) * (stop - at); /* from where tension is greater: it may start from none */
            double greatest = share * exp(here + most(0.0, slope * (stop - at)));
            double level = greatest * mean_decay(fall), moment = greatest * mean_decay_moment(fall);
            if (slope > 0.0) moment = level - moment;
            sum[0] += level; /* docs/model.md (9) */
            sum[1] += slope * level;
            sum[2] += slope * (before * level + share * moment); /* docs/model.md (12) */
            here += slope * (stop - at);
            at = stop;
            if (!(at < end)) break;
        }
        for (int row = 0; row < 3; row++) means[row * p + piece] = sum[row];
    }
    along->log_tension_out = here, along->slope_out = slope;
}

static double bounded_exp(double exponent) { return exp(least(PROFILE.most_log_tension, exponent)); }

/* Tension, elongation, dead zone and front of a profile, with standard errors; docs/model.md (5)-(14). */
static void transmit(
    profile along, int64_t p, const double length[], const double piece_angle[], const double *covariance,
    double compliance, double pretension, double friction, double way, double *means, double *gradient,
    double ends[7]) {
    means_on_pieces(p, piece_angle, &along, means);
    double elongation = 0.0, turned = 0.0, angle_variance = 0.0;
    double later = 0.0; /* what the later pieces gain for an angle added anywhere before them */
    for (int64_t i = p - 1; i >= 0; i--) {
        gradient[i] = compliance * (means[i] - pretension); /* docs/model.md (10) */
        gradient[p + i] = compliance * (length[i] * means[2 * p + i] + later); /* docs/model.md (11) */
        later += length[i] * means[p + i];
    }
    for (int64_t i = 0; i < p; i++) {
        elongation += compliance * length[i] * (means[i] - pretension); /* docs/model.md (7), (9) */
        turned += piece_angle[i];
        const double *row = covariance + (p + i) * 2 * p + p;
        double sum[4] = {0.0, 0.0, 0.0, 0.0};
        for (int64_t j = 0; j < p; j++) sum[j % 4] += row[j];
        angle_variance += (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
    double variance = most(0.0, quadratic_form(2 * p, gradient, covariance, 2 * p)); /* docs/model.md (13) */
    double log_tension_in = along.log_tension[0], log_tension_out = along.log_tension_out;
    double needed = log_tension_out + way * (friction * turned); /* docs/model.md (6) */
    double width = way * (needed - log_tension_in) <= ROUNDING.exact
                       ? 0.0
                       : fabs(bounded_exp(needed) - bounded_exp(log_tension_in));
    double front = turned; /* where the run that starts at the proximal end with the slope of sliding ends */
    if (along.count > 1) {
        double off = log_tension_in - along.log_tension[1] - way * friction * along.angle[1];
        front = least(turned, fabs(off) <= PROFILE.slides ? along.angle[1] : 0.0); /* docs/model.md (4) */
    }
    double tension_out = exp(log_tension_out); /* docs/model.md (5) */
    ends[0] = tension_out;
    ends[1] = tension_out * fabs(along.slope_out) * sqrt(most(0.0, angle_variance)); /* docs/model.md (14) */
    ends[2] = elongation, ends[3] = sqrt(variance), ends[4] = width, ends[5] = front,
    ends[6] = along.slope_out;
}

/** Return what a corner list [c] means on a route; docs/model.md (5)-(14).

`way` is the direction index ζ. Returns `ends`: T_out and its standard error [N], elongation and its standard
error [m], width of the dead zone [N], curve angle of the slip front [rad], d ln T_out over any angle [1/rad];
and the derivatives of the elongation by each length, then by each angle [1], [m/rad]. */
ENTRY void tss_transmit_corners(
    int64_t c, const double angle[c], const double log_tension[c], int64_t p, const double length[p],
    const double piece_angle[p], const double covariance[2 * p][2 * p], double compliance, double pretension,
    double friction, int64_t way, OUT double ends[7], OUT double gradient[2 * p], WORK double means[3][p]) {
    if (c == 0 || p == 0) return;
    profile along = {c, angle, log_tension, 0.0, 0.0};
    transmit(
        along, p, length, piece_angle, covariance[0], compliance, pretension, friction, (double)way, means[0],
        gradient, ends);
}

/* Corners through the means of the bars and both ends, as few as are needed; docs/model.md (49).

   Of points at one angle the last is kept, of points on one line its ends. Returns their number. */
static int64_t through_bars(
    int64_t k, const double edge[], const double tension[], int64_t p, const double length[],
    const double piece_angle[], double *angle, double *log_tension, double *work) {
    contact_grid grid = grid_of(k, work);
    double *phi = work + 4 * k, *u = phi + k + 1;
    discretise(k, edge, p, length, piece_angle, grid);
    for (int64_t j = 1; j < k; j++) phi[j] = grid.mean_angle[j - 1];
    /* rounding shall not leave the distal end beyond the last corner */
    phi[0] = 0.0, phi[k] = total(p, piece_angle) * (1.0 + 0.1 * ROUNDING.exact);
    for (int64_t j = 0; j <= k; j++) u[j] = tension[j] > 0.0 ? log(tension[j]) : PROFILE.slack;
    int64_t count = 1, last = 0;
    angle[0] = phi[0], log_tension[0] = u[0];
    for (int64_t j = 1; j <= k; j++) {
        int keep = phi[j] > phi[last];
        if (keep && j < k) {
            /* of a straight end only the last is kept: it has the slope of the bends before */
            keep = phi[j + 1] - phi[j] > ROUNDING.exact * phi[k];
            double here = (u[j] - u[last]) / (phi[j] - phi[last]);
            double bend = (u[j + 1] - u[j]) / (phi[j + 1] - phi[j]) - here;
            keep = keep && fabs(bend) * (phi[j + 1] - phi[last]) > 1e3 * ROUNDING.exact;
        }
        if (keep) angle[count] = phi[j], log_tension[count++] = u[j], last = j;
    }
    return count;
}

/** Return how many corners (φ, ln T) go through the means of the bars and both ends, and the corners. */
ENTRY int64_t tss_corners_of_bars(
    int64_t k, const double edge[k], const double tension[k + 1], int64_t p, const double length[p],
    const double piece_angle[p], OUT double corners[2][k + 1], WORK double work[6][k + 1]) {
    if (k < 2 || p == 0) return 0;
    return through_bars(k, edge, tension, p, length, piece_angle, corners[0], corners[1], work[0]);
}

/** Return what bars without effects mean on a route, as `transmit_corners`; docs/model.md (49). */
ENTRY void tss_transmit_bars(
    int64_t k, const double edge[k], const double memory[9 * (k + 1) + 7], int64_t p, const double length[p],
    const double piece_angle[p], const double covariance[2 * p][2 * p], double compliance, double pretension,
    double friction, int64_t way, OUT double ends[7], WORK double means[5][p], WORK double work[8][k + 1]) {
    if (k < 2 || p == 0) return;
    const double *tension = memory + MEMORY.tension * (k + 1);
    profile along = {0, work[6], work[7], 0.0, 0.0};
    along.count = through_bars(k, edge, tension, p, length, piece_angle, work[6], work[7], work[0]);
    transmit(
        along, p, length, piece_angle, covariance[0], compliance, pretension, friction, (double)way, means[0],
        means[3], ends);
}
