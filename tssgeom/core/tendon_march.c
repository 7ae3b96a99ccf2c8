/* The march through a measured run: one loop over the samples with every effect in it.

   Each sample goes the short way (`sweep`) where nothing but the drive moves the tendon, else the long one
   (`balance`); both give the same; docs/model.md (50)-(65). */
#include "tendon_bars.h"

#include <string.h>

/* Tension behind a contact that slides and its slope; the friction depends on the load that it has itself.

   `sign` is −1 on a pull, +1 on a release, `m` the exponent by the tension before and `ratio` what it makes of
   `near`; docs/model.md (52). */
static double slide_loaded(
    const bar_laws *laws, int64_t i, double near, double exponent, double m, double ratio, double sign,
    double *slope) {
    double fixed = laws->fitting[i], force = laws->force[i], rise = 0.0;
    for (int64_t turn = 0; turn < SOLVER.trials; turn++) {
        double here = most(0.0, ratio * near + sign * force);
        double wanted = exponent * load_factor(laws, 0.5 * (near + here), &rise);
        double bend = sign * 0.5 * exponent * rise * ratio * near; /* d wanted / d m */
        double change = (wanted - m) / (1.0 - bend);
        m += change;
        ratio = exp(sign * (m + fixed));
        if (fabs(change) <= sqrt(SWEEP.close)) break;
    }
    double share = 0.5 * exponent * rise * ratio * near;
    *slope = (ratio + sign * share) / (1.0 - sign * share);
    return most(0.0, ratio * near + sign * force);
}

/* Carry the tension `start` to the distal end; returns where the drive is then [m], and its slope [m/N];
   docs/model.md (64). */
static double
carry(const bar_laws *laws, const bar_memory *memory, step_room *room, double start, double *slope) {
    const bar_chain *c = &room->chain;
    double *tension = c->tension, rise, share = 1.0, near = start;
    tension[0] = start;
    double shift = stretch_of(laws, 0, start, slope) - laws->rest[0];
    for (int64_t i = 0; i < laws->k; i++) {
        double here = memory->tension[i + 1], down = c->low[i], up = c->high[i];
        double lower = down * near - laws->force[i], upper = up * near + laws->force[i];
        if (laws->loaded) {
            double unused, factor = load_factor(laws, 0.5 * (near + here), &unused);
            double pull = room->pulling[i], release = room->releasing[i];
            down = exp(-pull * factor - laws->fitting[i]);
            lower = down * near - laws->force[i], upper = INFINITY;
            if (here < lower) {
                lower = slide_loaded(laws, i, near, pull, pull * factor, down, -1.0, &down);
            } else {
                up = exp(release * factor + laws->fitting[i]);
                upper = up * near + laws->force[i];
            }
            if (here > upper)
                upper = slide_loaded(laws, i, near, release, release * factor, up, 1.0, &up);
        }
        if (here < lower) here = lower, c->slip[i] = PULLED, share *= down;
        else if (here > upper) here = upper, c->slip[i] = RELEASED, share *= up;
        else c->slip[i] = STUCK, share = 0.0;
        tension[i + 1] = near = here;
        shift += stretch_of(laws, i + 1, here, &rise) - laws->rest[i + 1];
        *slope += share * rise;
    }
    return shift;
}

/* Tension of the drive at which the first contact begins to slide [N]. */
static double sliding_from(const bar_laws *laws, const bar_memory *memory, const step_room *room, int pull) {
    const double *tension = memory->tension;
    double fixed = laws->fitting[0], unused;
    double factor = load_factor(laws, 0.5 * (tension[0] + tension[1]), &unused);
    if (pull) {
        double ratio = laws->loaded ? exp(-room->pulling[0] * factor - fixed) : room->chain.low[0];
        return (tension[1] + laws->force[0]) / ratio * (1.0 + 1e-12);
    }
    double ratio = laws->loaded ? exp(room->releasing[0] * factor + fixed) : room->chain.high[0];
    return most(0.0, tension[1] - laws->force[0]) / ratio * (1.0 - 1e-12);
}

