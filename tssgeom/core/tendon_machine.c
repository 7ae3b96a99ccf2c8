/* Several tendons on one mechanism: its coordinates are where all forces balance; docs/model.md (171)-(175).

   Every tendon is given where both of its ends are and answers with both tensions and their slopes; the
   coordinates of the mechanism follow by Newton's method. */
#include "tendon_machine.h"

#include <string.h>

/* Tensions at both ends [N], and their derivatives by the position of the drive and of the load [N/m]. */
typedef struct {
    double in, out, in_by_in, in_by_out, out_by_in, out_by_out;
} end_forces;

/* Stretch per tension of one bar [m/N]; 0 where nothing of it moves. */
static double softness(const bar_chain *c, int64_t j) {
    return c->stiffness[j] > 0.0 ? 1.0 / c->stiffness[j] : 0.0;
}

/* Ratio of the tensions behind and before a contact, and its friction for each metre that it moves; returns
   whether it moves at all. */
static int moves(const bar_chain *c, int64_t i, double *ratio, double *drag) {
    *ratio = c->slip[i] == PULLED ? c->low[i] : c->slip[i] == RELEASED ? c->high[i] : 1.0;
    *drag = c->slip[i] == STUCK ? c->bristle[i] : c->drag[i];
    return *drag < INFINITY;
}

/* Slopes of both tensions: a contact that moves passes a change on, one that does not ends it; (174), (280). */
static end_forces slopes_of(const bar_chain *c, int by_force) {
    int64_t k = c->k, first = 0, last = k - 1; /* contacts that do not move, the nearest to drive and load */
    end_forces f = {.in = c->tension[0], .out = c->tension[k]};
    double ratio, drag, share = 1.0, sides = 1.0;
    while (first < k && moves(c, first, &ratio, &drag)) first++;
    while (last >= 0 && moves(c, last, &ratio, &drag)) last--;
    if (!by_force && f.in > 0.0) { /* as the drive feels it */
        double soft = softness(c, first);
        for (int64_t i = first - 1; i >= 0; i--) {
            moves(c, i, &ratio, &drag);
            double behind = ratio / (1.0 / soft + drag);
            soft = softness(c, i) + behind;
            share *= softness(c, i) == 0.0 ? behind > 0.0 : behind / soft;
            sides *= ratio;
        }
        f.in_by_in = 1.0 / soft;
        if (first < k) share = 0.0;
        if (share > 0.0) f.out_by_in = share / softness(c, k), f.in_by_out = -f.out_by_in / sides;
    }
    if (f.out > 0.0) { /* as the load feels it */
        double soft = last >= 0 ? softness(c, last + 1) : by_force ? INFINITY : softness(c, 0);
        for (int64_t i = last + 1; i < k; i++) {
            moves(c, i, &ratio, &drag);
            soft = softness(c, i + 1) + 1.0 / (ratio / soft + drag);
        }
        f.out_by_out = -1.0 / soft;
    }
    return f;
}

/* Bring one tendon to a trial of the coordinates; returns whether it is in equilibrium. */
static int try_tendon(const sample *it, int64_t i, const double z[], end_forces *f) {
    int64_t k = it->k, size = 9 * (k + 1) + 7, solves;
    const double *before = it->before + i * size;
    double *block = it->trial + i * size, drive = it->drive[i], end = it->end[i];
    for (int64_t j = 0; j < it->m; j++) {
        drive += it->proximal[i * it->m + j] * z[j];
        end += it->distal[i * it->m + j] * z[j];
    }
    memcpy(block, before, memory_bytes(k));
    bar_laws laws = laws_of(k, it->plant + i * (17 * (k + 1) + 430));
    bar_memory memory = memory_of(k, block);
    step_room room = room_of(k, it->work);
    begin_room(&laws, &room);
    if (laws.speed_memory > 0.0) room.taken = it->taken + i * (k + 1), room.taken_given = 1;
    double target = drive, engaged = memory.held[HELD.engaged];
    if (!it->by_force) target = least(drive + laws.backlash, most(drive, engaged)); /* docs/model.md (59) */
    memory.held[HELD.time] += it->span;
    if (laws.worn) set_step_factor(&laws, &memory, memory.held[HELD.time]);
    for (int64_t j = 0; j <= k; j++) it->rest[j] = laws.rest[j] + memory.rest[j];
    it->rest[k] -= end; /* docs/model.md (172) */
    double change =
        balance(&laws, &memory, &room, it->by_force, target, 0.0, it->warmth, it->span, it->rest, &solves);
    if (!(change <= 1e2 * SOLVER.accepted)) return 0;
    memory.held[HELD.engaged] = target, memory.held[HELD.drive] = drive;
    *f = slopes_of(&room.chain, it->by_force);
    if (target == engaged && laws.backlash > 0.0) f->in_by_in = f->out_by_in = 0.0;
    return 1;
}

