/* One step of a tendon without memory of effects, whose bars follow the sensed length of any route.

   It is the equilibrium nearest to the old bars; docs/model.md (40)-(49). */
#include "tendon_bars.h"

#include <string.h>

/* Rest of each bar on the new route, and its stretch if no contact moves [m].

   A bar keeps its tension where its length or compliance changed; negative stretch is slack. */
static void set_rest(
    const bar_laws *laws, const bar_memory *old, const double growth[], double position, double rest[],
    double given[]) {
    int64_t last_bar = laws->k;
    for (int64_t j = 0; j <= last_bar; j++) {
        double apart = j > 0 ? old->displacement[j - 1] : position, pull = old->tension[j];
        apart -= j < last_bar ? old->displacement[j] : 0.0;
        given[j] = (pull > 0.0 ? laws->soft[j] * pull : least(0.0, apart + old->rest[j])) + growth[j];
        rest[j] = laws->soft[j] > 0.0 ? given[j] - apart : 0.0;
    }
}

/* Whether the drive lets all tension go; the memory then has what each contact did.

   No tension at one contact is none anywhere, so the tendon hangs loose as soon as its path is no longer than
   it is itself. Each contact moves as little as leaves every bar loose; docs/model.md (46a). */
static int hangs_loose(
    const bar_laws *laws, bar_memory *memory, const double given[], int by_force, double target,
    double room[]) {
    int64_t n = laws->k - 1;
    if (laws->load == 0.0 || (by_force && target > 0.0)) return 0;
    room[n] = laws->soft[n + 1] == 0.0 ? 0.0 : -given[n + 1]; /* the most that each contact may move [m] */
    for (int64_t i = n; i > 0; i--) room[i - 1] = room[i] - given[i];
    double lowest = by_force ? -INFINITY : target;
    if (lowest > room[0]) return 0;
    for (int64_t i = 0; i <= n; i++) {
        double moved = least(room[i], most(0.0, lowest));
        memory->displacement[i] = moved;
        memory->slip[i] = moved > 0.0 ? PULLED : moved < 0.0 ? RELEASED : STUCK;
        if (i < n) lowest = moved + given[i + 1];
    }
    for (int64_t j = 0; j <= n + 1; j++) memory->tension[j] = 0.0;
    return 1;
}

/* Set how far the drive moved, where the load is that was at `load`, and the elongation [m]. */
static void
set_ends(const bar_laws *laws, const bar_memory *memory, const double given[], double load, double ends[3]) {
    const double *tension = memory->tension, *moved = memory->displacement;
    int64_t n = laws->k - 1;
    double elongation = 0.0;
    for (int64_t j = 1; j <= n; j++) {
        elongation += laws->soft[j] * (tension[j] - laws->pretension); /* docs/model.md (44) */
        if (tension[j] <= 0.0) elongation += least(0.0, moved[j - 1] - moved[j] + given[j]);
    }
    load += moved[n];
    if (tension[n + 1] <= 0.0 && laws->soft[n + 1] > 0.0) load += most(0.0, -moved[n] - given[n + 1]);
    ends[0] = moved[0] - given[0];
    ends[1] = load;
    ends[2] = elongation;
}

/* Step to a drive; sets position of drive and load, elongation, solves; slip of the first contact; and (47).
 */
static int64_t advance(
    const bar_laws *laws, const double *before, const double growth[], double drive, int by_force,
    double position, double *after, double ends[9], double *work) {
    int64_t k = laws->k, n = k - 1;
    bar_memory old = memory_of(k, (double *)before), memory = memory_of(k, after);
    step_room room = room_of(k, work);
    double *given = work + 18 * (k + 1); /* not the room's own, which the balance sets from it */
    double target = by_force ? drive : drive - position, weight = old.tension[n + 1];
    if (by_force && laws->load == 0.0) { /* docs/model.md (47) */
        double rounding = ROUNDING.relative;
        range_of_drive(k, weight, laws->low, laws->high, laws->force, ends + 7);
        if (!(ends[7] * (1.0 - rounding) <= drive && drive <= ends[8] * (1.0 + rounding))) return RUNS_AWAY;
    }
    set_rest(laws, &old, growth, position, memory.rest, given);
    for (int64_t i = 0; i < k; i++) /* displacements are those of this step alone */
        memory.displacement[i] = memory.speed[i] = memory.travel[i] = 0.0;
    if (!by_force) { /* docs/model.md (45) */
        target += given[0];
        memory.tension[0] += (given[1] - laws->soft[1] * old.tension[1]) / laws->soft[1];
    }
    if (laws->load == INFINITY)
        memory.tension[n + 1] += (given[n] - laws->soft[n] * old.tension[n]) / laws->soft[n];
    int64_t solves = 1;
    double change = 0.0;
    if (!hangs_loose(laws, &memory, given, by_force, target, room.about)) {
        begin_room(laws, &room);
        change = balance(laws, &memory, &room, by_force, target, weight, 0.0, BAR.untimed, given, &solves);
    }
    if (!(change < INFINITY)) return NO_EQUILIBRIUM;
    set_ends(laws, &memory, given, old.displacement[n], ends);
    ends[0] = by_force ? position + ends[0] : drive, ends[3] = (double)solves, ends[6] = memory.slip[0];
    for (int64_t i = 0; i < k; i++) memory.displacement[i] += old.displacement[i];
    if (!by_force && memory.tension[0] > 0.0)
        memory.displacement[0] = drive; /* to the last digit: held there, the tendon shall not seem to move */
    memcpy(memory.speed, old.speed, (size_t)k * sizeof(double));
    memcpy(memory.travel, old.travel, (size_t)k * sizeof(double));
    return STEPPED;
}

