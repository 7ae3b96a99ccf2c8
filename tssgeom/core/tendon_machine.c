/* Several tendons on one mechanism: its coordinates are where all forces balance; docs/model.md (171)-(175).

   Every tendon is given where both of its ends are and answers with both tensions and their slopes; the
   coordinates of the mechanism follow by Newton's method. */
#include "tendon_machine.h"

#include <string.h>

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

/* How the forces that are left follow from the coordinates [m][m], and where asked for by how much they are changed
   from those of the sample before by what acts [m]. */
static void follow_forces(const sample *it, const double z[], double slope[], double changed[]) {
    int64_t n = it->n, m = it->m;
    for (int64_t a = 0; a < m; a++) {
        for (int64_t b = 0; b < m; b++)
            slope[a * m + b] = a == b ? -it->stiffness[a] - held_slope(it->holds + HOLDS * a, z[a]) : 0.0;
        if (changed) changed[a] = (it->load - m)[a] - it->load[a];
    }
    for (int64_t i = 0; i < n; i++) {
        end_forces f = it->tendons[i].forces;
        const double *in = it->proximal + i * m, *out = it->distal + i * m;
        for (int64_t a = 0; a < m; a++) {
            for (int64_t b = 0; b < m; b++)
                slope[a * m + b] += out[a] * (f.out_by_in * in[b] + f.out_by_out * out[b])
                                    - in[a] * (f.in_by_in * in[b] + f.in_by_out * out[b]);
            if (!changed) continue;
            double drive = it->drive[i] - (it->drive - n)[i], end = it->end[i] - (it->end - n)[i];
            changed[a] += out[a] * (f.out_by_in * drive + f.out_by_out * end)
                          - in[a] * (f.in_by_in * drive + f.in_by_out * end);
        }
    }
}

/* Forces that are left on the coordinates [m], and their derivatives [m][m]; docs/model.md (173). */
static int try_all(const sample *it, const double z[], double left[], double slope[], double *scale) {
    int64_t m = it->m;
    *scale = 1e-9;
    for (int64_t a = 0; a < m; a++) {
        double spring = it->stiffness[a] * z[a], weight = held_by(it->holds + HOLDS * a, z[a]);
        left[a] = -it->at_rest[a] - it->load[a] - it->slides - spring - weight;
        *scale = most(*scale, fabs(it->at_rest[a]) + fabs(spring) + fabs(weight)); /* where all tendons are slack */
    }
    for (int64_t i = 0; i < it->n; i++) {
        if (!try_tendon(it, i, z)) return 0;
        end_forces f = it->tendons[i].forces;
        const double *in = it->proximal + i * m, *out = it->distal + i * m;
        for (int64_t a = 0; a < m; a++) {
            *scale = most(*scale, fabs(out[a] * f.out) + fabs(in[a] * f.in) + fabs(it->load[a]));
            left[a] += out[a] * f.out - in[a] * f.in;
        }
    }
    follow_forces(it, z, slope, NULL);
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
        const bar_laws *laws = &it->tendons[i].laws;
        bar_memory before = memory_of(k, (double *)it->before + i * (9 * b + 7));
        double drive = it->drive[i], engaged = before.held[HELD.engaged];
        for (int64_t a = 0; a < it->m; a++) drive += it->proximal[i * it->m + a] * z[a];
        double speed = (least(drive + laws->backlash, most(drive, engaged)) - engaged) / it->span;
        for (int64_t c = 0; c < k; c++) {
            double was = before.speed[c];
            it->taken[i * b + c] = fabs(it->by_force ? was : followed_speed(laws, was, speed, it->span));
        }
    }
}

/* Move the coordinates to where all forces balance, from where they are; returns whether they do. */
static int solve_from(const sample *it, double z[]) {
    int64_t k = it->k, b = k + 1, size = 9 * b + 7;
    speed_search search = search_speeds(&it->tendons[0].laws); /* all tendons have one law of speed */
    if (search.close < 0.0) return solve_at_speeds(it, z) && keep_trial(it);
    double start = z[0];
    guess_speeds(it, z);
    for (int64_t pass = 0; pass < SOLVER.full_passes; pass++) {
        if (it->friction > 0.0) z[0] = start; /* it holds where the sample began */
        if (!solve_at_speeds(it, z) || !keep_trial(it)) return 0;
        const double *followed = it->trial + MEMORY.speed * b;
        for (int64_t i = 0; i < it->n; i++) compare_speeds(&search, k, it->taken + i * b, followed + i * size);
        if (!go_on(&search)) break;
        for (int64_t i = 0; i < it->n; i++) renew_speeds(&search, k, it->taken + i * b, followed + i * size);
    }
    return 1;
}

int solve_balance(const sample *it, double z[]) {
    int64_t m = it->m;
    double slope[MOST * MOST], changed[MOST], step[MOST] = {0.0}, start[MOST];
    int alone = it->goes_on && !(it->friction > 0.0); /* there is one balance: what holds grows everywhere */
    for (int64_t a = 0; a < m; a++) {
        const double *law = it->holds + HOLDS * a;
        alone &= it->stiffness[a] > 0.0 && law[0] == 0.0 && law[3] == 0.0;
    }
    if (!alone) return solve_from(it, z);
    memcpy(start, z, (size_t)m * sizeof(double));
    follow_forces(it, z, slope, changed);
    solve_step(m, slope, changed, step); /* docs/model.md (347) */
    for (int64_t a = 0; a < m; a++) z[a] += step[a];
    if (solve_from(it, z)) return 1;
    memcpy(z, start, (size_t)m * sizeof(double));
    return solve_from(it, z);
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
    OUT double ends[s][4 * n], OUT double profile[rows][n * (k + 1)], WORK double trial[n][9 * (k + 1) + 7],
    WORK double room[n][96], WORK double work[1 + 22 * n][k + 1]) {
    double z[MOST] = {0.0}, *turned = *coordinate, *read_out = *ends;
    for (int64_t i = 0; i < s * m; i++) turned[i] = NAN;
    for (int64_t i = 0; i < 4 * s * n; i++) read_out[i] = NAN;
    memcpy(*after, *memory, (size_t)n * memory_bytes(k));
    double *tensions = *profile;
    for (int64_t i = 0; i < rows * n * (k + 1); i++) tensions[i] = NAN;
    if (k < 2 || n < 1 || m > MOST || (rows != 0 && rows != s)) return 0;
    for (int64_t a = 0; a < m; a++) z[a] = start[a];
    pulled *tendons = begin_tendons(n, k, *plant, *room, work[1 + n]);
    for (int64_t g = 0; g < s; g++) {
        double sum = spans[g] + warmth[g];
        for (int64_t i = 0; i < n; i++) sum += drive[g][i] + end[g][i];
        for (int64_t a = 0; a < m; a++) sum += load[g][a];
        if (!isfinite(sum)) return g;
        sample it = {
            n, k, m, *plant, *proximal, *distal, stiffness, *holds, at_rest, drive[g], end[g], load[g],
            (int)by_force, m == 1 ? friction[0] : 0.0, 0.0, most(BAR.least_time, spans[g]), warmth[g], *after, *trial, work[0], work[1], tendons, g > 0};
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
    WORK double own[n][17 * (k + 1) + 430], WORK double room[n][96], WORK double work[1 + 22 * n][k + 1]) {
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
            memory[row[j]], after[j], work[0], work[1], begin_tendons(n, k, *own, *room, work[1 + n]), 0};
        if (!solve_balance(&it, coordinate[j])) return j;
        read_ends(&it, coordinate[j], ends[j]);
    }
    return c;
}