double held_by(const double law[], double z) {
    const double *table = table_of(law + 3, 0);
    double slope, more = table ? table_value(table, z, &slope) : 0.0;
    return law[0] * (sin(z + law[1]) - sin(law[1])) + law[2] * z * z * z + more;
}

double held_slope(const double law[], double z) {
    const double *table = table_of(law + 3, 0);
    double slope = 0.0;
    if (table) table_value(table, z, &slope);
    return law[0] * cos(z + law[1]) + 3.0 * law[2] * z * z + slope;
}

/* Forces that are left on the coordinates [m], and their derivatives [m][m]; docs/model.md (173). */
static int try_all(const sample *it, const double z[], double left[], double slope[], double *scale) {
    int64_t m = it->m;
    *scale = 1e-9;
    for (int64_t a = 0; a < m; a++) {
        double spring = it->stiffness[a] * z[a], weight = held_by(it->holds + HOLDS * a, z[a]);
        left[a] = -it->at_rest[a] - it->load[a] - it->slides - spring - weight;
        *scale = most(*scale, fabs(it->at_rest[a]) + fabs(spring) + fabs(weight)); /* where all tendons are slack */
        for (int64_t b = 0; b < m; b++)
            slope[a * m + b] = a == b ? -it->stiffness[a] - held_slope(it->holds + HOLDS * a, z[a]) : 0.0;
    }
    for (int64_t i = 0; i < it->n; i++) {
        end_forces f;
        if (!try_tendon(it, i, z, &f)) return 0;
        const double *in = it->proximal + i * m, *out = it->distal + i * m;
        for (int64_t a = 0; a < m; a++) {
            *scale = most(*scale, fabs(out[a] * f.out) + fabs(in[a] * f.in) + fabs(it->load[a]));
            left[a] += out[a] * f.out - in[a] * f.in;
            for (int64_t b = 0; b < m; b++)
                slope[a * m + b] += out[a] * (f.out_by_in * in[b] + f.out_by_out * out[b])
                                    - in[a] * (f.in_by_in * in[b] + f.in_by_out * out[b]);
        }
    }
    return 1;
}

void solve_step(int64_t m, double slope[], double left[], double step[]) {
    for (int64_t a = 0; a < m; a++) {
        int64_t pivot = a;
        for (int64_t b = a + 1; b < m; b++)
            if (fabs(slope[b * m + a]) > fabs(slope[pivot * m + a])) pivot = b;
        for (int64_t b = 0; b < m; b++) {
            double kept = slope[a * m + b];
            slope[a * m + b] = slope[pivot * m + b], slope[pivot * m + b] = kept;
        }
        double kept = left[a];
        left[a] = left[pivot], left[pivot] = kept;
        if (slope[a * m + a] == 0.0) continue;
        for (int64_t b = a + 1; b < m; b++) {
            double factor = slope[b * m + a] / slope[a * m + a];
            for (int64_t j = a; j < m; j++) slope[b * m + j] -= factor * slope[a * m + j];
            left[b] -= factor * left[a];
        }
    }
    for (int64_t a = m - 1; a >= 0; a--) {
        double sum = -left[a];
        for (int64_t j = a + 1; j < m; j++) sum -= slope[a * m + j] * step[j];
        step[a] = slope[a * m + a] != 0.0 ? sum / slope[a * m + a] : 0.0;
    }
}