static int64_t no_step(int64_t k, const double *before, double *after, double ends[9], int64_t code) {
    memcpy(after, before, memory_bytes(k));
    for (int i = 0; i < 9; i++) ends[i] = 0.0;
    return code;
}

/** Step bars of the base model on the route `now`, or `before` where `compare` and it has not moved.

`length_before` [m] is below 0 where a longer route does not stretch the tendon; the load has a `stiffness`
[N/m]. Returns STEPPED, NO_EQUILIBRIUM, RUNS_AWAY (of a dead weight) or
STUCK_FAST (friction beyond `most_friction` = μΦ), the new memory, and `ends`: position of drive and load,
elongation [m], solves, length of the route [m], whether it moved, slip of the first contact, and the range of
tensions that holds a dead weight [N] or else μΦ. `drive` is a tension [N] or, unless `by_force`, a position
[m]; `position` is where the drive was [m]. */
ENTRY int64_t tss_step_bars(
    int64_t k, const double edge[k], const double memory[9 * (k + 1) + 7], int64_t p,
    const double before_length[p], const double before_angle[p], const double before_covariance[2 * p][2 * p],
    int64_t q, const double now_length[q], const double now_angle[q],
    const double now_covariance[2 * q][2 * q], int64_t compare, double friction, double compliance,
    double pretension, double stiffness, double most_friction, double length_before,
    double drive, int64_t by_force, double position, OUT double after[9 * (k + 1) + 7], OUT double ends[9],
    WORK double plant[17 * (k + 1) + 430], WORK double work[48][k + 1]) {
    no_step(k, memory, after, ends, NO_EQUILIBRIUM);
    if (k < 2 || p == 0 || q == 0) return NO_EQUILIBRIUM;
    int stays =
        compare
        && tss_is_unmoved(
            p, before_length, before_angle, before_covariance, q, now_length, now_angle, now_covariance);
    if (!stays) p = q, before_length = now_length, before_angle = now_angle;
    double bend = friction * total(p, before_angle);
    ends[5] = !stays, ends[8] = bend;
    if (bend > most_friction) return STUCK_FAST;

    contact_grid grid = grid_of(k, work[20]);
    double *growth = work[24], *number = plant + LAW_ROWS * (k + 1);
    discretise(k, edge, p, before_length, before_angle, grid);
    double whole = total(k - 1, grid.length), *soft = plant + LAW.soft * (k + 1);
    double share = length_before > 0.0 ? 1.0 - length_before / whole : 0.0; /* by which the path grew */
    memset(plant, 0, plant_bytes(k));
    growth[0] = 0.0, ends[4] = whole;
    for (int64_t j = 1; j < k; j++) {
        soft[j] = compliance * grid.length[j - 1];
        growth[j] = share * (grid.length[j - 1] - soft[j] * memory[MEMORY.tension * (k + 1) + j]); /* (40) */
    }
    soft[k] = stiffness > 0.0 ? 1.0 / stiffness : 0.0;
    growth[k] = 0.0;
    number[PLANT.pretension] = pretension, number[PLANT.load] = stiffness, number[PLANT.creep_time] = 1.0;
    number[PLANT.friction] = friction;
    set_contacts(k, plant, grid.angle);
    bar_laws laws = laws_of(k, plant);
    return advance(&laws, memory, growth, drive, (int)by_force, position, after, ends, work[0]);
}
