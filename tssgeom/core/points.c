/* Sensed points before any fit: what may be used as it is, and which point stands off its neighbours. SI units. */
#include "route.h"

#include <string.h>

/* Square beyond which a residual, one of `count`, is an outlier; docs/model.md (29). */
double outlier_limit(int64_t count, double variance) {
    return (squared(CHANCE.rare) + 2.0 * log((double)count)) * variance;
}

/* Variance by which residuals are judged: the greatest of three; docs/model.md (29). */
double residual_variance(double known, double robust, double spacing) {
    return most(most(robust, known), squared(PRIOR.rounding * spacing));
}

/** How many points have no weight, and the length of the path through the others [m]. */
ENTRY void tss_path_length(
    int64_t n, const double points[n][3], const double weight[n], OUT int64_t *ignored, OUT double *path) {
    int64_t last = -1, count = 0;
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++) {
        if (weight[i] <= 0.0) {
            count++;
            continue;
        }
        if (last >= 0) sum += distance3(points[i], points[last]);
        last = i;
    }
    *ignored = count, *path = sum;
}

/* Square distance of a point from the line between two others, or from the nearer end beyond it. */
static double off_chord(const double point[3], const double first[3], const double last[3]) {
    double along = 0.0, size = 0.0, square = 0.0;
    for (int c = 0; c < 3; c++) {
        along += (point[c] - first[c]) * (last[c] - first[c]);
        size += squared(last[c] - first[c]);
    }
    double share = size > 0.0 ? least(most(along / size, 0.0), 1.0) : 0.0;
    for (int c = 0; c < 3; c++) square += squared(point[c] - first[c] - share * (last[c] - first[c]));
    return square;
}

/** Points between which straight lines pass all others within a distance `off` [m], both ends among them.

Returns how many, and marks them; where there are more than `highest`, it stops at one more, so that the work is
linear in the points. */
ENTRY int64_t tss_corners(
    int64_t n, const double points[n][3], double off, int64_t highest, OUT uint8_t kept[n], WORK double work[2 * n]) {
    int64_t(*between)[2] = (int64_t(*)[2])work, waiting = 1, count = n > 1 ? 2 : n;
    memset(kept, 0, (size_t)n);
    if (n < 2) return count;
    kept[0] = kept[n - 1] = 1;
    between[0][0] = 0, between[0][1] = n - 1;
    while (waiting && count <= highest) {
        int64_t first = between[--waiting][0], last = between[waiting][1], worst = first;
        double farthest = off * off;
        for (int64_t i = first + 1; i < last; i++) {
            double square = off_chord(points[i], points[first], points[last]);
            if (square > farthest) farthest = square, worst = i;
        }
        if (worst == first) continue;
        kept[worst] = 1, count++;
        between[waiting][0] = first, between[waiting++][1] = worst;
        between[waiting][0] = worst, between[waiting++][1] = last;
    }
    return count;
}

static double median_step(int64_t n, const double points[][3], double *work) {
    for (int64_t i = 0; i + 1 < n; i++) work[i] = distance3(points[i + 1], points[i]);
    return median_of(n - 1, work);
}

/** Median distance of neighbours [m], or the chord of all over their number where that is longer. */
ENTRY double tss_mean_spacing(int64_t n, const double points[n][3], WORK double work[n]) {
    if (n < 2) return NAN;
    return most(median_step(n, points, work), distance3(points[n - 1], points[0]) / (double)(n - 1));
}

/** The spacing that bounds the pieces of a route of a length [m] from below [m].

It is the mean, except for points that crowd in a part of the route: a bend may lie among them. */
ENTRY double tss_spacing_of_pieces(int64_t n, const double points[n][3], double length, WORK double work[n]) {
    if (n < 2) return NAN;
    for (int64_t i = 0; i + 1 < n; i++) work[i] = distance3(points[i + 1], points[i]);
    double crowded = quantile_of(n - 1, work, (int64_t)(SPACING.crowd_quantile * (double)(n - 1)));
    return least(length / (double)n, SPACING.uneven * crowded);
}

/** Path from point to point [m]; chords over `every` points over their stations [1]; and whether stations are
finite and none lies before the last. */
ENTRY void tss_against_stations(
    int64_t n, const double points[n][3], const double stations[n], int64_t every, OUT double *path,
    OUT double *over, OUT int64_t *increasing) {
    double sum = 0.0, chords = 0.0;
    int64_t last = 0, sound = n > 0 && isfinite(stations[0]);
    for (int64_t i = 1; i < n; i++) {
        sound = sound && isfinite(stations[i]) && stations[i] >= stations[i - 1];
        sum += distance3(points[i], points[i - 1]);
        if (i - last == every) {
            chords += distance3(points[i], points[last]);
            last = i;
        }
    }
    *path = sum, *over = n > 0 ? chords / most(stations[last], 1e-300) : 0.0, *increasing = sound;
}

