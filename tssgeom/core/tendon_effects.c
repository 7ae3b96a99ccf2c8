/* What effects make of a route and of both ends: contacts, dead zone, front, standard errors, lags. */
#include "tendon_bars.h"

#include <string.h>

/* Accumulated curve angle at an arc length of a route; φ is linear between the ends of its pieces. */
static double angle_at(int64_t p, const double length[], const double angle[], double s) {
    double begin = 0.0, phi = 0.0;
    for (int64_t i = 0; i < p; i++) {
        if (s < begin + length[i]) return phi + (s - begin) * (angle[i] / length[i]);
        begin += length[i], phi += angle[i];
    }
    return phi;
}

void set_contacts(int64_t k, double *plant, const double angle[]) {
    int64_t b = k + 1;
    double friction = plant[LAW_ROWS * b + PLANT.friction], asymmetry = plant[LAW_ROWS * b + PLANT.asymmetry];
    for (int64_t i = 0; i < k; i++) { /* docs/model.md (41), (52) */
        double base = friction * angle[i], fitting = plant[LAW.fitting * b + i];
        double pulling = base * (1.0 + asymmetry), releasing = base * (1.0 - asymmetry);
        plant[LAW.pulling * b + i] = pulling, plant[LAW.low * b + i] = exp(-pulling - fitting);
        plant[LAW.releasing * b + i] = releasing, plant[LAW.high * b + i] = exp(releasing + fitting);
    }
}

void put_on_route(
    int64_t k, const double edge[], double *plant, int64_t p, const double length[], const double angle[],
    int64_t m, const double bends[][3], double *pieces, double *work) {
    int64_t b = k + 1, room = p + 2 * m;
    double *number = plant + LAW_ROWS * b, *saved = plant + LAW.saved * b;
    if (m > 0) { /* docs/model.md (60) */
        p = add_bends(
            p, length, angle, m, bends, (double *[2]){pieces, pieces + room},
            (double *[2]){pieces + 2 * room, pieces + 3 * room});
        length = pieces, angle = pieces + room;
    }
    double gain = number[PLANT.curvature_gain], clearance = number[PLANT.clearance], before = 0.0;
    saved[0] = saved[k] = 0.0;
    double whole = total(p, length);
    for (int64_t j = 1; j < k; j++) { /* docs/model.md (58) */
        double here = clearance == 0.0 ? 0.0 : angle_at(p, length, angle, edge[j] * whole);
        saved[j] = clearance * (here - before);
        before = here;
    }
    const double *tables = tables_of(k, plant), *by_curvature = table_of(tables, CURVE.curvature);
    const double *by_arc = table_of(tables, CURVE.arc);
    double slope;
    if (gain != 0.0 || by_curvature) { /* docs/model.md (53), (185) */
        double *pressing = pieces + 4 * room;
        for (int64_t i = 0; i < p; i++) {
            double curvature = angle[i] / length[i];
            pressing[i] = angle[i] * most(0.0, 1.0 + gain * curvature);
            if (by_curvature) pressing[i] *= table_value(by_curvature, curvature, &slope);
        }
        angle = pressing;
    }
    contact_grid grid = grid_of(k, work);
    discretise(k, edge, p, length, angle, grid);
    for (int64_t i = 0; by_arc && i < k; i++) grid.angle[i] *= table_value(by_arc, edge[i] * whole, &slope);
    set_contacts(k, plant, grid.angle);
}

/** Return a plant with its contacts and saved paths as a route makes them; docs/model.md (52)-(60). */
ENTRY void tss_plant_on_route(
    int64_t k, const double edge[k], const double plant[17 * (k + 1) + 430], int64_t p, const double length[p],
    const double angle[p], int64_t m, const double bends[m][3], OUT double after[17 * (k + 1) + 430],
    WORK double pieces[5][p + 2 * m], WORK double work[4][k]) {
    memcpy(after, plant, plant_bytes(k));
    if (k > 1 && p > 0) put_on_route(k, edge, after, p, length, angle, m, bends, pieces[0], work[0]);
}

/** Return the proximal tension from which on a slow pull (+1) or release (−1) moves the load [N].

`tension_out` is the distal tension then [N]; docs/model.md (122). */
ENTRY double tss_answering(
    int64_t k, const double plant[17 * (k + 1) + 430], const double memory[9 * (k + 1) + 7],
    double tension_out, int64_t way) {
    bar_laws laws = laws_of(k, plant);
    bar_memory kept = memory_of(k, (double *)memory);
    set_step_factor(&laws, &kept, kept.held[HELD.time]);
    const double *travel = kept.travel;
    double here = tension_out, sign = way > 0 ? 1.0 : -1.0;
    for (int64_t i = k - 1; i >= 0; i--) { /* from load to drive, along the side on which all slides slowly */
        double exponent = (way > 0 ? laws.pulling[i] : laws.releasing[i]) * wear_factor(&laws, travel[i]);
        double far = most(0.0, here + sign * laws.force[i]),
               near = far * exp(sign * (exponent + laws.fitting[i]));
        int64_t searches = laws.loaded && far > 0.0 ? SOLVER.trials : 0;
        for (int64_t search = 0; search < searches; search++) { /* Newton's method on near = far·exp(…) */
            double rise, factor = load_factor(&laws, 0.5 * (near + here), &rise), last = near;
            double wanted = far * exp(sign * (exponent * factor + laws.fitting[i]));
            near -= (near - wanted) / (1.0 - wanted * sign * exponent * 0.5 * rise);
            if (fabs(near - last) <= ROUNDING.single * near) break;
        }
        here = near;
    }
    return here;
}

