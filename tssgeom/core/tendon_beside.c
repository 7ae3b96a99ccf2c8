/* Machines that differ little from one that is marched: their contacts do what those of that one do.

   What a step makes of small changes is a straight line, as long as no contact begins or ends to slide. Its
   tridiagonal matrix is that of the equilibrium, so it is factored once for all machines beside; (298). */
#include "tendon_machine.h"

#include <string.h>

/* Rows of the straight line of one tendon: stiffness of each bar [N/m]; of each contact the ratio of the tensions
   and what a friction of 1 N makes of the tension behind it [1], the factors of the matrix, its movement [m]; what
   each bar is stretched without movement beyond what its tension makes [m], and the tension behind each contact that
   moves [N]. Then, by 1 of each coordinate, the movements and the tensions. */
enum { STIFFNESS, SIDE, SHARE, BEFORE, RATIO, INVERSE, MOVED, FREE, BEHIND, TURNED };
enum { ROWS = TURNED + 2 * MOST };

/* One tendon of a machine in a sample, with its drive where it is at some coordinates. */
typedef struct {
    bar_laws laws;
    bar_memory before;
    creep_shares shares[CREEPS];
    double span, drive, target; /* [s]; where the drive is, before and behind its play [m] or [N] */
    int engaged;                /* whether the tendon follows the drive */
    int bent;                   /* whether any bar stretches by more than a straight line */
} placed;
_Static_assert(sizeof(placed) <= 96 * sizeof(double), "room of march_beside");

static placed begin_at(int64_t k, const double *plant, double *memory) {
    placed p = {.laws = laws_of(k, plant), .before = memory_of(k, memory)};
    p.bent = p.laws.curved;
    for (int64_t j = 0; j <= k; j++) p.bent |= p.laws.toe[j] != 0.0 || p.laws.saved[j] != 0.0;
    return p;
}

/* Put a tendon where its drive is in a sample; returns where its load is besides [m]. */
static double place(placed *p, const sample *it, int64_t i, const double z[]) {
    double end = it->end[i], engaged = p->before.held[HELD.engaged];
    p->drive = it->drive[i], p->span = it->span;
    for (int64_t a = 0; a < it->m; a++) {
        p->drive += it->proximal[i * it->m + a] * z[a];
        end += it->distal[i * it->m + a] * z[a];
    }
    p->target = it->by_force ? p->drive : least(p->drive + p->laws.backlash, most(p->drive, engaged));
    p->engaged = it->by_force || p->laws.backlash == 0.0 || p->target != engaged;
    if (p->laws.worn) set_step_factor(&p->laws, &p->before, p->before.held[HELD.time] + it->span);
    for (int e = 0; p->laws.creeps && e < CREEPS; e++) p->shares[e] = creep_after(it->span / p->laws.creep_time[e]);
    return end;
}

/* Set how far each bar would be stretched if no contact moved, beyond what a tension makes of it [k + 1] [m]; and
   where asked for how that grows with the tension [m/N]; docs/model.md (50), (51), (57), (172). */
static void set_free(
    const placed *p, const sample *it, double end, const double tension[], double rest[], double free[],
    double *grows) {
    int64_t k = it->k;
    const bar_laws *laws = &p->laws;
    const double *moved = p->before.displacement, *own = p->before.rest;
    double target = it->by_force ? 0.0 : p->target;
    if (p->laws.creeps) {
        for (int64_t j = 0; j <= k; j++) rest[j] = laws->rest[j] + own[j];
        set_given(laws, &p->before, it->warmth, p->shares, target, rest, free);
    } else {
        free[0] = target - moved[0] + laws->rest[0] + own[0] - laws->warm[0] * it->warmth;
        for (int64_t j = 1; j < k; j++)
            free[j] = moved[j - 1] - moved[j] + laws->rest[j] + own[j] - laws->warm[j] * it->warmth;
        free[k] = moved[k - 1] + laws->rest[k] + own[k] - laws->warm[k] * it->warmth;
    }
    free[k] -= end;
    for (int64_t j = 0; grows && j <= k; j++) grows[j] = laws->soft[j];
    if (!p->bent && !p->laws.creeps) {
        for (int64_t j = 0; j <= k; j++) free[j] -= laws->soft[j] * tension[j];
        return;
    }
    for (int64_t j = 0; j <= k; j++) {
        double slope, stretch = stretch_of(laws, j, tension[j], &slope);
        for (int e = 0; p->laws.creeps && e < CREEPS; e++) {
            double soft = p->shares[e].new * laws->creep_soft[e][j];
            stretch += soft * tension[j], slope += soft;
        }
        free[j] -= stretch;
        if (grows) grows[j] = slope;
    }
}