/* Root mean square distance of points [count][3] from their parabola over chord length [m]; one may be left out. */
static double off_parabola(int count, const double p[][3], int without) {
    double chord[6] = {0.0}, basis[3][6], total = 0.0;
    int which[6], n = 0;
    for (int i = 0; i < count; i++) {
        if (i == without) continue;
        which[n] = i;
        if (n > 0) chord[n] = chord[n - 1] + distance3(p[i], p[which[n - 1]]);
        n++;
    }
    for (int degree = 0; degree < 3; degree++) { /* orthonormal polynomials over the chord lengths */
        for (int i = 0; i < n; i++)
            basis[degree][i] = degree == 0 ? 1.0 : basis[degree - 1][i] * (chord[i] / (chord[n - 1] + 1e-300));
        for (int lower = 0; lower < degree; lower++) {
            double share = 0.0;
            for (int i = 0; i < n; i++) share += basis[degree][i] * basis[lower][i];
            for (int i = 0; i < n; i++) basis[degree][i] -= share * basis[lower][i];
        }
        double square = 1e-300;
        for (int i = 0; i < n; i++) square += basis[degree][i] * basis[degree][i];
        for (int i = 0; i < n; i++) basis[degree][i] /= sqrt(square);
    }
    for (int c = 0; c < 3; c++) {
        double rest[6];
        for (int i = 0; i < n; i++) rest[i] = p[which[i]][c] - p[which[0]][c];
        for (int degree = 0; degree < 3; degree++) {
            double share = 0.0;
            for (int i = 0; i < n; i++) share += rest[i] * basis[degree][i];
            for (int i = 0; i < n; i++) rest[i] -= share * basis[degree][i];
        }
        for (int i = 0; i < n; i++) total += rest[i] * rest[i];
    }
    return sqrt(total / (3.0 * n));
}

/* Twice what the bend of points 1, 3 and 5 moves a route aside, for way times reach [m²]. */
static double bent_beyond(const double p[6][3], double square) {
    double first = distance3(p[1], p[3]) + 1e-300, second = distance3(p[3], p[5]) + 1e-300, change = 0.0;
    for (int c = 0; c < 3; c++) change += squared((p[1][c] - p[3][c]) / first - (p[3][c] - p[5][c]) / second);
    return 2.0 * sqrt(change) / (first + second) * square;
}

/* How far the first point leaps aside from straight on from the next ones, or 0 [m]. Twice what the bend of these
   explains is taken off, and the longer the leap beside the points that show the direction, the less it counts. */
static double off_direction(const double p[6][3], double spacing) {
    int far = 3; /* the point that shows the way: neighbours within the noise do not */
    while (far < 5 && distance3(p[1], p[far]) < 2.0 * spacing) far++;
    double size = distance3(p[0], p[1]), length = distance3(p[1], p[far]) + 1e-300, square = 0.0;
    for (int c = 0; c < 3; c++) square += squared(p[0][c] - p[1][c] - size * (p[1][c] - p[far][c]) / length);
    double aside = sqrt(square);
    if (!(size > RAW.end_leap * spacing && aside > RAW.end_leap_aside * size)) return 0.0;
    if (size > RAW.end_too_far * spacing) return aside / least(size / length, RAW.most_discount);
    return most(aside - bent_beyond(p, size * (size + length)), 0.0) / most(size / length, 1.0);
}

/* Median over the route of how far five points lie from a parabola [m]. */
static double typical_off_parabola(int64_t n, const double points[][3], double *work) {
    int64_t every = 1 + n / 20, windows = (n - 5) / every + 1;
    for (int64_t w = 0; w < windows; w++) work[w] = off_parabola(5, points + w * every, -1);
    return median_of(windows, work);
}

/* Which of the first three points keeps the others from lying on a parabola, or -1. */
static int worst_of_end(const double p[6][3], double spacing, double typical) {
    double whole = off_parabola(5, p, -1);
    if (whole > most(CHANCE.never * typical, RAW.end_off_curve * spacing)) {
        int best = -1;
        double smallest = RAW.end_improvement * whole;
        for (int i = 0; i < 3; i++) {
            double off = off_parabola(6, p, i);
            if (off < smallest) best = i, smallest = off;
        }
        if (best >= 0) return best;
    }
    return off_direction(p, spacing) > RAW.end_off_direction * typical ? 0 : -1;
}

/* Squared distance of a point from wa·a + wb·b across the way from `begin` to `end`. */
static double off_line(
    const double here[3], const double a[3], double wa, const double b[3], double wb, const double begin[3],
    const double end[3]) {
    double along = 0.0, way2 = 1e-300, off2 = 0.0;
    for (int c = 0; c < 3; c++) {
        double off = here[c] - wa * a[c] - wb * b[c], way = end[c] - begin[c];
        along += off * way, way2 += way * way, off2 += off * off;
    }
    return most(off2 - along * along / way2, 0.0);
}

/* How far a point lies beyond the next one or behind the last, along the way between them [m]. */
static double backwards(const double before[3], const double here[3], const double after[3]) {
    double forward = 0.0, behind = 0.0, way2 = 1e-300;
    for (int c = 0; c < 3; c++) {
        double way = after[c] - before[c];
        forward += (here[c] - before[c]) * way, behind += (after[c] - here[c]) * way, way2 += way * way;
    }
    return most(-least(forward, behind) / sqrt(way2), 0.0);
}