static double largest(int64_t m, const double left[]) {
    double result = 0.0;
    for (int64_t a = 0; a < m; a++) result = most(result, fabs(left[a]));
    return result;
}

/* Go along a Newton step to where the forces along it have fallen by half, which they do: the map is monotone;
   docs/model.md (175). Returns whether there is such a point: `next`, with the forces left there. */
static int along(
    const sample *it, const double z[], const double step[], double next[], double left[], double slope[],
    double *scale) {
    double first = row_dot(it->m, left, step), low = 0.0, high = INFINITY, at_low = first, share = 1.0;
    if (!(first > 0.0)) return 0;
    for (int64_t cut = 0; cut < SOLVER.trials; cut++) {
        for (int64_t a = 0; a < it->m; a++) next[a] = z[a] + share * step[a];
        double rate = try_all(it, next, left, slope, scale) ? row_dot(it->m, left, step) : -INFINITY;
        if (fabs(rate) <= 0.5 * first) return 1;
        if (rate > 0.0) low = share, at_low = rate;
        else high = share;
        if (!(high < INFINITY)) share *= 2.0;
        else {
            double part = isfinite(rate) ? at_low / (at_low + fabs(rate)) : 0.5;
            share = low + within(part, 0.1, 0.9) * (high - low);
        }
    }
    return 0;
}

/* Balance the coordinates with friction at the speeds that are followed; docs/model.md (175). */
static int solve_at_speeds(const sample *it, double z[]) {
    int64_t m = it->m;
    double left[MOST], slope[MOST * MOST], step[MOST] = {0.0}, next[MOST], held[MOST], scale;
    double low = -INFINITY, high = INFINITY; /* of one coordinate: its force is above 0, and below */
    double reach = SOLVER.reach;
    if (!try_all(it, z, left, slope, &scale)) return 0;
    sample moving = *it;
    if (it->friction > 0.0) { /* one coordinate; docs/model.md (195) */
        if (fabs(left[0]) <= it->friction) return 1;
        moving.slides = copysign(it->friction, left[0]);
        left[0] -= moving.slides;
        it = &moving;
    }
    for (int64_t turn = 0; turn < SOLVER.trials; turn++) {
        double worst = largest(m, left), most_left = 1e3 * ROUNDING.relative * scale;
        if (worst <= ROUNDING.relative * scale) return 1;
        if (m == 1 && left[0] > 0.0) low = most(low, z[0]);
        if (m == 1 && left[0] < 0.0) high = least(high, z[0]);
        memcpy(held, left, sizeof held);
        solve_step(m, slope, held, step);
        if (m > 1) {
            if (!along(it, z, step, next, left, slope, &scale)) return worst <= most_left;
            memcpy(z, next, (size_t)m * sizeof(double));
            continue;
        }
        next[0] = z[0] + step[0];
        if (step[0] == 0.0) next[0] = z[0] + (worst > 0.0 && low >= z[0] ? 1.0 : -1.0);
        if (!(low < next[0] && next[0] < high)) { /* a weight turns over; docs/model.md (335) */
            next[0] = low > -INFINITY && high < INFINITY ? 0.5 * (low + high) : z[0] + copysign(reach, left[0]);
            reach *= 2.0;
        }
        if (!isfinite(next[0]) || !try_all(it, next, left, slope, &scale)) return 0;
        if (next[0] == z[0]) break;
        z[0] = next[0];
    }
    return largest(m, left) <= 1e3 * ROUNDING.relative * scale;
}

/* Take friction at the speeds that it would follow if all contacts moved as the drive does [m/s]. */
static void guess_speeds(const sample *it, const double z[]) {
    int64_t k = it->k, b = k + 1;
    for (int64_t i = 0; i < it->n; i++) {
        bar_laws laws = laws_of(k, it->plant + i * (17 * b + 430));
        bar_memory before = memory_of(k, (double *)it->before + i * (9 * b + 7));
        double drive = it->drive[i], engaged = before.held[HELD.engaged];
        for (int64_t a = 0; a < it->m; a++) drive += it->proximal[i * it->m + a] * z[a];
        double pulled = (least(drive + laws.backlash, most(drive, engaged)) - engaged) / it->span;
        for (int64_t c = 0; c < k; c++) {
            double was = before.speed[c];
            it->taken[i * b + c] = fabs(it->by_force ? was : followed_speed(&laws, was, pulled, it->span));
        }
    }
}