/* How much of its cone a contact uses, −1 pulled to +1 released; and its exponent then [1]; (123). */
static double used_share(const bar_laws *laws, const bar_memory *memory, int64_t i, double *exponent) {
    double near = memory->tension[i], far = memory->tension[i + 1];
    *exponent = 0.0;
    if (most(far, near) < SOLVER.accepted) return 0.0; /* a loose tendon uses nothing of it */
    double unused;
    double factor = load_factor(laws, 0.5 * (near + far), &unused) * wear_factor(laws, memory->travel[i]);
    *exponent = (far < near ? laws->pulling[i] : laws->releasing[i]) * factor;
    double side = *exponent + laws->fitting[i], whole = far < near ? -expm1(-side) : expm1(side);
    double share = (far - near) / most(1e-300, whole * near + laws->force[i]);
    return laws->by_speed ? share : within(share, -1.0, 1.0);
}

/** Return both ends of a tendon with effects; docs/model.md (121)-(123).

`way` is the direction index ζ, `front` the contacts that slid last. Returns standard error of the elongation
[m] and of T_out [N], width of the dead zone [N], whether the load responded, angle of the slip front [rad]. */
ENTRY void tss_transmit_with_effects(
    int64_t k, const double edge[k], const double plant[17 * (k + 1) + 430],
    const double memory[9 * (k + 1) + 7], int64_t p, const double length[p], const double angle[p],
    const double covariance[2 * p][2 * p], int64_t way, int64_t front, OUT double ends[5],
    WORK double gradient[3][p], WORK double work[4][k]) {
    for (int i = 0; i < 5; i++) ends[i] = NAN;
    if (k < 2 || p == 0) return;
    bar_laws laws = laws_of(k, plant);
    bar_memory kept = memory_of(k, (double *)memory);
    set_step_factor(&laws, &kept, kept.held[HELD.time]);
    const double *by_curvature = table_of(laws.tables, CURVE.curvature);
    const double *by_arc = table_of(laws.tables, CURVE.arc);
    const double *number = plant + LAW_ROWS * (k + 1), *tension = kept.tension;
    double friction = number[PLANT.friction], asymmetry = number[PLANT.asymmetry];
    double *by_length = gradient[0], *by_angle = gradient[1], *pressed = gradient[2];
    double whole = total(p, length), used = 0.0, slope = 0.0, rest = exp(-laws.pretension / laws.saved_scale);
    double passed_by = 0.0;
    for (int64_t i = 0; i < p; i++) { /* slope of ψ in (53) and (185) by the angle [1] */
        double curvature = angle[i] / length[i], turn, factor;
        pressed[i] = 1.0 + 2.0 * number[PLANT.curvature_gain] * curvature;
        if (by_curvature) {
            factor = table_value(by_curvature, curvature, &turn);
            double gain = number[PLANT.curvature_gain] * curvature;
            pressed[i] = pressed[i] * factor + (1.0 + gain) * curvature * turn;
        }
        if (by_arc) pressed[i] *= table_value(by_arc, passed_by + 0.5 * length[i], &turn);
        passed_by += length[i];
        by_length[i] = by_angle[i] = 0.0;
    }
    for (int64_t j = 1; j <= k; j++) { /* bars in the sheath, then what lies between sheath and load */
        int inside = j < k;
        double pull = tension[j], exponent, rise, share = used_share(&laws, &kept, j - 1, &exponent);
        if (exponent > ROUNDING.relative) used = share; /* on a straight stretch as before it */
        double coefficient = friction * (used < 0.0 ? 1.0 + asymmetry : 1.0 - asymmetry);
        slope = load_factor(&laws, pull, &rise) * wear_factor(&laws, kept.travel[j - 1]);
        slope *= used * coefficient;
        stretch_of(&laws, j, pull, &rise);
        if (!inside && laws.load > 0.0) rise -= 1.0 / laws.load;
        double begin = inside ? edge[j - 1] * whole : whole, end = inside ? edge[j] * whole : whole;
        double strain = inside ? (kept.displacement[j - 1] - kept.displacement[j]) / (end - begin) : 0.0;
        double taut = laws.clearance == 0.0 ? 0.0 : laws.clearance * (rest - exp(-pull / laws.saved_scale));
        double start = 0.0, middle = 0.5 * (begin + end);
        for (int64_t i = 0; i < p && start <= end; i++) { /* docs/model.md (123) */
            double stop = start + length[i];
            double overlap = most(0.0, least(stop, end) - most(start, begin)) / length[i];
            double passed = within((middle - start) / length[i], 0.0, 1.0);
            by_length[i] += strain * overlap;
            by_angle[i] += rise * pull * slope * passed * pressed[i] + taut * overlap;
            start = stop;
        }
    }
    double variance = quadratic_form(2 * p, by_length, covariance[0], 2 * p);
    double angle_variance = quadratic_form(p, pressed, covariance[p] + p, 2 * p);
    double tension_in = tension[0], tension_out = tension[k];
    double width = (double)way * (tss_answering(k, plant, memory, tension_out, way) - tension_in);
    int64_t last = k - 1; /* a contact without friction slides by rounding alone */
    while (last > 0 && laws.pulling[last] + laws.fitting[last] <= ROUNDING.relative && laws.force[last] == 0.0)
        last--;
    int replied =
        kept.slip[last] == (double)way
        || width <= SOLVER.accepted * most(1.0, most(tension_out, tension_in)); /* docs/model.md (122) */
    double slid = 0.0;
    if (front == k) slid = total(p, angle);
    else if (front > 0) {
        contact_grid grid = grid_of(k, work[0]);
        discretise(k, edge, p, length, angle, grid);
        slid = grid.mean_angle[front - 1];
    }
    ends[0] = sqrt(most(0.0, variance));
    ends[1] = tension_out * fabs(slope) * sqrt(most(0.0, angle_variance));
    ends[2] = replied ? 0.0 : width, ends[3] = replied, ends[4] = slid;
}