/* Sweep with the tension that puts the drive at `target`; returns how far off it is [m]. */
static double
sweep_to_position(const bar_laws *laws, const bar_memory *memory, step_room *room, double target) {
    double start = memory->tension[0], slope, shift = carry(laws, memory, room, start, &slope);
    if (fabs(shift - target) <= SWEEP.close || (start == 0.0 && shift > target)) return 0.0;
    double below = shift < target ? start : 0.0, above = shift < target ? INFINITY : start;
    if (slope <= 0.0) {
        start = sliding_from(laws, memory, room, shift < target);
        shift = carry(laws, memory, room, start, &slope);
    }
    for (int64_t trial = 0; trial < SOLVER.trials; trial++) {
        if (fabs(shift - target) <= SWEEP.close) return 0.0;
        if (shift < target) below = most(start, below);
        else above = least(start, above);
        double new = slope > 0.0 ? start - (shift - target) / slope : -1.0;
        if (new <= 0.0 && below == 0.0 && start > 0.0 && shift > target)
            new = 0.0; /* perhaps more is given than the tendon takes back */
        else if (!(below < new && new < above))
            new = above == INFINITY ? 2.0 * below + 1.0 : 0.5 * (below + above);
        if (new == start || above - below <= 1e-15 * below) break;
        start = new;
        shift = carry(laws, memory, room, start, &slope);
        if (start == 0.0 && shift >= target) return 0.0;
    }
    return fabs(shift - target);
}

double
sweep(const bar_laws *laws, bar_memory *memory, step_room *room, int by_force, double target, double span) {
    bar_chain *c = &room->chain;
    double off = 0.0, slope;
    for (int64_t i = 0; laws->worn && i < laws->k; i++) {
        double factor = wear_factor(laws, memory->travel[i]);
        room->pulling[i] = laws->pulling[i] * factor, room->releasing[i] = laws->releasing[i] * factor;
        c->low[i] = exp(-room->pulling[i] - laws->fitting[i]);
        c->high[i] = exp(room->releasing[i] + laws->fitting[i]);
    }
    if (by_force) carry(laws, memory, room, target, &slope);
    else off = sweep_to_position(laws, memory, room, target);
    int64_t last_bar = laws->k;
    memory->tension[last_bar] = c->tension[last_bar];
    double here = stretch_of(laws, last_bar, c->tension[last_bar], &slope) - laws->rest[last_bar];
    for (int64_t i = last_bar - 1; i >= 0; i--) {
        double moved = here - memory->displacement[i];
        memory->displacement[i] = here;
        memory->travel[i] += fabs(moved);
        memory->speed[i] = moved / span;
        memory->tension[i] = c->tension[i];
        memory->slip[i] = c->slip[i];
        here += stretch_of(laws, i, c->tension[i], &slope) - laws->rest[i];
    }
    return isfinite(here) ? off : INFINITY;
}

/* Shares of a step at which it is cut; friction by speed lets go just after a turn; docs/model.md (65). */
static const double AFTER_A_TURN[6] = {0.02, 0.06, 0.15, 0.35, 0.65, 1.0};

/* Share of a step at which one of its parts ends; docs/model.md (65). */
static double cut_at(int64_t cut, int turned, double parts) {
    if (!turned) return (double)(cut + 1) / parts;
    return cut < 6 ? AFTER_A_TURN[cut] / parts : (double)(cut - 4) / parts;
}

int record(const bar_laws *laws, const bar_memory *memory, int by_force, double out[6]) {
    const double *tension = memory->tension;
    double *held = memory->held, slope;
    int64_t last_bar = laws->k;
    out[0] = tension[0], out[2] = held[HELD.drive];
    out[1] = laws->force[last_bar] > 0.0 ? memory->travel[last_bar] : tension[last_bar];
    if (by_force) { /* docs/model.md (59) */
        double shift = memory->displacement[0] + stretch_of(laws, 0, tension[0], &slope) - laws->rest[0];
        double lag = held[HELD.lag] + (held[HELD.shift] - shift) * laws->backlash / BAR.turn;
        held[HELD.lag] = within(lag, 0.0, laws->backlash), held[HELD.shift] = shift;
        out[2] = shift - held[HELD.lag];
    }
    const double *path = table_of(laws->tables, CURVE.load_path);
    out[3] =
        laws->load == 0.0 ? memory->displacement[last_bar - 1]
                          : (tension[last_bar] - laws->pretension) / laws->load;
    if (path && laws->load != 0.0) /* docs/model.md (186) */
        out[3] += table_value(path, tension[last_bar], &slope) - table_value(path, laws->pretension, &slope);
    out[4] = memory->slip[0], out[5] = memory->slip[last_bar - 1];
    return isfinite(out[0] + out[1] + out[2] + out[3]);
}

