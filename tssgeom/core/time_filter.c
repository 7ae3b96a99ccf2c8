/* A filter in time of points that are sensed again and again: several motions at once, each with its own gain,
   and how likely each is (interacting multiple models; Blom and Bar-Shalom 1988). docs/model.md (156) to (159). */
#include "core.h"

#include <float.h>
#include <string.h>

enum {
    MOTIONS = 7, /* from a route that stands to one that goes where it likes */
    SMOOTH = 8,  /* smoothest components of a motion along the route, which distinguish it from noise */
};

/* Noise of the acceleration over that of the points [1 / step³]; chosen: the bandwidth grows threefold from one to
   the next, the last takes a frame as it comes. */
static const double RESTLESSNESS[MOTIONS] = {0.0, 1e-5, 1e-3, 1e-1, 1e1, 1e3, 1e9};

typedef struct {
    double xx, xv, vv; /* of position and velocity, over the variance of the noise */
} spread;

typedef struct {
    double values, squares; /* counted, and their sum [m²] */
} counted;

static double variance_of(counted c) { return c.squares / c.values; }

static counted forgetting(counted c) {
    double share = least(1.0, TIME_FILTER.most_values / most(c.values, 1.0));
    return (counted){c.values * share, c.squares * share};
}

/* Probability of going from one motion to another: calming goes step by step, starting at once; (157). */
static double change(int from, int to) {
    if (to == from + 1 || to == from - 1) return TIME_FILTER.neighbour;
    return to > from ? TIME_FILTER.start : 0.0;
}

static void transitions(double way[MOTIONS][MOTIONS]) { /* [to][from] */
    for (int from = 0; from < MOTIONS; from++) {
        way[from][from] = 1.0;
        for (int to = 0; to < MOTIONS; to++)
            if (to != from) way[to][from] = change(from, to), way[from][from] -= way[to][from];
    }
}

/* The smoothest components of a field along the points (a cosine transform): wave [SMOOTH][n], orthonormal. */
static void waves(int64_t n, int64_t count, double *wave) {
    for (int64_t i = 0; i < n; i++) {
        double x = cos(3.14159265358979323846 * ((double)i + 0.5) / (double)n), last = 1.0, now = x;
        double size = sqrt(2.0 / (double)n);
        wave[i] = sqrt(1.0 / (double)n);
        for (int64_t m = 1; m < count; m++) {
            wave[m * n + i] = size * now;
            double next = 2.0 * x * now - last;
            last = now, now = next;
        }
    }
}

/* What distinguishes a motion from noise: the smoothest components of each coordinate, or one direction alone. */
typedef struct {
    int64_t n, count;
    const double *wave, (*direction)[3]; /* [count][n]; or [n][3], a unit vector */
} basis;

/* Components of a field [n][3]; returns the sum of their squares. */
static double smooth_part(const basis *of, const double field[][3], double part[SMOOTH][3]) {
    double squares = 0.0;
    for (int64_t m = 0; m < of->count; m++) {
        double sum[3] = {0.0, 0.0, 0.0};
        if (of->direction)
            for (int64_t i = 0; i < of->n; i++)
                for (int c = 0; c < 3; c++) sum[0] += of->direction[i][c] * field[i][c];
        else
            for (int64_t i = 0; i < of->n; i++)
                for (int c = 0; c < 3; c++) sum[c] += of->wave[m * of->n + i] * field[i][c];
        for (int c = 0; c < 3; c++) part[m][c] = sum[c], squares += sum[c] * sum[c];
    }
    return squares;
}

static int sensed(const double point[3]) { return isfinite(point[0] + point[1] + point[2]); }

/* Square of what second differences in time have beside their smooth part; (158). */
static counted rough_part(
    const basis *of, const double points[][3], const double last[][3], const double before[][3], double ratio,
    double coordinates, double (*field)[3]) {
    int64_t used = 0, n = of->n, count = of->count;
    double squares = 0.0, part[SMOOTH][3];
    for (int64_t i = 0; i < n; i++) {
        int all = sensed(points[i]) && sensed(last[i]) && sensed(before[i]);
        used += all;
        for (int c = 0; c < 3; c++) {
            double second = points[i][c] - last[i][c] - ratio * (last[i][c] - before[i][c]);
            field[i][c] = all ? second : 0.0;
            squares += squared(field[i][c]);
        }
    }
    if (used <= count) return (counted){0.0, 0.0};
    squares = most(0.0, squares - smooth_part(of, field, part));
    double gain = 1.0 + squared(1.0 + ratio) + squared(ratio);
    double own = 0.5; /* neighbouring differences share points */
    return (counted){own * coordinates * (double)(used - count), own * squares / gain};
}

/* What the filter knows of one motion: fields along the points, and their smooth components. */
typedef struct {
    double (*x)[3], (*v)[3]; /* [n] */
    double position[SMOOTH][3], velocity[SMOOTH][3];
    spread p;
    double probability;
} motion;