int solve_balance(const sample *it, double z[]) {
    int64_t k = it->k, b = k + 1, size = 9 * b + 7;
    bar_laws laws = laws_of(k, it->plant); /* all tendons have one law of speed */
    speed_search search = search_speeds(&laws);
    if (search.close < 0.0) return solve_at_speeds(it, z);
    double start = z[0];
    guess_speeds(it, z);
    for (int64_t pass = 0; pass < SOLVER.full_passes; pass++) {
        if (it->friction > 0.0) z[0] = start; /* it holds where the sample began */
        if (!solve_at_speeds(it, z)) return 0;
        const double *followed = it->trial + MEMORY.speed * b;
        for (int64_t i = 0; i < it->n; i++) compare_speeds(&search, k, it->taken + i * b, followed + i * size);
        if (!go_on(&search)) break;
        for (int64_t i = 0; i < it->n; i++) renew_speeds(&search, k, it->taken + i * b, followed + i * size);
    }
    return 1;
}

void read_ends(const sample *it, const double z[], double ends[]) {
    int64_t k = it->k, m = it->m;
    double unused;
    for (int64_t i = 0; i < it->n; i++) {
        bar_memory kept = memory_of(k, it->trial + i * (9 * (k + 1) + 7));
        double *row = ends + 4 * i, moved = it->end[i], pulled = it->drive[i];
        for (int64_t a = 0; a < m; a++)
            moved += it->distal[i * m + a] * z[a], pulled += it->proximal[i * m + a] * z[a];
        if (it->by_force) {
            bar_laws laws = laws_of(k, it->plant + i * (17 * (k + 1) + 430));
            pulled = kept.displacement[0] + stretch_of(&laws, 0, kept.tension[0], &unused) - laws.rest[0]
                     - kept.rest[0];
        }
        row[0] = kept.tension[0], row[1] = kept.tension[k], row[2] = pulled, row[3] = moved;
    }
}

/** Take n tendons on one mechanism of m ≤ 4 coordinates through the samples of a run; docs/model.md (171)-(175).

`proximal`, `distal` [n, m] are how far the drive and the load of each tendon move with each coordinate, for 1
of it [m]; `stiffness` [m], `holds` [m, 40] (greatest force, angle where the coordinate is 0, force
over its cube, and a table of force over it), `friction` [m] (of one coordinate alone) and `at_rest` [m] are the forces that hold the coordinates;
`start` [m] is where they are. `drive` [s, n] is where each drive is besides [m], or `by_force` its tension [N],
`end` [s, n] where each load is besides [m], `load` [s, m] what acts against each coordinate. A memory's row `rest` is added to that of its plant. Returns the number of samples
done, the memories after them, the coordinates, T_in, T_out [N], x_in, x_out [m] of each tendon, and, where
`rows` is s and not 0, the tension of each bar of each tendon [N]. */
ENTRY int64_t tss_march_machine(
    int64_t n, int64_t k, const double plant[n][17 * (k + 1) + 430], const double memory[n][9 * (k + 1) + 7],
    int64_t m, const double proximal[n][m], const double distal[n][m], const double stiffness[m],
    const double holds[m][40], const double friction[m], const double at_rest[m], const double start[m],
    int64_t by_force, int64_t s,
    const double spans[s], const double drive[s][n], const double end[s][n], const double load[s][m],
    const double warmth[s], int64_t rows, OUT double after[n][9 * (k + 1) + 7], OUT double coordinate[s][m],
    OUT double ends[s][4 * n], OUT double profile[rows][n * (k + 1)], WORK double trial[n][9 * (k + 1) + 7], WORK double work[21 + n][k + 1]) {
    double z[MOST] = {0.0}, *turned = *coordinate, *read_out = *ends;
    for (int64_t i = 0; i < s * m; i++) turned[i] = NAN;
    for (int64_t i = 0; i < 4 * s * n; i++) read_out[i] = NAN;
    memcpy(*after, *memory, (size_t)n * memory_bytes(k));
    double *tensions = *profile;
    for (int64_t i = 0; i < rows * n * (k + 1); i++) tensions[i] = NAN;
    if (k < 2 || n < 1 || m > MOST || (rows != 0 && rows != s)) return 0;
    for (int64_t a = 0; a < m; a++) z[a] = start[a];
    for (int64_t g = 0; g < s; g++) {
        double sum = spans[g] + warmth[g];
        for (int64_t i = 0; i < n; i++) sum += drive[g][i] + end[g][i];
        for (int64_t a = 0; a < m; a++) sum += load[g][a];
        if (!isfinite(sum)) return g;
        sample it = {
            n, k, m, *plant, *proximal, *distal, stiffness, *holds, at_rest, drive[g], end[g], load[g],
            (int)by_force, m == 1 ? friction[0] : 0.0, 0.0, most(BAR.least_time, spans[g]), warmth[g], *after, *trial, work[20], work[0], work[21]};
        if (!solve_balance(&it, z)) return g;
        memcpy(*after, *trial, (size_t)n * memory_bytes(k));
        for (int64_t a = 0; a < m; a++) coordinate[g][a] = z[a];
        read_ends(&it, z, ends[g]);
        if (rows > 0)
            for (int64_t i = 0; i < n; i++)
                memcpy(profile[g] + i * (k + 1), after[i], (size_t)(k + 1) * sizeof(double));
    }
    return s;
}

