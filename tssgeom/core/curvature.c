/* Curvature and accumulated angle of a fitted route with their standard errors; docs/model.md (23) to (26). */
#include "lanes.h"
#include "route.h"

#include <string.h>

static const double SINGULAR = 1e-13; /* of a variance: rounding in a factor of a covariance */

/* Factor on variances for a prior that was itself estimated from few parameters; (26). */
static double unknown_prior(double freedom) { return 1.0 + squared(ANGLE_ERRORS.few_parameters / freedom); }

/* Part of the posterior variance of the curvature that is noise; (24), (93). */
static double noise_share(double freedom, double tangent_share) {
    double low = 3.0 + tangent_share;
    return (low + (8.0 - low) * squared(least(3.0 / freedom, 1.0))) / 8.0;
}

/* Magnitude of the curvature vector less what noise adds to its square (25): well above the noise only the
   component across the bend lengthens the vector, near zero both do. */
static double without_noise(double square, double noise) {
    double components = 1.0 + 2.0 * noise / (square + 2.0 * noise + 1e-300);
    return sqrt(most(square - components * noise, 0.0));
}

/* Square of the change of the curvature vector across the tangent. */
static double rate_across(const double before[3], const double here[3], const double tangent[3]) {
    double change[3] = {here[0] - before[0], here[1] - before[1], here[2] - before[2]};
    double along = dot3(change, tangent);
    return most(dot3(change, change) - along * along, 0.0);
}

/* What the turn from point to point changes by, times its fourth power, summed [rad⁵]. */
static double uneven_turns(int64_t n, const double s[], const double phi[], int64_t points, const double station[]) {
    double total = 0.0, before = -1.0, reached = 0.0;
    for (int64_t i = 1, k = 0; i < points; i++) {
        while (k < n - 1 && s[k] < station[i]) k++;
        double turn = phi[k] - reached;
        reached = phi[k];
        if (before >= 0.0) total += fabs(turn - before) * squared(squared(most(turn, before)));
        before = turn;
    }
    return total;
}