/* Tension before the friction of the load, which the last contact has too; docs/model.md (333). */
static void hold_load(const bar_laws *laws, const bar_memory *memory, const bar_chain *c) {
    int64_t k = laws->k;
    double rubs = laws->force[k], near = memory->tension[k - 1], load = memory->tension[k];
    double other = laws->force[k - 1] - rubs, low = c->low[k - 1] * near - other,
           high = c->high[k - 1] * near + other;
    if (rubs <= 0.0) return;
    if (memory->slip[k - 1] != STUCK) memory->travel[k] = load + rubs * memory->slip[k - 1];
    else memory->travel[k] = within(within(memory->travel[k], low, high), load - rubs, load + rubs);
}

int take_sample(
    bar_laws *laws, bar_memory *memory, step_room *room, int by_force, double duration, double drive,
    double warmth, int64_t parts) {
    double *held = memory->held, first = held[HELD.drive], cold = held[HELD.warmth], before = held[HELD.rate];
    double rate = (drive - first) / most(BAR.least_time, duration), done = 0.0;
    int turned = laws->by_rate && (fabs(rate) < 0.5 * fabs(before) || rate * before < 0.0);
    int64_t cuts = turned ? parts + 5 : parts, solves;
    if (!isfinite(drive + duration + warmth)) return 0;
    held[HELD.time] += duration;
    if (laws->worn) set_step_factor(laws, memory, held[HELD.time]);
    for (int64_t cut = 0; cut < cuts; cut++) {
        double share = cut_at(cut, turned, (double)parts);
        double goal = share == 1.0 ? drive : first + share * (drive - first);
        double warm = share == 1.0 ? warmth : cold + share * (warmth - cold);
        double span = most(BAR.least_time, (share - done) * duration);
        done = share;
        if (!by_force) /* docs/model.md (59) */
            held[HELD.engaged] = least(goal + laws->backlash, most(goal, held[HELD.engaged]));
        double target = by_force ? goal : held[HELD.engaged];
        if (laws->swift) {
            if (!(sweep(laws, memory, room, by_force, target, span) <= SWEEP.accepted)) return 0;
        } else {
            double change = balance(
                laws, memory, room, by_force, target, laws->pretension, warm, span, laws->rest, &solves);
            if (!(change <= 1e2 * SOLVER.accepted)) return 0;
        }
        hold_load(laws, memory, &room->chain);
    }
    held[HELD.drive] = drive, held[HELD.warmth] = warmth, held[HELD.rate] = rate;
    return 1;
}

/** Take the tendon through the samples of a run with every effect; docs/model.md (50)-(65).

`spans` [s] is the time since the sample before, `drive` [N] or [m], `warmth` [K] since the run began, `parts`
the steps of each sample. Returns the number of samples done, fewer where one failed; the memory after them;
`out`: T_in, T_out [N], x_in, x_out [m], what the first and the last contact did; and, where `rows` is s and
not 0, the tension of each bar [N]. */
ENTRY int64_t tss_march(
    int64_t k, const double plant[17 * (k + 1) + 430], const double memory[9 * (k + 1) + 7], int64_t by_force,
    int64_t s, const double spans[s], const double drive[s], const double warmth[s], const int64_t parts[s],
    int64_t rows, OUT double after[9 * (k + 1) + 7], OUT double out[6][s], OUT double profile[rows][k + 1],
    WORK double work[20][k + 1]) {
    memcpy(after, memory, memory_bytes(k));
    double *read_out = *out, *tensions = *profile;
    for (int64_t i = 0; i < 6 * s; i++) read_out[i] = NAN;
    for (int64_t i = 0; i < rows * (k + 1); i++) tensions[i] = NAN;
    if (k < 2 || (rows != 0 && rows != s)) return 0;
    bar_laws laws = laws_of(k, plant);
    bar_memory kept = memory_of(k, after);
    step_room room = room_of(k, work[0]);
    begin_room(&laws, &room);
    for (int64_t g = 0; g < s; g++) {
        double read[6];
        if (!take_sample(&laws, &kept, &room, (int)by_force, spans[g], drive[g], warmth[g], parts[g]))
            return g;
        if (!record(&laws, &kept, (int)by_force, read)) return g;
        for (int row = 0; row < 6; row++) out[row][g] = read[row];
        if (rows > 0) memcpy(profile[g], kept.tension, (size_t)(k + 1) * sizeof(double));
    }
    return s;
}

