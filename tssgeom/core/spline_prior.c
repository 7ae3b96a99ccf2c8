/* The prior of a route that bends with it: how a state moves on, and what it is linearised along.

   The prior says that the rate of the curvature vector, carried along without twist, wanders like Brownian motion
   of intensity q with a restoring rate against the curvature (20). With κ = 0 the posterior mean is the smoothing
   spline of degree seven; with κ², κκ' and ω² of a previous pass circles and helices cost nothing.

   The state is r, r' = T, T' = a, and b with a' = b - κ² T, b' = -κκ' T - ω² a + w. Transitions are kept without
   the first column, which is that of the unit matrix: rows r, T, a, b on T, a, b. */
#include "lanes.h"
#include "spline.h"
#include "statistics.h"

enum { TERMS = 30 }; /* of a Taylor series: beyond them no step that a route takes gains a digit */
static const double INVERSE[TERMS] = {
    1.0 / 1,  1.0 / 2,  1.0 / 3,  1.0 / 4,  1.0 / 5,  1.0 / 6,  1.0 / 7,  1.0 / 8,  1.0 / 9,  1.0 / 10,
    1.0 / 11, 1.0 / 12, 1.0 / 13, 1.0 / 14, 1.0 / 15, 1.0 / 16, 1.0 / 17, 1.0 / 18, 1.0 / 19, 1.0 / 20,
    1.0 / 21, 1.0 / 22, 1.0 / 23, 1.0 / 24, 1.0 / 25, 1.0 / 26, 1.0 / 27, 1.0 / 28, 1.0 / 29, 1.0 / 30};

/* One step of length h; docs/model.md (20). The series of T obeys T_k+3 = -κκ' T_k - (κ² + ω²) T_k+1; r is its
   integral. */
INLINE void transition_over(double h, const double coupling[3], double f[12]) {
    double c2 = coupling[0], c3 = coupling[1], stiffness = coupling[0] + coupling[2];
    Lanes x = {1.0, 0.0, 0.0, 0.0}, y = {0.0, 1.0, 0.0, 0.0}, z = {-c2, 0.0, 1.0, 0.0}; /* T_k, T_k+1, T_k+2 */
    Lanes r = all(0.0), t = r, a = r, b = r;
    double power = 1.0, size = stiffness * h * h + fabs(c3) * h * h * h;
    for (int k = 0; k < TERMS; k++) {
        double after = power * h * INVERSE[k];
        r += x * after, t += x * power, a += y * power, b += z * power;
        Lanes next = -c3 * x - stiffness * y;
        x = y, y = z, z = next;
        power = after;
        if (k >= 3 && size * power < 1e-15) break;
    }
    b += c2 * t;
    for (int j = 0; j < 3; j++) f[j] = r[j], f[3 + j] = t[j], f[6 + j] = a[j], f[9 + j] = b[j];
}

void transitions(int64_t n, const double u[], const double coupling[][3], double out[][12]) {
    for (int j = 0; j < 12; j++) out[0][j] = 0.0;
    for (int64_t i = 1; i < n; i++) transition_over(u[i] - u[i - 1], coupling[i], out[i]);
}

/** Carry the state over every interval before a station.

Parameters: stations; κ² and κκ' on the interval before each station, and ω². */
ENTRY void tss_transitions(
    int64_t n, const double u[n], const double coupling[n][3], OUT double transition[n][12]) {
    if (n > 0) transitions(n, u, coupling, transition);
}