/* Tension behind a contact that moves by w [N], and its slopes by the tensions before and behind it [1] and by
   w [N/m]; docs/model.md (41), (52)-(56), (279). */
static double
behind_of(const placed *p, int64_t i, double slip, double near, double far, double w, double slope[3]) {
    const bar_laws *laws = &p->laws;
    if (slip == STUCK) {
        double bristle = bristle_of(laws, i);
        slope[0] = 1.0, slope[1] = 0.0, slope[2] = -bristle;
        return near - (p->before.tension[i] - p->before.tension[i + 1]) - bristle * w;
    }
    double side = slip == PULLED ? laws->low[i] : laws->high[i], drag = laws->drag[i] / p->span;
    slope[1] = 0.0, slope[2] = -drag;
    if (laws->varied) {
        double exponent = slip == PULLED ? laws->pulling[i] : laws->releasing[i], rise, speed = 1.0, quick = 0.0;
        if (laws->worn) exponent *= wear_factor(laws, p->before.travel[i]);
        double load = load_factor(laws, 0.5 * (near + far), &rise);
        if (laws->by_speed) {
            double grows = 1.0 / p->span, at = fabs(w) / p->span, before = fabs(p->before.speed[i]);
            if (laws->speed_memory > 0.0)
                at = followed_speed(laws, before, at, p->span), grows *= -expm1(-p->span / laws->speed_memory);
            else if (laws->late) at = before, grows = 0.0;
            speed = speed_factor(laws, fabs(w), p->span, at, grows, &quick);
        }
        side = exp(-slip * (exponent * load * speed + laws->fitting[i]));
        double lever = -slip * side * near * exponent;
        slope[1] = 0.5 * lever * speed * rise;
        slope[2] += lever * load * quick * copysign(1.0, w);
    }
    slope[0] = side + slope[1];
    return side * near - slip * laws->force[i] - drag * w;
}

/* Solve for the movements [k] by changes of what each bar carries without them [k + 1], and set the tensions. */
static void answer(int64_t k, double *line[], const double trial[], const double extra[], double w[], double t[]) {
    for (int64_t i = 0; i < k; i++) w[i] = (line[SIDE][i] * trial[i] - trial[i + 1] + extra[i]) * line[INVERSE][i];
    for (int64_t i = 1; i < k; i++) w[i] -= line[BEFORE][i] * w[i - 1];
    for (int64_t i = k - 2; i >= 0; i--) w[i] -= line[RATIO][i] * w[i + 1];
    t[0] = trial[0] - line[STIFFNESS][0] * w[0], t[k] = trial[k] + line[STIFFNESS][k] * w[k - 1];
    for (int64_t j = 1; j < k; j++) t[j] = trial[j] + line[STIFFNESS][j] * (w[j - 1] - w[j]);
}

static void rows_of(int64_t k, double *block, double *line[]) {
    for (int row = 0; row < ROWS; row++) line[row] = block + row * (k + 1);
}