/** Step c machines of n tendons, whose plants are straight lines over d numbers; docs/model.md (201), (175).

`slope` [d] is what 1 of each number adds to the plants of all tendons, `shift` [c, d] how far the numbers of each
machine are from those of the plants. Machine j begins with the memory in `row[j]` of w. All else is as for `march_machine`, for one sample and with a row for each
machine. Returns how many were stepped, fewer where one finds no equilibrium; the memories of the tendons; the
coordinates; and T_in, T_out [N], x_in, x_out [m] of each tendon. */
ENTRY int64_t tss_step_machines(
    int64_t w, int64_t c, int64_t n, int64_t k, int64_t d, const double plant[n][17 * (k + 1) + 430],
    const double slope[d][n * (17 * (k + 1) + 430)], const double shift[c][d],
    const double memory[w][n * (9 * (k + 1) + 7)], const int64_t row[c], int64_t m, const double proximal[c][n * m],
    const double distal[c][n * m], const double stiffness[c][m], const double holds[c][40 * m],
    const double friction[c], const double at_rest[c][m], const double start[c][m], int64_t by_force,
    const double drive[c][n], const double end[c][n], const double load[c][m], double span, double warmth,
    OUT double after[c][n * (9 * (k + 1) + 7)], OUT double coordinate[c][m], OUT double ends[c][4 * n],
    WORK double own[n][17 * (k + 1) + 430], WORK double work[21 + n][k + 1]) {
    int64_t size = 17 * (k + 1) + 430;
    if (k < 2 || n < 1 || m > MOST || !isfinite(span + warmth)) return 0;
    for (int64_t j = 0; j < c; j++) {
        double sum = 0.0;
        for (int64_t i = 0; i < n; i++) sum += drive[j][i] + end[j][i];
        for (int64_t a = 0; a < m; a++) sum += load[j][a], coordinate[j][a] = start[j][a];
        if (!isfinite(sum) || row[j] < 0 || row[j] >= w) return j;
        for (int64_t i = 0; i < n; i++) {
            set_plant(k, d, plant[i], *slope + i * size, n * size, shift[j], own[i]);
            set_cones_of(k, own[i]);
        }
        sample it = {
            n, k, m, *own, proximal[j], distal[j], stiffness[j], holds[j], at_rest[j], drive[j], end[j],
            load[j], (int)by_force, m == 1 ? friction[j] : 0.0, 0.0, most(BAR.least_time, span), warmth,
            memory[row[j]], after[j], work[20], work[0], work[21]};
        if (!solve_balance(&it, coordinate[j])) return j;
        read_ends(&it, coordinate[j], ends[j]);
    }
    return c;
}