/** Stations, coupling, variances at the ends and tangents for the next pass; docs/model.md (20) to (22).

Unknown stations move to the feet of the points on the curve of this pass. */
ENTRY void tss_prior_along_curve(
    int64_t n, const double u[n], const double y[n][3], const double weight[n], double ratio, double q,
    const double mean[n][3][4], const double covariance[n][10], int64_t known, OUT double next_u[n],
    OUT double coupling[n][3], OUT double ends[4], OUT double tangent[n][3], WORK double work[5][n]) {
    double bends = 0.0, rates = 0.0, growth_at_end = 0.0, bend_integral = 0.0, rate_integral = 0.0;
    for (int k = 0; k < 4; k++) ends[k] = 0.0;
    if (n < 1) return;
    double arc = 0.0, speed_before = 0.0, bend_before = 0.0, rate_before = 0.0, *feet = work[0], *firm = work[1];
    for (int64_t i = 0; i < n; i++) {
        double r[3], t[3], a[3], b[3];
        for (int c = 0; c < 3; c++) r[c] = mean[i][c][0], t[c] = mean[i][c][1], a[c] = mean[i][c][2], b[c] = mean[i][c][3];
        double speed = most(sqrt(dot3(t, t)), 1e-12), off = 0.0;
        for (int c = 0; c < 3; c++) {
            tangent[i][c] = t[c] / speed;
            off += (y[i][c] - r[c]) * tangent[i][c];
        }
        double a_along = dot3(a, tangent[i]), b_along = dot3(b, tangent[i]);
        double square = 0.0, rate = 0.0, growth = 0.0, over2 = 1.0 / (speed * speed), over3 = over2 / speed;
        for (int c = 0; c < 3; c++) {
            double across = (a[c] - a_along * tangent[i][c]) * over2;
            double change = (b[c] - b_along * tangent[i][c]) * over3;
            square += across * across;
            rate += change * change;
            growth += across * change;
        }
        double p22 = covariance[i][7], p23 = covariance[i][8], p33 = covariance[i][9];
        double kappa_square = within(square - 0.75 * q * p22, 0.0, squared(PRIOR.sharpest));
        coupling[i][0] = kappa_square;
        coupling[i][1] = within(growth / most(square, 1e-300), -PRIOR.change, PRIOR.change) * kappa_square;
        double whole_bend = square + 2.0 * q * p22, whole_rate = rate + 2.0 * q * p33;
        bends += whole_bend / (double)n;
        rates += whole_rate / (double)n;
        if (i > 0) {
            double h = u[i] - u[i - 1];
            arc += 0.5 * (speed + speed_before) * h;
            bend_integral += 0.5 * (whole_bend + bend_before) * h;
            rate_integral += 0.5 * (whole_rate + rate_before) * h;
        }
        if (i == 0) growth_at_end -= growth + 2.0 * q * p23;
        else if (i == n - 1) growth_at_end += growth + 2.0 * q * p23;
        bend_before = whole_bend, rate_before = whole_rate, speed_before = speed;
        feet[i] = arc + off;
        firm[i] = most(weight[i], ROUNDING.relative);
    }
    /* docs/model.md (20a) */
    double omega_square = within((rate_integral - growth_at_end) / most(bend_integral, 1e-300), 0.0, squared(PRIOR.change));
    for (int64_t i = n - 1; i > 0; i--) {
        coupling[i][0] = 0.5 * (coupling[i][0] + coupling[i - 1][0]);
        coupling[i][1] = 0.5 * (coupling[i][1] + coupling[i - 1][1]);
        coupling[i][2] = omega_square;
    }
    coupling[0][2] = omega_square;
    double noise = most(ratio * q, squared(PRIOR.rounding));
    ends[0] = PRIOR.vague * covariance[0][0] / ratio;
    ends[1] = PRIOR.vague * covariance[0][4] / ratio;
    /* docs/model.md (20b) */
    ends[2] = (squared(ROUNDING.relative) + 0.5 * bends) / noise;
    ends[3] = (squared(ROUNDING.relative) + 0.5 * rates) / noise;
    if (known) {
        for (int64_t i = 0; i < n; i++) next_u[i] = u[i];
        return;
    }
    /* docs/model.md (22) */
    tss_isotonic_regression(n, feet, firm, next_u, (double (*)[n])(work + 2));
    double first = next_u[0];
    for (int64_t i = 0; i < n; i++) next_u[i] += PRIOR.rounding * (double)i - first;
}