static int any_off_middle(int64_t n, const double p[][3], double spacing) {
    for (int64_t i = 2; i < n - 2; i++) {
        const double *before = p[i - 1], *after = p[i + 1];
        if (!(off_line(p[i], before, 0.5, after, 0.5, before, after) <= spacing * spacing)) return 1;
        if (!(backwards(before, p[i], after) <= spacing)) return 1;
    }
    return 0;
}

/* The inner point that is farthest from every guess from its neighbours, if an outlier, or -1. A good point beside an
   outlier still agrees with one of the guesses: halfway between the next, between the next but one, or straight on
   from either side. A point beyond the next one or behind the last is off by as much. */
static int64_t worst_inside(int64_t n, const double p[][3], double spacing, double *size) {
    if (!any_off_middle(n, p, spacing)) return -1;
    int64_t worst = 0;
    for (int64_t i = 2; i < n - 2; i++) {
        const double *far = p[i - 2], *before = p[i - 1], *after = p[i + 1], *farther = p[i + 2];
        double square = off_line(p[i], before, 0.5, after, 0.5, before, after);
        square = least(square, off_line(p[i], far, 0.5, farther, 0.5, far, farther));
        square = least(square, off_line(p[i], before, 2.0, far, -1.0, far, before));
        square = least(square, off_line(p[i], after, 2.0, farther, -1.0, farther, after));
        size[i - 2] = most(sqrt(square), backwards(before, p[i], after));
        if (size[i - 2] > size[worst]) worst = i - 2;
    }
    double largest = size[worst];
    return largest > most(CHANCE.never * median_of(n - 4, size), spacing) ? worst + 2 : -1;
}

/** The greatest outlier among eight points or more of a median spacing [m], the ends first; -1 for none. */
ENTRY int64_t tss_worst_outlier(int64_t n, const double points[n][3], double spacing, WORK double work[n]) {
    double typical = -1.0, end[6][3];
    if (n < RAW.fewest) return -1;
    for (int side = 0; side < 2; side++) {
        for (int i = 0; i < 6; i++)
            for (int c = 0; c < 3; c++) end[i][c] = points[side == 0 ? i : n - 1 - i][c];
        int smooth = off_parabola(5, end, -1) <= RAW.end_off_curve * spacing && off_direction(end, spacing) <= 0.0;
        if (smooth) continue;
        if (typical < 0.0) typical = typical_off_parabola(n, points, work);
        int off = worst_of_end(end, spacing, typical);
        if (off >= 0) return side == 0 ? off : n - 1 - off;
    }
    return worst_inside(n, points, spacing, work);
}

static int same(const double a[3], const double b[3]) { return a[0] == b[0] && a[1] == b[1] && a[2] == b[2]; }

/* Whether points are finite, differ from the one before and four from each other, and span as usual. */
static int plain(int64_t n, const double points[][3]) {
    double square = 0.0;
    int64_t others[4], distinct = 0;
    for (int c = 0; c < 3; c++) {
        double low = points[0][c], high = points[0][c];
        for (int64_t i = 0; i < n; i++) {
            double x = points[i][c];
            if (!(ROUNDING.exact * fabs(x) <= POINTS.least_extent)) return 0;
            low = least(low, x), high = most(high, x);
        }
        square += squared(high - low);
    }
    for (int64_t i = 0; i < n; i++) {
        if (i > 0 && same(points[i], points[i - 1])) return 0;
        int fresh = distinct < 4;
        for (int64_t k = 0; k < distinct; k++) fresh = fresh && !same(points[i], points[others[k]]);
        if (fresh) others[distinct++] = i;
    }
    return distinct == 4 && squared(POINTS.usual_least) <= square && square <= squared(POINTS.usual_most);
}

/* Whether more than half of the points are at least so far from their mean [m]. */
static int spread_out(int64_t n, const double points[][3], double far) {
    double mean[3] = {0.0, 0.0, 0.0};
    int64_t beyond = 0;
    for (int64_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) mean[c] += points[i][c] / (double)n;
    for (int64_t i = 0; i < n; i++) beyond += distance3(points[i], mean) >= far;
    return beyond > n / 2 + 1;
}

/** Whether points may be used as they are: finite, apart, of a usual extent, in order, none an outlier.

Returns 1 if so, 0 where they are not plain, and -1 where only the quick bounds on order and outliers fail. */
ENTRY int64_t tss_clearly_sound(int64_t n, const double points[n][3], WORK double work[3][n]) {
    if (n < RAW.fewest || !plain(n, points)) return 0;
    double longest = 0.0, spacing = median_step(n, points, work[0]);
    for (int64_t i = 0; i + 1 < n; i++) longest = most(longest, distance3(points[i + 1], points[i]));
    if (longest > ORDERING.leap * spacing || !spread_out(n, points, spacing / ORDERING.wandering)) return -1;
    return tss_worst_outlier(n, points, spacing, work[0]) < 0 ? 1 : -1;
}