/* Make a tendon that was marched straight about where it is; `spare` has 3 rows. */
static void straighten(placed *p, const sample *it, int64_t i, const double z[], double *line[], double *spare) {
    int64_t k = it->k;
    double *grows = spare, *extra = spare + (k + 1), *trial = spare + 2 * (k + 1), slope[3];
    bar_memory now = memory_of(k, it->trial + i * (9 * (k + 1) + 7));
    set_free(p, it, place(p, it, i, z), now.tension, extra, line[FREE], grows);
    for (int64_t j = 0; j <= k; j++) {
        line[STIFFNESS][j] = now.tension[j] > 0.0 && grows[j] > 0.0 ? 1.0 / grows[j] : 0.0;
        extra[j] = trial[j] = 0.0;
    }
    if (it->by_force) line[STIFFNESS][0] = 0.0;
    for (int64_t c = 0; c < k; c++) {
        double w = now.displacement[c] - p->before.displacement[c], far = line[STIFFNESS][c + 1], here = 0.0;
        for (int row = SIDE; row <= BEHIND; row++) if (row != FREE) line[row][c] = 0.0;
        line[MOVED][c] = w;
        if (now.slip[c] != STUCK || p->laws.gives) {
            line[BEHIND][c] = behind_of(p, c, now.slip[c], now.tension[c], now.tension[c + 1], w, slope);
            line[SHARE][c] = 1.0 / (1.0 - slope[1]), line[SIDE][c] = slope[0] * line[SHARE][c];
            line[BEFORE][c] = -line[SIDE][c] * line[STIFFNESS][c];
            here = far - line[BEFORE][c] - slope[2] * line[SHARE][c];
        }
        if (c > 0) here -= line[BEFORE][c] * line[RATIO][c - 1];
        if (here > 0.0) line[INVERSE][c] = 1.0 / here, line[RATIO][c] = -far / here, line[BEFORE][c] /= here;
        else line[SIDE][c] = line[SHARE][c] = line[BEFORE][c] = 0.0;
    }
    for (int64_t a = 0; a < it->m; a++) {
        double pulled = p->engaged ? it->proximal[i * it->m + a] : 0.0;
        trial[0] = it->by_force ? pulled : line[STIFFNESS][0] * pulled;
        trial[k] = -line[STIFFNESS][k] * it->distal[i * it->m + a];
        answer(k, line, trial, extra, line[TURNED + 2 * a], line[TURNED + 2 * a + 1]);
    }
}

/* What a tendon beside makes of its differences while the coordinates stay: movements [k], tensions [k + 1]. */
static void differ(
    placed *p, const sample *it, const sample *beside, int64_t i, const double z[], double *line[], double *w,
    double *t, double *spare) {
    int64_t k = it->k;
    double *free = spare, *extra = spare + (k + 1), *trial = spare + 2 * (k + 1), slope[3];
    bar_memory now = memory_of(k, it->trial + i * (9 * (k + 1) + 7));
    set_free(p, beside, place(p, beside, i, z), now.tension, trial, free, NULL);
    for (int64_t j = 0; j <= k; j++) trial[j] = line[STIFFNESS][j] * (free[j] - line[FREE][j]);
    if (it->by_force) trial[0] = p->target - now.tension[0];
    if (p->laws.varied || p->laws.gives)
        for (int64_t c = 0; c < k; c++) {
            if (line[SHARE][c] == 0.0) continue;
            double far = now.tension[c + 1];
            double behind = behind_of(p, c, now.slip[c], now.tension[c], far, line[MOVED][c], slope);
            extra[c] = line[SHARE][c] * (behind - line[BEHIND][c]);
        }
    else
        for (int64_t c = 0; c < k; c++) { /* the same in one sweep */
            double side = now.slip[c] > 0.0 ? p->laws.low[c] : p->laws.high[c];
            double drag = p->laws.drag[c] / p->span * line[MOVED][c];
            double behind = side * now.tension[c] - now.slip[c] * p->laws.force[c] - drag;
            extra[c] = line[SHARE][c] * (behind - line[BEHIND][c]);
        }
    answer(k, line, trial, extra, w, t);
}

/* Forces left on the coordinates z [m] of a machine, with the tensions of one that was marched and by how much
   they are changed: `change` has movements and tensions of each tendon. */
static void left_of(const sample *it, const double *marched, const double z[], const double *change, double left[]) {
    int64_t m = it->m, k = it->k;
    for (int64_t a = 0; a < m; a++) {
        left[a] = -it->at_rest[a] - it->load[a] - it->slides - it->stiffness[a] * z[a]
                  - held_by(it->holds + HOLDS * a, z[a]);
        for (int64_t i = 0; i < it->n; i++) {
            const double *now = marched + i * (9 * (k + 1) + 7), *by = change + (2 * i + 1) * (k + 1);
            left[a] += it->distal[i * m + a] * (now[k] + by[k]) - it->proximal[i * m + a] * (now[0] + by[0]);
        }
    }
}