static void add(int64_t n, double share, const double *values, double *sum) {
    for (int64_t i = 0; i < n; i++) sum[i] += share * values[i];
}

/* Where each motion begins a step: the mean of all, by how likely it came from them; returns its probability.
   `whole_noise` is the sum of squares of the noise in the smooth components. */
static double mixed(
    int64_t n, int64_t count, const motion from[MOTIONS], const double way[MOTIONS], double whole_noise,
    motion *now) {
    double share[MOTIONS], whole = 0.0;
    for (int j = 0; j < MOTIONS; j++) share[j] = from[j].probability * way[j], whole += share[j];
    memset(now->x, 0, (size_t)n * sizeof *now->x), memset(now->v, 0, (size_t)n * sizeof *now->v);
    memset(now->position, 0, sizeof now->position), memset(now->velocity, 0, sizeof now->velocity);
    now->p = (spread){0.0, 0.0, 0.0};
    for (int j = 0; j < MOTIONS; j++) {
        if (share[j] == 0.0) continue;
        share[j] /= whole;
        add(3 * n, share[j], *from[j].x, *now->x), add(3 * n, share[j], *from[j].v, *now->v);
        add(3 * count, share[j], *from[j].position, *now->position);
        add(3 * count, share[j], *from[j].velocity, *now->velocity);
    }
    for (int j = 0; j < MOTIONS; j++) {
        if (share[j] == 0.0) continue;
        double xx = 0.0, xv = 0.0, vv = 0.0;
        for (int64_t m = 0; m < count; m++)
            for (int c = 0; c < 3; c++) {
                double dx = from[j].position[m][c] - now->position[m][c];
                double dv = from[j].velocity[m][c] - now->velocity[m][c];
                xx += dx * dx, xv += dx * dv, vv += dv * dv;
            }
        now->p.xx += share[j] * (from[j].p.xx + xx / whole_noise);
        now->p.xv += share[j] * (from[j].p.xv + xv / whole_noise);
        now->p.vv += share[j] * (from[j].p.vv + vv / whole_noise);
    }
    return whole;
}

/* Predict a motion over a step and correct it by the points; returns the variance of an innovation over that of
   the noise, and leaves the innovations in `field`. */
static double corrected(
    int64_t n, double restlessness, double step, const double points[][3], motion *now, double (*field)[3]) {
    spread p = now->p;
    if (restlessness == 0.0) { /* it stands */
        memset(now->v, 0, (size_t)n * sizeof *now->v);
        p.xv = p.vv = 0.0;
    }
    p.xx += 2.0 * step * p.xv + step * step * p.vv + restlessness * step * step * step / 3.0;
    p.xv += step * p.vv + 0.5 * restlessness * step * step;
    p.vv += restlessness * step;
    double expected = p.xx + 1.0, to_x = p.xx / expected, to_v = p.xv / expected;
    for (int64_t i = 0; i < n; i++) {
        int here = sensed(points[i]);
        for (int c = 0; c < 3; c++) {
            now->x[i][c] += step * now->v[i][c];
            field[i][c] = here ? points[i][c] - now->x[i][c] : 0.0;
            now->x[i][c] += to_x * field[i][c], now->v[i][c] += to_v * field[i][c];
        }
    }
    now->p = (spread){to_x, to_v, p.vv - to_v * p.xv};
    return expected;
}

/* Squares of the distances of single points from where they were expected, over the variance of the noise; a point
   that is missing has none. */
static void judge(
    int64_t n, const motion from[MOTIONS], double step, const double points[][3], double r, double (*field)[3],
    double innovation[]) {
    memset(field, 0, (size_t)n * sizeof *field);
    for (int k = 0; k < MOTIONS; k++) {
        add(3 * n, from[k].probability, *from[k].x, *field);
        add(3 * n, from[k].probability * step, *from[k].v, *field);
    }
    for (int64_t i = 0; i < n; i++) {
        double off = distance3(points[i], field[i]);
        innovation[i] = sensed(points[i]) ? off * off / r : 0.0;
    }
}

