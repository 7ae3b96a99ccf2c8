/* The chain solved exactly in one sweep, for straight laws.

   From the proximal side, all that lies distal of a point is one curve: how far the point moves in this
   step, w, against the tension T there. It rises, and is a polyline for straight laws. A bar adds its
   extension to w. A node that sticks holds w = 0 over a range of tensions, so it pulls the curve apart there:
   what moves to the proximal end is shifted to higher tensions, what moves to the distal end to lower ones.
   At the drive the tension or the displacement picks the point of the last curve, and the way back gives
   every node. Nothing is guessed, iterated or regularised. */
#include <math.h>
#include <stdint.h>

#include "lumped.h"

/* Where curves end: no tension and no motion of a run comes near. */
static const double FAR_N = 1e5, FAR_M = 10.0;
/* Of the tension: so close to a limit a node slips, by w = 0 or, under a weight, by any w. */
static const double EDGE = 1e-11;

typedef struct {
    int64_t size;
    double *t, *w; /* tension and motion [N, m] */
} Curve;

typedef struct { /* tension of rest of a node, and the range that it holds [N] */
    double rest, low, high;
} Held;

/* A held end moves by 0 under any tension, a weight by anything under its own. */
static void far_end(Curve *curve, const Chain *chain) {
    curve->size = 2;
    curve->t[0] = chain->weight ? chain->pretension : 0.0, curve->w[0] = chain->weight ? -FAR_M : 0.0;
    curve->t[1] = chain->weight ? chain->pretension : FAR_N, curve->w[1] = chain->weight ? FAR_M : 0.0;
}

/* Add a bar, which goes slack at no tension: the curve then falls straight down. Return where the right end
   of the bar rests when it is slack [m]. */
static double add_bar(Curve *curve, double offset, double slope) {
    double *t = curve->t, *w = curve->w;
    if (t[0] > 0.0) { /* a weight at the end: never slack */
        for (int64_t m = 0; m < curve->size; m++) w[m] += offset + slope * t[m];
        return 0.0;
    }
    int64_t first = 0;
    while (first + 2 < curve->size && t[first + 1] <= 0.0) first++;
    double share = -t[first] / (t[first + 1] - t[first]);
    double loose = w[first] + share * (w[first + 1] - w[first]);
    int64_t kept = curve->size - first - 1;
    if (first == 0) /* one point more than before */
        for (int64_t m = kept; m > 0; m--) t[m + 1] = t[m], w[m + 1] = w[m];
    else if (first > 1)
        for (int64_t m = 0; m < kept; m++) t[m + 2] = t[first + 1 + m], w[m + 2] = w[first + 1 + m];
    for (int64_t m = 2; m < kept + 2; m++) w[m] += offset + slope * t[m];
    t[1] = 0.0, w[1] = loose + offset;
    t[0] = 0.0, w[0] = fmin(-FAR_M, w[1]);
    curve->size = kept + 2;
    return loose;
}

/* Pull the curve apart at w = 0 into another one. */
static Held add_node(const Curve *from, Curve *to, const double up[3], const double down[3]) {
    const double *t = from->t, *w = from->w;
    int64_t m = 0, size = from->size;
    for (; m < size && w[m] < 0.0; m++) {
        to->t[m] = down[0] * t[m] + down[1] + down[2] * w[m];
        to->w[m] = w[m];
    }
    Held held;
    if (m == 0) held.rest = t[0];
    else if (m == size) held.rest = t[size - 1];
    else held.rest = t[m - 1] + -w[m - 1] / (w[m] - w[m - 1]) * (t[m] - t[m - 1]);
    held.low = down[0] * held.rest + down[1], held.high = up[0] * held.rest + up[1];
    to->t[m] = held.low, to->w[m] = 0.0;
    to->t[m + 1] = held.high, to->w[m + 1] = 0.0;
    for (int64_t n = m; n < size; n++) {
        to->t[n + 2] = up[0] * t[n] + up[1] + up[2] * w[n];
        to->w[n + 2] = w[n];
    }
    to->size = size + 2;
    return held;
}

int answer(
    const Chain *chain, const double *offset, const double *slope, const double (*up)[3],
    const double (*down)[3], double drive, double *tension, double *moved, double *work) {
    int64_t k = chain->nodes, room = 4 * k + 8;
    Curve here = { 0, work, work + room }, other = { 0, work + 2 * room, work + 3 * room };
    Held *held = (Held *)(work + 4 * room); /* [k] */
    double *loose = work + 4 * room + 3 * k; /* [k + 1] */
    far_end(&here, chain);
    for (int64_t j = k; j >= 0; j--) {
        loose[j] = add_bar(&here, offset[j], slope[j]);
        if (j == 0) break;
        held[j - 1] = add_node(&here, &other, up[j - 1], down[j - 1]);
        Curve swap = here;
        here = other, other = swap;
    }
    /* where the last curve has the tension or the displacement of the drive */
    const double *known = chain->force_driven ? here.t : here.w;
    int64_t m = 1;
    while (m < here.size - 1 && known[m] < drive) m++;
    double width = known[m] - known[m - 1], share = width > 0.0 ? (drive - known[m - 1]) / width : 1.0;
    double pull = here.t[m - 1] + share * (here.t[m] - here.t[m - 1]);
    double left = here.w[m - 1] + share * (here.w[m] - here.w[m - 1]);
    if (pull > 0.0 && !(fabs(left) < 0.5 * FAR_M && pull < 0.5 * FAR_N)) return 0;
    for (int64_t j = 0; j < k; j++) { /* the way back to the far end */
        tension[j] = fmax(pull, 0.0);
        moved[j] = pull > 0.0 ? left - offset[j] - slope[j] * pull : loose[j];
        int below = pull <= held[j].low + EDGE * pull, above = pull >= held[j].high - EDGE * pull;
        if (!below && !above) {
            moved[j] = 0.0, pull = held[j].rest;
        } else {
            if (below != above) moved[j] = below ? fmin(moved[j], 0.0) : fmax(moved[j], 0.0);
            const double *law = moved[j] < 0.0 || !above ? down[j] : up[j];
            pull = (pull - law[1] - law[2] * moved[j]) / law[0];
        }
        left = moved[j];
    }
    tension[k] = fmax(pull, 0.0);
    return 1;
}