void switch_drive(const bar_memory *memory, double position, int by_force) {
    double *held = memory->held, engaged = held[HELD.engaged];
    if (by_force)
        held[HELD.drive] = memory->tension[0], held[HELD.lag] = engaged - position,
        held[HELD.shift] = engaged;
    else held[HELD.drive] = position, held[HELD.engaged] = held[HELD.shift];
    held[HELD.rate] = 0.0;
}

/* How many contacts from the drive on slid one way; as before where nothing moved there. */
static int64_t slid_from_drive(const bar_laws *laws, const bar_memory *memory, int64_t before, int stands) {
    if (memory->slip[0] == 0.0) return stands ? before : 0;
    int64_t count = 1;
    while (count < laws->k && memory->slip[count] == memory->slip[0]) count++;
    return count;
}

/** Step a tendon with effects on the route `now`, or `before` where `compare` and it has not moved.

`was_by_force` and `position` [m] are those of the last step, `front` its result; `warmth` [K] is NaN where it
is as before. Returns the number of steps done, 0 where there is no equilibrium; the memory and plant after
it; and `ends`: T_in, T_out [N], x_in, x_out [m], slip of the first and last contact, drive before [N] or [m],
contacts that slid from the proximal end on, whether the route moved, and μΦ, beyond `most_friction` of which
nothing is stepped. */
ENTRY int64_t tss_step_with_effects(
    int64_t k, const double edge[k], const double plant[17 * (k + 1) + 430],
    const double memory[9 * (k + 1) + 7], int64_t p, const double before_length[p],
    const double before_angle[p], const double before_covariance[2 * p][2 * p], int64_t q,
    const double now_length[q], const double now_angle[q], const double now_covariance[2 * q][2 * q],
    int64_t m, const double bends[m][3], int64_t compare, double friction, double most_friction, double drive,
    int64_t by_force, int64_t was_by_force, double position, int64_t front, double span, double warmth,
    OUT double after[9 * (k + 1) + 7], OUT double plant_after[17 * (k + 1) + 430], OUT double ends[10],
    WORK double pieces[5][q + 2 * m], WORK double work[24][k + 1]) {
    memcpy(after, memory, memory_bytes(k));
    memcpy(plant_after, plant, plant_bytes(k));
    for (int i = 0; i < 10; i++) ends[i] = 0.0;
    if (k < 2 || p == 0 || q == 0) return 0;
    int moves =
        compare
        && !tss_is_unmoved(
            p, before_length, before_angle, before_covariance, q, now_length, now_angle, now_covariance);
    ends[8] = moves, ends[9] = friction * (moves ? total(q, now_angle) : total(p, before_angle));
    if (ends[9] > most_friction) return 0;
    if (moves) {
        put_on_route(k, edge, plant_after, q, now_length, now_angle, m, bends, pieces[0], work[20]);
        plant_after[LAW_ROWS * (k + 1) + PLANT.swift] = 0.0;
    }
    bar_laws laws = laws_of(k, plant_after);
    bar_memory kept = memory_of(k, after);
    if (by_force != was_by_force) switch_drive(&kept, position, (int)by_force);
    step_room room = room_of(k, work[0]);
    begin_room(&laws, &room);
    double before = kept.held[HELD.drive];
    if (isnan(warmth)) warmth = kept.held[HELD.warmth];
    if (!take_sample(&laws, &kept, &room, (int)by_force, span, drive, warmth, 1)) return 0;
    if (!record(&laws, &kept, (int)by_force, ends)) return 0;
    ends[6] = before, ends[7] = (double)slid_from_drive(&laws, &kept, front, drive == before);
    return 1;
}
