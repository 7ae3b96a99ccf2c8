/* One step of a tendon in a sheath: linear finite elements, bristles at two Gauss points of each.
 *
 * Unknown are the movements u of the nodes [m], positive towards the drive. An element has the strain of its two
 * ends, less what it stretches without force, and the tension of a table. A bristle is a spring from the tendon to
 * the sheath with a foot that slips where its force is at the limit: what rubs is mu kappa T of the element. Feet move
 * only then, so that a tendon at rest stays at rest. Nodes may have one bristle more of a fixed limit, one node has
 * the load, a table of force over movement. Newton steps on the tridiagonal system.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "chain.h"

enum { POSITION = 0, FORCE = 1, SPRING = 2, FREE = 3 };
enum { WHOLE = 20, SOFTEST = 8 }; /* Newton steps without halving; half powers of ten that bristles soften */
#define ROOT3 0.57735026918962576

typedef struct {
    double *low, *mid, *high, *left, *step, *tried;
} Room;

/* Value and slope of a table with rising abscissae; straight beyond its ends. */
static double read_table(const double *x, const double *y, int points, double at, double *slope) {
    int low = 0, high = points - 1;
    while (high - low > 1) {
        int mid = (low + high) / 2;
        if (x[mid] <= at) low = mid;
        else high = mid;
    }
    *slope = (y[low + 1] - y[low]) / (x[low + 1] - x[low]);
    return y[low] + *slope * (at - x[low]);
}

/* Force of a bristle on its way to u, and its slopes over u and over the limits. */
static double rub(double trial, double pull, double release, double stiffness, double *over_move, int *side) {
    *side = trial > pull ? 1 : trial < -release ? -1 : 0;
    *over_move = *side ? 0.0 : stiffness;
    return *side > 0 ? pull : *side < 0 ? -release : trial;
}

/* Forces on the nodes [N] (towards the drive), and their slopes over movements; feet move where `work` is given. */
static void balance(const Chain *c, const double *u, const Room *room, double *work,
                    double stiff) {
    int n = c->elements + 1, kinds = c->kinds;
    memset(room->left, 0, sizeof(double) * n);
    memset(room->low, 0, sizeof(double) * n);
    memset(room->mid, 0, sizeof(double) * n);
    memset(room->high, 0, sizeof(double) * n);
    c->ends[2] = c->ends[3] = 0.0;
    for (int e = 0; e < n - 1; e++) {
        double h = c->length[e], slope;
        double strain = c->start_strain[e] + (u[e] - u[e + 1]) / h - c->extra_strain[e];
        double tension = read_table(c->curve_strain, c->curve_tension, c->curve_points, strain, &slope);
        double rate = slope / h; /* of tension over u[e]; of u[e + 1] less */
        c->tension[e] = tension;
        room->left[e] -= tension;
        room->left[e + 1] += tension;
        room->mid[e] -= rate;
        room->high[e] += rate;
        room->low[e + 1] += rate;
        room->mid[e + 1] -= rate;
        double rubbed[2] = {0.0, 0.0};
        for (int q = 0; q < 2; q++) {
            int g = 2 * e + q;
            double b = 0.5 * (q ? 1.0 + ROOT3 : 1.0 - ROOT3), a = 1.0 - b, at = a * u[e] + b * u[e + 1];
            double press = tension > 0.0 ? tension * c->bend[g] : 0.0;
            double pressed = tension > 0.0 ? rate * c->bend[g] : 0.0;
            double pull = c->rub_pull[g] * press + c->rub_straight[g];
            double release = c->rub_release[g] * press + c->rub_straight[g];
            for (int k = 0; k < kinds; k++) {
                int i = g * kinds + k, side;
                double weight = 0.5 * h * c->share[k], over_move, over_tension = 0.0;
                double spring = stiff * c->stiffness[i];
                double force = rub(spring * (at - c->slip[i]), pull, release, spring, &over_move, &side);
                if (side > 0) over_tension = c->rub_pull[g] * pressed;
                if (side < 0) over_tension = -c->rub_release[g] * pressed;
                rubbed[0] += weight * a * force;
                rubbed[1] += weight * b * force;
                room->mid[e] -= weight * a * (over_move * a + over_tension);
                room->high[e] -= weight * a * (over_move * b - over_tension);
                room->low[e + 1] -= weight * b * (over_move * a + over_tension);
                room->mid[e + 1] -= weight * b * (over_move * b - over_tension);
                if (work && side) {
                    double foot = at - force / c->stiffness[i];
                    *work += weight * force * (foot - c->slip[i]);
                    c->slip[i] = foot;
                }
            }
        }
        room->left[e] -= rubbed[0];
        room->left[e + 1] -= rubbed[1];
        if (e + 1 == c->load_node) c->ends[2] = tension - rubbed[1];
        if (e == c->load_node) c->ends[3] = tension + rubbed[0];
    }
    for (int i = 0; i < n; i++) {
        double over_move, limit = c->node_limit[i];
        int side;
        if (limit <= 0.0) continue;
        double spring = stiff * c->node_stiffness[i];
        double force = rub(spring * (u[i] - c->node_slip[i]), limit, limit, spring, &over_move, &side);
        room->left[i] -= force;
        room->mid[i] -= over_move;
        if (work && side) {
            double foot = u[i] - force / c->node_stiffness[i];
            *work += force * (foot - c->node_slip[i]);
            c->node_slip[i] = foot;
        }
    }
    if (c->load_node >= 0) {
        double slope;
        room->left[c->load_node] -=
            read_table(c->load_move, c->load_force, c->load_points, u[c->load_node], &slope);
        room->mid[c->load_node] -= slope;
    }
    /* What an end of known movement needs is the tension there. */
    c->ends[0] = -room->left[0];
    c->ends[1] = room->left[n - 1];
    if (c->drive_mode == FORCE) room->left[0] += c->drive;
    if (c->drive_mode == SPRING) {
        double slope, force = read_table(c->pull_stretch, c->pull_force, c->pull_points, c->drive - u[0], &slope);
        room->left[0] += force;
        room->mid[0] -= slope;
    }
    if (c->drive_mode == POSITION) {
        room->left[0] = room->high[0] = 0.0;
        room->mid[0] = -1.0;
    }
    if (c->far_mode == POSITION) {
        room->left[n - 1] = room->low[n - 1] = 0.0;
        room->mid[n - 1] = -1.0;
    }
}