/** Carry the filter over one frame of points [m].

Parameters: what it remembers, for each motion the positions [m], then for each the velocities [m per unit of time],
then the last two frames as sensed; probability of each motion; variance of a position, its covariance with the
velocity and the variance of that, over the variance of the noise; of the noise of the smooth part of the motion
and of the rest, values counted and their sum of squares [m²], then the last step; the points, NaN where one is
missing; the time since the last frame; a variance [m²] that the noise of the rest cannot exceed; how many of the
coordinates are sensed, the others being 0; and a unit vector of all coordinates, by whose component alone motions
are distinguished, or zeros for the smoothest components of each. Time is counted in usual steps.
Returns what it remembers then, in the same order; the filtered points; the squared distance of each
point from where it was expected, over the variance of the noise; the variance of a filtered coordinate and of a
sensed one [m²]; and the probability that the route stands. */
ENTRY void tss_filter_in_time(
    int64_t n, const double memory[16][n][3], const double probability[7], const double covariance[7][3],
    const double noise[5], const double points[n][3], double step, double most_variance, int64_t coordinates,
    const double direction[n][3],
    OUT double memory_after[16][n][3], OUT double probability_after[7], OUT double covariance_after[7][3],
    OUT double noise_after[5], OUT double filtered[n][3], OUT double innovation[n], OUT double *variance,
    OUT double *sensed_variance, OUT double *standing, WORK double work[11][n]) {
    double *wave = work[0], (*field)[3] = (double(*)[3])work[SMOOTH], alone = 0.0;
    for (int64_t i = 0; i < n; i++) alone += fabs(direction[i][0]) + fabs(direction[i][1]) + fabs(direction[i][2]);
    const int64_t count = alone > 0.0 ? 1 : n < SMOOTH ? n : SMOOTH;
    const basis of = {n, count, wave, alone > 0.0 ? direction : NULL};
    double smooth_values = alone > 0.0 ? 1.0 : (double)coordinates * (double)count, unused[SMOOTH][3];
    if (!of.direction) waves(n, count, wave);

    counted low = {noise[0], noise[1]}, high = {noise[2], noise[3]};
    if (noise[4] > 0.0) {
        counted more = rough_part(
            &of, points, memory[14], memory[15], step / noise[4], (double)coordinates, field);
        high.values += more.values, high.squares += least(more.squares, more.values * most_variance);
        high = forgetting(high);
    }
    counted prior = {TIME_FILTER.prior_values, TIME_FILTER.prior_values * variance_of(high)};
    counted joint = {low.values + prior.values, low.squares + prior.squares};

    motion from[MOTIONS];
    double way[MOTIONS][MOTIONS], expected[MOTIONS], squares[MOTIONS], evidence[MOTIONS], best = -INFINITY;
    transitions(way);
    for (int k = 0; k < MOTIONS; k++) {
        from[k].x = (double(*)[3])memory[k], from[k].v = (double(*)[3])memory[MOTIONS + k];
        from[k].p = (spread){covariance[k][0], covariance[k][1], covariance[k][2]};
        from[k].probability = probability[k];
        smooth_part(&of, memory[k], from[k].position);
        smooth_part(&of, memory[MOTIONS + k], from[k].velocity);
    }
    judge(n, from, step, points, variance_of(joint), field, innovation);
    for (int k = 0; k < MOTIONS; k++) {
        motion now = {.x = memory_after[k], .v = memory_after[MOTIONS + k]};
        double prior_probability = mixed(n, count, from, way[k], smooth_values * variance_of(joint), &now);
        expected[k] = corrected(n, RESTLESSNESS[k], step, points, &now, field);
        squares[k] = smooth_part(&of, field, unused);
        covariance_after[k][0] = now.p.xx, covariance_after[k][1] = now.p.xv, covariance_after[k][2] = now.p.vv;
        evidence[k] = log(prior_probability) - 0.5 * smooth_values * log(expected[k])
                      - 0.5 * (joint.values + smooth_values) * log(joint.squares + squares[k] / expected[k]);
        best = most(best, evidence[k]);
    }
    double sum = 0.0;
    for (int k = 0; k < MOTIONS; k++)
        sum += probability_after[k] = most(exp(evidence[k] - best), DBL_MIN);
    memset(filtered, 0, (size_t)n * sizeof *filtered);
    for (int k = 0; k < MOTIONS; k++) {
        double share = probability_after[k] /= sum;
        add(3 * n, share, *memory_after[k], *filtered);
        double weight = share / squared(squared(expected[k])); /* a motion hides the noise */
        low.values += weight * smooth_values, low.squares += weight * squares[k] / expected[k];
    }
    low = forgetting(low);
    double r = (low.squares + prior.squares) / (low.values + prior.values);

    double middle[SMOOTH][3], own[SMOOTH][3], p = 0.0;
    smooth_part(&of, filtered, middle);
    for (int k = 0; k < MOTIONS; k++) {
        smooth_part(&of, memory_after[k], own);
        double apart = 0.0;
        for (int64_t m = 0; m < count; m++)
            for (int c = 0; c < 3; c++) apart += squared(own[m][c] - middle[m][c]);
        p += probability_after[k] * (covariance_after[k][0] + apart / (smooth_values * r));
    }
    for (int64_t i = 0; i < n; i++)
        if (!sensed(points[i])) filtered[i][0] = filtered[i][1] = filtered[i][2] = NAN;
    memcpy(memory_after[15], memory[14], (size_t)n * sizeof *memory[14]);
    memcpy(memory_after[14], points, (size_t)n * sizeof *points);
    noise_after[0] = low.values, noise_after[1] = low.squares, noise_after[2] = high.values;
    noise_after[3] = high.squares, noise_after[4] = step;
    *variance = p * r, *sensed_variance = r, *standing = probability_after[0];
}