/* How the forces on the coordinates of a machine that was marched follow from them [m][m]. */
static void forces_of(const sample *it, const double z[], const double *lines, double slope[]) {
    int64_t m = it->m, k = it->k;
    for (int64_t a = 0; a < m; a++)
        for (int64_t b = 0; b < m; b++) {
            double sum = a == b ? -it->stiffness[a] - held_slope(it->holds + HOLDS * a, z[a]) : 0.0;
            for (int64_t i = 0; i < it->n; i++) {
                const double *tension = lines + (ROWS * i + TURNED + 2 * b + 1) * (k + 1);
                sum += it->distal[i * m + a] * tension[k] - it->proximal[i * m + a] * tension[0];
            }
            slope[a * m + b] = sum;
        }
}

/* Write what a tendon beside did: as the one that was marched, with its changes and those by the turn of each
   coordinate. */
static void follow(
    placed *p, const sample *it, const sample *beside, int64_t i, double *line[], const double *w,
    const double *t, const double turn[], double *work) {
    int64_t k = it->k;
    bar_memory now = memory_of(k, it->trial + i * (9 * (k + 1) + 7));
    bar_chain c = room_of(k, work).chain;
    double pulled = 0.0;
    for (int64_t j = 0; j <= k; j++) c.tension[j] = now.tension[j] + t[j];
    for (int64_t j = 0; j < k; j++) c.w[j] = line[MOVED][j] + w[j], c.slip[j] = (int8_t)now.slip[j];
    for (int64_t a = 0; a < it->m; a++) {
        const double *moved = line[TURNED + 2 * a], *pull = line[TURNED + 2 * a + 1];
        for (int64_t j = 0; j < k; j++) c.w[j] += moved[j] * turn[a];
        for (int64_t j = 0; j <= k; j++) c.tension[j] += pull[j] * turn[a];
        pulled += beside->proximal[i * it->m + a] * turn[a];
    }
    keep(&p->laws, &p->before, &c, p->shares, p->span);
    p->before.held[HELD.drive] = p->drive + pulled;
    p->before.held[HELD.engaged] = p->target + (p->engaged ? pulled : 0.0);
    p->before.held[HELD.time] += p->span;
}

/* Take a machine beside one that was marched from z to `own`, which it is in this sample. */
static void step_beside(
    placed places[], const sample *it, const sample *beside, const double z[], const double was[], const double left[],
    const double slope[], double *lines, double *change, double own[], double *work) {
    int64_t m = it->m, k = it->k, b = k + 1, rows = ROWS * b;
    double turn[MOST], own_left[MOST], matrix[MOST * MOST], *line[ROWS];
    for (int64_t i = 0; i < it->n; i++) {
        rows_of(k, lines + i * rows, line);
        differ(places + i, it, beside, i, z, line, change + 2 * i * b, change + (2 * i + 1) * b, work + 21 * b);
    }
    left_of(beside, it->trial, z, change, own_left);
    for (int64_t a = 0; a < m; a++) own_left[a] -= left[a];
    memcpy(matrix, slope, sizeof matrix);
    if (it->friction > 0.0 && z[0] == was[0]) turn[0] = own[0] - z[0]; /* it rests; docs/model.md (195) */
    else solve_step(m, matrix, own_left, turn);
    for (int64_t i = 0; i < it->n; i++) {
        rows_of(k, lines + i * rows, line);
        follow(places + i, it, beside, i, line, change + 2 * i * b, change + (2 * i + 1) * b, turn, work);
    }
    for (int64_t a = 0; a < m; a++) own[a] = z[a] + turn[a];
}