static double largest(const double *values, int n) {
    double most = 0.0;
    for (int i = 0; i < n; i++) most = fmax(most, fabs(values[i]));
    return most;
}

static double squares(const double *values, int n) {
    double sum = 0.0;
    for (int i = 0; i < n; i++) sum += values[i] * values[i];
    return sum;
}

/* Solve for the step that takes all forces to zero. */
static void solve(const Room *room, int n) {
    double *mid = room->mid, *right = room->step;
    for (int i = 0; i < n; i++) right[i] = -room->left[i];
    for (int i = 1; i < n; i++) {
        double factor = room->low[i] / mid[i - 1];
        mid[i] -= factor * room->high[i - 1];
        right[i] -= factor * right[i - 1];
    }
    right[n - 1] /= mid[n - 1];
    for (int i = n - 2; i >= 0; i--) right[i] = (right[i] - room->high[i] * right[i + 1]) / mid[i];
}

/* Newton steps: whole ones at first, which change at once which bristles slip, then some with halving. The number
 * of steps, or -1 where `most` are not enough. */
static int balanced(const Chain *c, const Room *room, int most, double tolerance, double stiff) {
    int n = c->elements + 1;
    double *u = c->move;
    balance(c, u, room, NULL, stiff);
    for (int k = 0; k <= most; k++) {
        if (largest(room->left, n) < tolerance) return k;
        double before = squares(room->left, n), part = 1.0;
        solve(room, n);
        for (;; part *= 0.5) {
            for (int i = 0; i < n; i++) room->tried[i] = u[i] + part * room->step[i];
            balance(c, room->tried, room, NULL, stiff);
            if (k < WHOLE || part < 1e-3 || squares(room->left, n) < before) break;
        }
        memcpy(u, room->tried, sizeof(double) * n);
    }
    return -1;
}

/* Take the chain to the next balance; the number of Newton steps, or -1 where `most` are not enough. Where whole
 * bristles flip to and fro, soft ones show the way: they have no corners, and are made stiffer by tens. Nothing
 * but `move`, `tension` and `ends` has changed where it fails. */
int bristle_step(const Chain *c, int most, double tolerance) {
    int n = c->elements + 1, done;
    double *all = calloc((size_t)n * 7, sizeof(double));
    if (!all) return -2;
    Room room = {all, all + n, all + 2 * n, all + 3 * n, all + 4 * n, all + 5 * n};
    double *start = all + 6 * n;
    if (c->drive_mode == POSITION) c->move[0] = c->drive;
    if (c->far_mode == POSITION) c->move[n - 1] = c->far;
    memcpy(start, c->move, sizeof(double) * n);
    done = balanced(c, &room, most, tolerance, 1.0);
    if (done < 0) {
        memcpy(c->move, start, sizeof(double) * n);
        for (int power = SOFTEST; power >= 0; power--) {
            int steps = balanced(c, &room, most, tolerance, pow(10.0, -0.5 * power));
            done = steps < 0 ? -1 : done < 0 ? steps : done + steps;
        }
    }
    if (done >= 0) balance(c, c->move, &room, c->work, 1.0);
    free(all);
    return done;
}