static int64_t first_at(int64_t n, const double s[], double value) {
    int64_t low = 0, high = n;
    while (low < high) {
        int64_t middle = low + (high - low) / 2;
        if (s[middle] < value) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* Where points are missing, go halfway from the spline's angle to the least that the ends need (26): what lies in a
   wide interval is a guess, and a smooth prior swings; anything between the two is as likely. */
static void bridge(
    int64_t n, const double s[], const double tangent[][3], int64_t points, const double station[], double kappa[],
    double phi[], double variance[]) {
    double longest = ANGLE_ERRORS.unobserved * station[points - 1] / (double)(points - 1);
    for (int64_t i = 1; i < points; i++) {
        if (station[i] - station[i - 1] < longest) continue;
        int64_t first = first_at(n, s, station[i - 1]), last = first_at(n, s, station[i]);
        if (first > n - 1) first = n - 1;
        if (last > n - 1) last = n - 1;
        double turn = phi[last] - phi[first], begun = phi[first];
        double straight = acos(within(dot3(tangent[first], tangent[last]), -1.0, 1.0));
        double share = most(0.5 * (turn + straight), straight) / most(turn, 1e-300);
        double se = fabs(turn - straight) / sqrt(12.0);
        for (int64_t k = first; k < n; k++) {
            double part = least((s[k] - s[first]) / (s[last] - s[first]), 1.0);
            variance[k] += squared(part * se);
            if (k <= last) {
                kappa[k] *= share;
                phi[k] = begun + share * (phi[k] - begun);
            } else {
                phi[k] += (share - 1.0) * turn;
            }
        }
    }
}

/* Covariance of the state with the next one, by rows: g q for full g and triangle q. */
INLINE void cross_covariance(const double g[4][4], const Lanes q[4], Lanes cross[4]) {
    for (int j = 0; j < 4; j++) cross[j] = combined(g[j][0], g[j][1], g[j][2], g[j][3], q);
}

/* How the next state follows from this one, all points given: cross' p^-1, its columns as rows. */
INLINE void forward_columns(const Lanes cross[4], const double p[10], Lanes columns[4]) {
    double l00 = sqrt(p[0]), i00 = 1.0 / l00, l10 = p[1] * i00, l20 = p[2] * i00, l30 = p[3] * i00;
    double i11 = 1.0 / sqrt(most(p[4] - l10 * l10, SINGULAR * p[4]));
    double l21 = (p[5] - l20 * l10) * i11, l31 = (p[6] - l30 * l10) * i11;
    double i22 = 1.0 / sqrt(most(p[7] - l20 * l20 - l21 * l21, SINGULAR * p[7]));
    double l32 = (p[8] - l30 * l20 - l31 * l21) * i22;
    double i33 = 1.0 / sqrt(most(p[9] - l30 * l30 - l31 * l31 - l32 * l32, SINGULAR * p[9]));
    Lanes z0 = cross[0] * i00, z1 = (cross[1] - l10 * z0) * i11, z2 = (cross[2] - l20 * z0 - l21 * z1) * i22;
    Lanes z3 = (cross[3] - l30 * z0 - l31 * z1 - l32 * z2) * i33;
    columns[3] = z3 * i33;
    columns[2] = (z2 - l32 * columns[3]) * i22;
    columns[1] = (z1 - l21 * columns[2] - l31 * columns[3]) * i11;
    columns[0] = (z0 - l10 * columns[1] - l20 * columns[2] - l30 * columns[3]) * i00;
}

/* How an error of the curve changes the angle of one step, by coordinate: by T and a of both ends. With known
   stations a faster curve turns less. */
typedef struct { double t_before[3], a_before[3], t_here[3], a_here[3]; } StepErrors;

INLINE void errors_at(const double bend[3], const double tangent[3], double power, double half, double t[3], double a[3]) {
    double kappa = sqrt(dot3(bend, bend)), scale = half / (kappa + 1e-300), slant = -half * power * kappa;
    for (int c = 0; c < 3; c++) t[c] = slant * tangent[c], a[c] = bend[c] * scale;
}

/* Variance that a step adds by itself. */
INLINE double own_variance(const StepErrors *e, const double p[10], const double q[10], const Lanes cross[4]) {
    double total = 0.0;
    for (int c = 0; c < 3; c++) {
        double a = e->t_before[c], b = e->a_before[c], d = e->t_here[c], f = e->a_here[c];
        total += a * a * p[4] + 2.0 * a * b * p[5] + b * b * p[7] + d * d * q[4] + 2.0 * d * f * q[5] + f * f * q[7];
        total += 2.0 * (a * (d * cross[1][1] + f * cross[1][2]) + b * (d * cross[2][1] + f * cross[2][2]));
    }
    return total;
}

/* Carry covariances of an angle with the state, by coordinate, over a step; returns what they share with it. */
INLINE double carried(Lanes with_state[3], const StepErrors *e, const Lanes forward[4], const Lanes own[3]) {
    double shared = 0.0;
    for (int c = 0; c < 3; c++) {
        Lanes w = with_state[c], next = combined(w[0], w[1], w[2], w[3], forward);
        shared += e->t_before[c] * w[1] + e->a_before[c] * w[2] + e->t_here[c] * next[1] + e->a_here[c] * next[2];
        with_state[c] = next + own[c];
    }
    return shared;
}

/* What is kept of a piece: the covariance of its angle with the state at its end, how its angle follows from the state
   at its begin, and how the state at its end follows from that at its begin; all by rows. */
typedef struct { double with_state[3][4], from_begin[3][4], through[4][4]; } PieceErrors;
typedef struct { Lanes with_state[3], from_begin[3], through[4]; } PieceLanes;

INLINE void begin_piece(PieceLanes *piece) {
    for (int c = 0; c < 3; c++) piece->with_state[c] = piece->from_begin[c] = all(0.0);
    for (int i = 0; i < 4; i++) piece->through[i] = (Lanes){i == 0, i == 1, i == 2, i == 3};
}

INLINE void end_piece(const PieceLanes *piece, PieceErrors *out) {
    for (int c = 0; c < 3; c++) store(piece->with_state[c], out->with_state[c]), store(piece->from_begin[c], out->from_begin[c]);
    for (int i = 0; i < 4; i++) store(piece->through[i], out->through[i]);
}

/* Go on with a piece: the angle of a step follows from the state before it, and so from that at the begin. */
INLINE void extend_piece(PieceLanes *piece, const StepErrors *e, const Lanes forward[4]) {
    Lanes through[4];
    for (int c = 0; c < 3; c++) {
        double d = e->t_here[c], f = e->a_here[c];
        piece->from_begin[c] += combined(
            d * forward[0][1] + f * forward[0][2], d * forward[1][1] + f * forward[1][2] + e->t_before[c],
            d * forward[2][1] + f * forward[2][2] + e->a_before[c], d * forward[3][1] + f * forward[3][2], piece->through);
    }
    for (int i = 0; i < 4; i++)
        through[i] = combined(forward[0][i], forward[1][i], forward[2][i], forward[3][i], piece->through);
    for (int i = 0; i < 4; i++) piece->through[i] = through[i];
}

/* Covariance of the pieces' angles from what is kept of each; the diagonal is there already. */
static void share_among_pieces(int64_t pieces, const PieceErrors errors[], double *out, int64_t stride) {
    for (int64_t j = 0; j < pieces; j++) {
        double w[3][4];
        memcpy(w, errors[j].with_state, sizeof w);
        for (int64_t m = j + 1; m < pieces; m++) {
            double shared = 0.0;
            for (int c = 0; c < 3; c++) {
                const double *g = errors[m].from_begin[c];
                double next[4];
                shared += g[0] * w[c][0] + g[1] * w[c][1] + g[2] * w[c][2] + g[3] * w[c][3];
                for (int i = 0; i < 4; i++) {
                    const double *f = errors[m].through[i];
                    next[i] = f[0] * w[c][0] + f[1] * w[c][1] + f[2] * w[c][2] + f[3] * w[c][3];
                }
                memcpy(w[c], next, sizeof next);
            }
            out[j * stride + m] = out[m * stride + j] = shared;
        }
    }
}

/* Go on with the length: a route that moves towards the middle of its bend by δn is shorter by κ δn a metre. Returns
   what a step adds to the variance; (167). */
INLINE double carried_length(
    Lanes with_state[3], const double bend[3], const double bend_here[3], double half, double p, double q,
    const Lanes rows[4], const Lanes cross[4], const Lanes forward[4]) {
    double total = 0.0;
    for (int c = 0; c < 3; c++) {
        double a = half * bend[c], b = half * bend_here[c];
        Lanes w = with_state[c], next = combined(w[0], w[1], w[2], w[3], forward);
        total += a * a * p + b * b * q + 2.0 * a * b * cross[0][0] + 2.0 * (a * w[0] + b * next[0]);
        with_state[c] = next + a * cross[0] + b * rows[0];
    }
    return total;
}

/* Variance of the angle up to each node, and the covariance of the pieces' angles: the covariance of the state with
   every angle is carried along the route, which is a Markov process. Returns the variance of the length between the
   ends. */
static double angle_covariance(
    int64_t n, const double s[], const double tangent[][3], const double bend[][3], const double covariance[][10],
    const double gain[][4][4], double power, int64_t pieces, const int64_t joints[], double variance[], double *out,
    int64_t stride, PieceErrors errors[]) {
    Lanes whole[3] = {all(0.0), all(0.0), all(0.0)}, longer[3] = {all(0.0), all(0.0), all(0.0)};
    double of_length = 0.0;
    PieceLanes piece;
    int64_t m = 0;
    variance[0] = 0.0;
    begin_piece(&piece);
    for (int64_t k = 1; k < n; k++) {
        if (k > joints[m + 1] && m + 1 < pieces) {
            end_piece(&piece, &errors[m++]);
            begin_piece(&piece);
        }
        const double *p = covariance[k - 1], *q = covariance[k];
        double half = 0.5 * (s[k] - s[k - 1]);
        Lanes rows[4], cross[4], forward[4], own[3];
        StepErrors e;
        errors_at(bend[k - 1], tangent[k - 1], power, half, e.t_before, e.a_before);
        errors_at(bend[k], tangent[k], power, half, e.t_here, e.a_here);
        full(q, rows);
        cross_covariance(gain[k - 1], rows, cross);
        forward_columns(cross, p, forward);
        for (int c = 0; c < 3; c++)
            own[c] = e.t_before[c] * cross[1] + e.a_before[c] * cross[2] + e.t_here[c] * rows[1] + e.a_here[c] * rows[2];
        double total = own_variance(&e, p, q, cross);
        extend_piece(&piece, &e, forward);
        out[m * stride + m] += total + 2.0 * carried(piece.with_state, &e, forward, own);
        variance[k] = most(variance[k - 1] + total + 2.0 * carried(whole, &e, forward, own), 0.0);
        of_length += carried_length(longer, bend[k - 1], bend[k], half, p[0], q[0], rows, cross, forward);
    }
    end_piece(&piece, &errors[m]);
    share_among_pieces(pieces, errors, out, stride);
    return most(of_length, 0.0);
}

/* Curvature, angle, and the standard error of the curvature; `rectified` [n] is what noise bends by itself. Returns
   what smoothing takes from a sharp peak [rad], and the node of that peak. */
static double curvature_on_nodes(
    int64_t n, const double s[], const double tangent[][3], const double bend[][3], const double covariance[][10],
    double freedom, double tangent_share, double kappa[], double phi[], double se[], double rectified[], int64_t *peak) {
    double share = noise_share(freedom, tangent_share), excess = 0.0, whole = 0.0, highest = 0.0;
    *peak = 0;
    phi[0] = rectified[0] = 0.0;
    for (int64_t i = 0; i < n; i++) {
        double square = dot3(bend[i], bend[i]), v = covariance[i][7], before = excess;
        kappa[i] = without_noise(square, v * share);
        se[i] = sqrt(v);
        excess = sqrt(square + v) - sqrt(square);
        if (i == 0) continue;
        double h = s[i] - s[i - 1];
        phi[i] = phi[i - 1] + 0.5 * (kappa[i] + kappa[i - 1]) * h; /* docs/model.md (23) */
        rectified[i] = rectified[i - 1] + 0.5 * ANGLE_ERRORS.rectified * (excess + before) * h;
        double rate = rate_across(bend[i - 1], bend[i], tangent[i]) / (h * h);
        whole += rate / (double)(n - 1);
        if (rate > highest) *peak = i, highest = rate;
    }
    double window = s[n - 1] / most(freedom, ANGLE_ERRORS.few_parameters);
    return ANGLE_ERRORS.lost * most(sqrt(highest) - ANGLE_ERRORS.typical_peak * sqrt(whole), 0.0) * window * window;
}

/* Whether the nodes at which pieces meet begin at the first, end at the last, and increase. */
static int are_joints(int64_t n, int64_t count, const int64_t joints[]) {
    if (n < 2 || count < 2 || joints[0] != 0 || joints[count - 1] != n - 1) return 0;
    for (int64_t k = 1; k < count; k++)
        if (joints[k] <= joints[k - 1]) return 0;
    return 1;
}

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
    OUT double piece_covariance[2 * joint_count - 2][2 * joint_count - 2], WORK double work[41][n + joint_count]) {
    if (!are_joints(n, joint_count, joints) || gains != n - 1 || points < 2) return WRONG_SIZE;
    double *kappa = profile[0], *phi = profile[1], *kappa_se = profile[2], *variance = profile[3];
    double *rectified = work[0];
    PieceErrors *errors = (PieceErrors *)work[1];
    int64_t count = joint_count - 1, stride = 2 * count, peak;
    double lost = curvature_on_nodes(n, s, tangent, bend, covariance, freedom, tangent_share, kappa, phi, kappa_se, rectified, &peak);
    double turn = phi[n - 1] / (double)(points - 1);
    double uneven = ANGLE_ERRORS.sparse * uneven_turns(n, s, phi, points, station) / most(phi[n - 1], 1e-300);
    double relative = squared(shared_angle_error) +
                      squared(ANGLE_ERRORS.natural_ends * squared(squared(turn)) + ROUNDING.relative) +
                      squared(least(uneven, ANGLE_ERRORS.most_sparse));
    double *lengths = &piece_covariance[0][0], *angles = lengths + count * stride + count;
    for (int64_t i = 0; i < stride * stride; i++) lengths[i] = 0.0;
    double of_length = angle_covariance(
        n, s, tangent, bend, covariance, gain, known ? 2.0 : 1.0, count, joints, variance, angles, stride, errors);
    double factor = unknown_prior(freedom);
    for (int64_t i = 1; i < n; i++) {
        /* docs/model.md (26) */
        variance[i] = variance[i] * factor + relative * squared(phi[i]) + squared(rectified[i]);
        if (!known) variance[i] += squared(noise) * (squared(kappa[0]) + squared(kappa[i]));
        if (i >= peak) variance[i] += squared(lost);
    }
    bridge(n, s, tangent, points, station, kappa, phi, variance);
    double rest = variance[n - 1], whole = 0.0;
    angles_of_pieces(s, phi, count, joints, pieces[1], rectified);
    for (int64_t j = 0; j < count; j++) {
        pieces[0][j] = s[joints[j + 1]] - s[joints[j]];
        whole += pieces[1][j];
        for (int64_t k = 0; k < count; k++) {
            angles[j * stride + k] *= factor;
            rest -= angles[j * stride + k];
        }
    }
    /* what is not of the posterior, spread as the angle is, and as the length where there is none */
    const double *spread = whole > 0.0 ? pieces[1] : pieces[0];
    rest = most(rest, 0.0) / squared(whole > 0.0 ? whole : s[n - 1] - s[0]);
    for (int64_t j = 0; j < count; j++)
        for (int64_t k = 0; k < count; k++) angles[j * stride + k] += rest * spread[j] * spread[k];
    if (!known) {
        for (int64_t j = 0; j < count; j++)
            for (int64_t k = 0; k < count; k++)
                lengths[j * stride + k] += of_length * pieces[0][j] * pieces[0][k] / squared(s[n - 1] - s[0]);
        lengths[0] += squared(noise), lengths[(count - 1) * stride + count - 1] += squared(noise);
    }
    for (int64_t i = 0; i < n; i++) variance[i] = sqrt(variance[i]);
    return DONE;
}