/** Take a machine through the samples of a run, and c − 1 others beside it that differ little; docs/model.md (298).

The first is marched as by `march_machine`, and the contacts of the others do what its contacts do: what they add to it
is exact to first order in their differences, as derivatives need. All else is as there, with a row for each machine.
Returns the number of samples done by the first; the memories; the coordinates; and T_in, T_out [N], x_in, x_out [m]
of each tendon. */
ENTRY int64_t tss_march_beside(
    int64_t c, int64_t n, int64_t k, const double plant[c][n * (17 * (k + 1) + 430)],
    const double memory[c][n * (9 * (k + 1) + 7)], int64_t m, const double proximal[c][n * m],
    const double distal[c][n * m], const double stiffness[c][m], const double holds[c][40 * m],
    const double friction[c], const double at_rest[c][m], const double start[c][m], int64_t by_force, int64_t s,
    const double spans[s], const double drive[c][s * n], const double end[c][s * n],
    const double load[c][s * m], const double warmth[s], OUT double after[c][n * (9 * (k + 1) + 7)],
    OUT double coordinate[c][s * m], OUT double ends[c][s * 4 * n], WORK double trial[n][9 * (k + 1) + 7],
    WORK double room[c * n][96], WORK double own_room[n][96], WORK double lines[n][17 * (k + 1)],
    WORK double change[2 * n][k + 1], WORK double work[24 + 22 * n][k + 1]) {
    int64_t b = k + 1, rows = ROWS * b, size = 17 * b + 430;
    double *turned = *coordinate, *read_out = *ends, *line[ROWS];
    for (int64_t i = 0; i < c * s * m; i++) turned[i] = NAN;
    for (int64_t i = 0; i < 4 * c * s * n; i++) read_out[i] = NAN;
    memcpy(*after, *memory, (size_t)(c * n) * memory_bytes(k));
    if (c < 1 || k < 2 || n < 1 || m > MOST) return 0;
    placed *places = (placed *)*room;
    pulled *tendons = begin_tendons(n, k, plant[0], *own_room, work[24 + n]);
    for (int64_t j = 0; j < c; j++)
        for (int64_t i = 0; i < n; i++)
            places[j * n + i] = begin_at(k, plant[j] + i * size, after[j] + i * (9 * b + 7));
    for (int64_t g = 0; g < s; g++) {
        double z[MOST] = {0.0}, was[MOST] = {0.0}, own[MOST], left[MOST], slope[MOST * MOST] = {0.0};
        double sum = spans[g] + warmth[g];
        for (int64_t i = 0; i < n; i++) sum += drive[0][g * n + i] + end[0][g * n + i];
        for (int64_t a = 0; a < m; a++) {
            sum += load[0][g * m + a];
            z[a] = was[a] = g > 0 ? coordinate[0][(g - 1) * m + a] : start[0][a];
        }
        if (!isfinite(sum)) return g;
        sample it = {
            n, k, m, plant[0], proximal[0], distal[0], stiffness[0], holds[0], at_rest[0], drive[0] + g * n,
            end[0] + g * n, load[0] + g * m, (int)by_force, m == 1 ? friction[0] : 0.0, 0.0,
            most(BAR.least_time, spans[g]), warmth[g], after[0], *trial, work[20], work[24], tendons, g > 0};
        if (!solve_balance(&it, z)) return g;
        memset(*change, 0, (size_t)(2 * n * b) * sizeof(double));
        for (int64_t i = 0; i < n; i++) rows_of(k, *lines + i * rows, line), straighten(places + i, &it, i, z, line, work[21]);
        forces_of(&it, z, *lines, slope);
        if (it.friction > 0.0) it.slides = copysign(it.friction, z[0] - was[0]);
        left_of(&it, *trial, z, *change, left);
        for (int64_t j = 1; j < c; j++) {
            sample beside = {
                n, k, m, plant[j], proximal[j], distal[j], stiffness[j], holds[j], at_rest[j],
                drive[j] + g * n, end[j] + g * n, load[j] + g * m, (int)by_force, m == 1 ? friction[j] : 0.0,
                0.0, it.span, it.warmth, after[j], after[j], work[20], work[24], NULL, 0};
            if (it.friction > 0.0) beside.slides = copysign(beside.friction, it.slides);
            for (int64_t a = 0; a < m; a++) own[a] = g > 0 ? coordinate[j][(g - 1) * m + a] : start[j][a];
            step_beside(places + j * n, &it, &beside, z, was, left, slope, *lines, *change, own, work[0]);
            for (int64_t a = 0; a < m; a++) coordinate[j][g * m + a] = own[a];
            read_ends(&beside, own, ends[j] + 4 * n * g);
        }
        memcpy(after[0], *trial, (size_t)n * memory_bytes(k));
        for (int64_t a = 0; a < m; a++) coordinate[0][g * m + a] = z[a];
        read_ends(&it, z, ends[0] + 4 * n * g);
    }
    return s;
}