/* Slope at an end, from the spans and slopes of the two nearest stretches. */
static double end_turn(double h, double g, double rise, double next) {
    double turn = ((2.0 * h + g) * rise - h * next) / (h + g);
    if (turn * rise <= 0.0) return 0.0;
    return rise * next < 0.0 && fabs(turn) > 3.0 * fabs(rise) ? 3.0 * rise : turn;
}

/** Return the table of a curve through n ≤ 12 points; docs/model.md (185).

Its slopes are weighted harmonic means of those beside, so that it does not overshoot: Fritsch and Butland, A
method for constructing local monotone piecewise cubic interpolants, SIAM J. Sci. Stat. Comput. 5 (1984). */
ENTRY status tss_table_of(int64_t n, const double x[n], const double y[n], OUT double table[37]) {
    double *at = table + 1, *value = at + TABLE.most, *turn = value + TABLE.most;
    for (int64_t i = 0; i < TABLE.size; i++) table[i] = 0.0;
    if (n < 2 || n > TABLE.most) return WRONG_SIZE;
    for (int64_t i = 0; i < n; i++) at[i] = x[i], value[i] = y[i];
    table[0] = (double)n;
    for (int64_t i = 1; i + 1 < n; i++) {
        double h = x[i] - x[i - 1], g = x[i + 1] - x[i];
        double rise = (y[i] - y[i - 1]) / h, next = (y[i + 1] - y[i]) / g;
        turn[i] = rise * next > 0.0 ? 3.0 * (h + g) / ((2.0 * g + h) / rise + (g + 2.0 * h) / next) : 0.0;
    }
    double h = x[1] - x[0], rise = (y[1] - y[0]) / h;
    turn[0] = turn[n - 1] = rise;
    if (n > 2) {
        turn[0] = end_turn(h, x[2] - x[1], rise, (y[2] - y[1]) / (x[2] - x[1]));
        double last = x[n - 1] - x[n - 2], before = x[n - 2] - x[n - 3];
        turn[n - 1] =
            end_turn(last, before, (y[n - 1] - y[n - 2]) / last, (y[n - 2] - y[n - 3]) / before);
    }
    return DONE;
}

/** Return the values of a table of CURVE, constant beyond its ends; docs/model.md (185). */
ENTRY void tss_tabulated(int64_t s, const double table[37], const double x[s], OUT double values[s]) {
    double slope;
    int sound = table[0] >= 2.0 && table[0] <= (double)TABLE.most;
    for (int64_t i = 0; i < s; i++) values[i] = sound ? table_value(table, x[i], &slope) : NAN;
}

/** Pass samples, straight between, through a lag [s] that stands at `given`, `read`; docs/model.md (62). */
ENTRY void tss_lagged(
    int64_t s, const double values[s], const double spans[s], double lag, double given, double read,
    OUT double out[s]) {
    for (int64_t i = 0; i < s; i++) {
        if (spans[i] > 0.0) { /* docs/model.md (62) */
            double behind = (values[i] - given) / spans[i] * lag;
            read = values[i] - behind + (read - given + behind) * exp(-spans[i] / lag);
        }
        given = values[i];
        out[i] = read;
    }
}
