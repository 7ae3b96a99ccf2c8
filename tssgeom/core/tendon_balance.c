/* The laws of bars and contacts, and the equilibrium of one step with all of them, on any route.

   The laws are made straight about the last pass. Displacements are absolute, so that nothing drifts in a
   hold; docs/model.md (40)-(47), (50)-(58). */
#include "tendon_bars.h"

#include <string.h>

size_t memory_bytes(int64_t k) { return (size_t)(9 * (k + 1) + 7) * sizeof(double); }
size_t plant_bytes(int64_t k) { return (size_t)(17 * (k + 1) + 430) * sizeof(double); }

const double *tables_of(int64_t k, const double *plant) { return plant + LAW_ROWS * (k + 1) + PLANT_NUMBERS; }

/* Whether a law falls anywhere. */
static int falls(const double *table) {
    const double *value = table ? table + 1 + TABLE.most : NULL;
    int64_t last = table ? (int64_t)table[0] - 1 : 0;
    for (int64_t i = 0; i < last; i++)
        if (value[i + 1] < value[i]) return 1;
    return 0;
}

bar_laws laws_of(int64_t k, const double *plant) {
    int64_t b = k + 1;
    const double *number = plant + LAW_ROWS * b;
    bar_laws laws = {.k = k};
    laws.soft = plant + LAW.soft * b, laws.toe = plant + LAW.toe * b,
    laws.toe_scale = plant + LAW.toe_scale * b;
    laws.saved = plant + LAW.saved * b, laws.tables = tables_of(k, plant);
    const int64_t rows[CREEPS] = {LAW.creep_soft, LAW.creep_soft_2, LAW.creep_soft_3};
    const int64_t times[CREEPS] = {PLANT.creep_time, PLANT.creep_time_2, PLANT.creep_time_3};
    for (int e = 0; e < CREEPS; e++)
        laws.creep_soft[e] = plant + rows[e] * b, laws.creep_time[e] = number[times[e]];
    for (int e = 0; e < CREEPS; e++)
        for (int64_t j = 0; j < b; j++) laws.creeps |= laws.creep_soft[e][j] != 0.0;
    laws.warm = plant + LAW.warm * b, laws.rest = plant + LAW.rest * b;
    laws.pulling = plant + LAW.pulling * b, laws.releasing = plant + LAW.releasing * b;
    laws.fitting = plant + LAW.fitting * b, laws.low = plant + LAW.low * b, laws.high = plant + LAW.high * b;
    laws.force = plant + LAW.force * b, laws.drag = plant + LAW.drag * b;
    laws.pretension = number[PLANT.pretension], laws.load = number[PLANT.load];
    laws.saved_scale = number[PLANT.saved_scale], laws.clearance = number[PLANT.clearance];
    laws.backlash = number[PLANT.backlash];
    laws.load_exponent = number[PLANT.load_exponent], laws.load_reference = number[PLANT.load_reference];
    laws.wear_gain = number[PLANT.wear_gain], laws.wear_travel = number[PLANT.wear_travel];
    laws.speed_gain = number[PLANT.speed_gain], laws.speed_reference = number[PLANT.speed_reference];
    laws.speed_memory = number[PLANT.speed_memory];
    laws.presliding = plant + LAW.presliding * b, laws.gives = laws.presliding[0] > 0.0;
    laws.presliding_reference = number[PLANT.presliding_reference];
    laws.curved = number[PLANT.curved] != 0.0, laws.by_rate = number[PLANT.by_rate] != 0.0;
    laws.varied = number[PLANT.varied] != 0.0, laws.swift = number[PLANT.swift] != 0.0;
    laws.loaded = laws.load_exponent != 0.0 || table_of(laws.tables, CURVE.load);
    laws.by_speed = laws.speed_gain != 0.0 || table_of(laws.tables, CURVE.speed);
    laws.worn = laws.wear_gain != 0.0 || table_of(laws.tables, CURVE.travel)
                || table_of(laws.tables, CURVE.time) || table_of(laws.tables, CURVE.position);
    laws.now = 1.0, laws.late = laws.speed_memory > 0.0 || falls(table_of(laws.tables, CURVE.speed));
    return laws;
}

bar_memory memory_of(int64_t k, double *block) {
    int64_t b = k + 1;
    bar_memory memory = {.held = block + 9 * b};
    memory.tension = block + MEMORY.tension * b, memory.creep[0] = block + MEMORY.creep * b;
    memory.creep[1] = block + MEMORY.creep_2 * b, memory.creep[2] = block + MEMORY.creep_3 * b;
    memory.rest = block + MEMORY.rest * b, memory.displacement = block + MEMORY.displacement * b;
    memory.speed = block + MEMORY.speed * b, memory.travel = block + MEMORY.travel * b;
    memory.slip = block + MEMORY.slip * b;
    return memory;
}

step_room room_of(int64_t k, double *work) {
    int64_t b = k + 1;
    bar_chain c = {.k = k, .trial = work, .stiffness = work + b, .low = work + 2 * b, .high = work + 3 * b};
    c.force = work + 4 * b, c.drag = work + 5 * b, c.tension = work + 6 * b, c.w = work + 7 * b;
    c.bristle = work + 16 * b, c.kept = work + 17 * b;
    c.ratios = work + 8 * b, c.slip = (int8_t *)(work + 9 * b), c.tight = (int8_t *)(work + 10 * b);
    return (step_room){
        c, work + 11 * b, work + 12 * b, work + 13 * b, work + 14 * b, work + 15 * b, NULL,
        work + 19 * b, 0};
}

void begin_room(const bar_laws *laws, step_room *room) {
    size_t size = (size_t)laws->k * sizeof(double);
    memcpy(room->pulling, laws->pulling, size);
    memcpy(room->releasing, laws->releasing, size);
    memcpy(room->chain.low, laws->low, size);
    memcpy(room->chain.high, laws->high, size);
    memcpy(room->chain.force, laws->force, size);
    for (int64_t i = 0; i < laws->k; i++) room->chain.bristle[i] = INFINITY, room->chain.kept[i] = 0.0;
}

/* docs/model.md (279) */
double bristle_of(const bar_laws *laws, int64_t i) {
    double exponent = 0.5 * (laws->pulling[i] + laws->releasing[i]) + laws->fitting[i];
    return (exponent * laws->presliding_reference + laws->force[i]) / laws->presliding[i];
}

const double *table_of(const double *tables, int64_t which) {
    const double *table = tables + which * TABLE.size;
    return table[0] >= 2.0 && table[0] <= (double)TABLE.most ? table : NULL;
}

double table_value(const double table[], double x, double *slope) {
    int64_t last = (int64_t)table[0] - 1, i = 0;
    const double *at = table + 1, *value = at + TABLE.most, *turn = value + TABLE.most;
    *slope = 0.0;
    if (!(x > at[0])) return value[0];
    if (x >= at[last]) return value[last];
    while (i + 1 < last && x >= at[i + 1]) i++;
    double span = at[i + 1] - at[i], u = (x - at[i]) / span, w = 1.0 - u;
    double rise = (value[i + 1] - value[i]) / span;
    *slope = 6.0 * u * w * rise + w * (1.0 - 3.0 * u) * turn[i] + u * (3.0 * u - 2.0) * turn[i + 1];
    return value[i] * w * w * (1.0 + 2.0 * u) + value[i + 1] * u * u * (3.0 - 2.0 * u)
           + span * u * w * (w * turn[i] - u * turn[i + 1]);
}

/* Add `scale` times a table of stretch over tension. */
static void add_stretch(
    const bar_laws *laws, int64_t which, double scale, double tension, double *stretch, double *rise) {
    const double *table = table_of(laws->tables, which);
    if (!table) return;
    double turn;
    *stretch += scale * table_value(table, tension, &turn);
    *rise += scale * turn;
}

double stretch_of(const bar_laws *laws, int64_t j, double tension, double *slope) {
    double stretch = laws->soft[j] * tension, rise = laws->soft[j]; /* docs/model.md (50) */
    if (laws->toe[j] != 0.0) {
        double rest = exp(-tension / laws->toe_scale[j]);
        stretch += laws->toe[j] * (1.0 - rest);
        rise += laws->toe[j] * rest / laws->toe_scale[j];
    }
    if (laws->saved[j] != 0.0) {
        double rest = exp(-tension / laws->saved_scale);
        stretch += laws->saved[j] * (1.0 - rest);
        rise += laws->saved[j] * rest / laws->saved_scale;
    }
    if (laws->curved) { /* docs/model.md (186) */
        int64_t which = j == 0 ? CURVE.stretch_in : j == laws->k ? CURVE.stretch_out : CURVE.strain;
        add_stretch(laws, which, which == CURVE.strain ? laws->soft[j] : 1.0, tension, &stretch, &rise);
        if (j == laws->k) add_stretch(laws, CURVE.load_path, 1.0, tension, &stretch, &rise);
    }
    *slope = rise;
    return stretch;
}

double load_factor(const bar_laws *laws, double load, double *slope) {
    double factor = 1.0, rise = 0.0, above = most(BAR.least_load, load);
    if (laws->load_exponent != 0.0) {
        factor = exp(laws->load_exponent * log(above / laws->load_reference));
        rise = load > BAR.least_load ? laws->load_exponent * factor / load : 0.0;
    }
    const double *table = table_of(laws->tables, CURVE.load);
    if (table) {
        double turn, value = table_value(table, load, &turn);
        rise = rise * value + factor * turn, factor *= value;
    }
    *slope = rise;
    return factor;
}

double wear_factor(const bar_laws *laws, double travel) {
    double factor = laws->now * (1.0 - laws->wear_gain * expm1(-travel / laws->wear_travel)), slope;
    const double *table = table_of(laws->tables, CURVE.travel);
    return table ? factor * table_value(table, travel, &slope) : factor;
}

void set_step_factor(bar_laws *laws, const bar_memory *memory, double time) {
    const double *by_time = table_of(laws->tables, CURVE.time);
    const double *by_position = table_of(laws->tables, CURVE.position);
    double slope;
    laws->now = by_time ? table_value(by_time, time, &slope) : 1.0;
    if (by_position) laws->now *= table_value(by_position, memory->displacement[0], &slope);
}

creep_shares creep_after(double time_constants) {
    if (!(time_constants < INFINITY)) return (creep_shares){0.0, 0.0, 0.0}; /* there is none */
    double mean = -expm1(-time_constants) / time_constants, kept = exp(-time_constants);
    return (creep_shares){kept, mean - kept, 1.0 - mean};
}

void set_shares(const bar_laws *laws, double span, creep_shares shares[]) {
    for (int e = 0; laws->creeps && e < CREEPS; e++) shares[e] = creep_after(span / laws->creep_time[e]);
}

/* docs/model.md (51), (58) */
void set_given(
    const bar_laws *laws, const bar_memory *memory, double warmth, const creep_shares shares[], double target,
    const double rest[], double given[]) {
    int64_t last_bar = laws->k;
    for (int64_t j = 0; j <= last_bar; j++) {
        double left = j > 0 ? memory->displacement[j - 1] : target;
        double right = j < last_bar ? memory->displacement[j] : 0.0;
        given[j] = left - right + rest[j] - laws->warm[j] * warmth;
        for (int e = 0; laws->creeps && e < CREEPS; e++)
            if (laws->creep_soft[e][j] != 0.0)
                given[j] += laws->creep_soft[e][j] * (laws->pretension - shares[e].old * memory->tension[j])
                            - shares[e].kept * memory->creep[e][j];
    }
}

/* The straight law of each bar about the tensions of the last pass; docs/model.md (50), (57). */
static void set_bars(const bar_laws *laws, const step_room *room, const creep_shares shares[]) {
    for (int64_t j = 0; j <= laws->k; j++) {
        double slope, stretch = stretch_of(laws, j, room->about[j], &slope);
        for (int e = 0; laws->creeps && e < CREEPS; e++) {
            stretch += shares[e].new * laws->creep_soft[e][j] * room->about[j];
            slope += shares[e].new * laws->creep_soft[e][j];
        }
        room->chain.stiffness[j] = slope > 0.0 ? 1.0 / slope : 0.0;
        room->chain.trial[j] = room->about[j] + room->chain.stiffness[j] * (room->given[j] - stretch);
    }
}

/* The cone of each contact about the tensions and movements of the last pass; docs/model.md (52)-(56). */
static void set_cones(const bar_laws *laws, const step_room *room, double span) {
    const bar_chain *c = &room->chain;
    for (int64_t i = 0; i < laws->k; i++) {
        double steep, factor = load_factor(laws, 0.5 * (room->about[i] + room->about[i + 1]), &steep);
        c->force[i] = laws->force[i], c->drag[i] = laws->drag[i] / span;
        if (laws->by_speed) {
            double slid = fabs(room->moved[i]), rise;
            double at = laws->late ? room->taken[i] : slid / span, grows = laws->late ? 0.0 : 1.0 / span;
            double by_speed = speed_factor(laws, slid, span, at, grows, &rise);
            double exponent = room->moved[i] >= 0.0 ? room->pulling[i] : room->releasing[i];
            double slope = room->about[i + 1] * exponent * factor * most(0.0, rise);
            factor *= by_speed, steep *= by_speed;
            c->drag[i] += slope; /* docs/model.md (56) */
            c->force[i] -= slope * slid;
        }
        if (room->steep) room->steep[i] = steep;
        c->low[i] = exp(-room->pulling[i] * factor - laws->fitting[i]);
        c->high[i] = exp(room->releasing[i] * factor + laws->fitting[i]);
    }
}

int
keep(const bar_laws *laws, bar_memory *memory, const bar_chain *c, const creep_shares shares[], double span) {
    int64_t k = laws->k;
    int finite = 1;
    for (int64_t j = 0; j <= k; j++) finite &= isfinite(c->tension[j]) != 0;
    for (int64_t i = 0; i < k; i++) finite &= isfinite(c->w[i]) != 0;
    if (!finite) return 0;
    for (int64_t j = 0; laws->creeps && j <= k; j++)
        for (int e = 0; e < CREEPS; e++) {
            if (laws->creep_soft[e][j] == 0.0) continue; /* docs/model.md (57) */
            double pulled = shares[e].old * memory->tension[j] + shares[e].new * c->tension[j];
            memory->creep[e][j] = shares[e].kept * memory->creep[e][j] + laws->creep_soft[e][j] * pulled;
        }
    memcpy(memory->tension, c->tension, (size_t)(k + 1) * sizeof(double));
    for (int64_t i = 0; i < k; i++) memory->displacement[i] += c->w[i];
    for (int64_t i = 0; i < k; i++) memory->travel[i] += fabs(c->w[i]);
    for (int64_t i = 0; i < k; i++) memory->slip[i] = c->slip[i];
    if (laws->speed_memory == 0.0)
        for (int64_t i = 0; i < k; i++) memory->speed[i] = c->w[i] / span;
    else
        for (int64_t i = 0; i < k; i++)
            memory->speed[i] = followed_speed(laws, memory->speed[i], c->w[i] / span, span);
    return 1;
}

double balance_room(
    const bar_laws *laws, const bar_memory *memory, step_room *room, const creep_shares shares[], int by_force,
    double target, double weight, double warmth, double span, const double rest[], int64_t *solves) {
    bar_chain *c = &room->chain;
    int64_t k = laws->k, last_bar = k;
    int by_movement = laws->by_speed && !(laws->late && laws->speed_gain == 0.0);
    int hanging = laws->load == 0.0, one_pass = !(laws->curved || laws->varied);
    int straight = !(laws->curved || laws->loaded || by_movement); /* a pass that balances is the last */
    speed_search search = search_speeds(laws);
    if (room->taken_given) search.close = -1.0;
    c->rigid_in = !by_force && laws->soft[0] == 0.0 && laws->toe[0] == 0.0;
    c->rigid_out = laws->load == INFINITY && laws->soft[last_bar] == 0.0 && laws->toe[last_bar] == 0.0;
    c->rounds = SOLVER.rounds;
    c->shift = c->rigid_in ? target - memory->displacement[0] : 0.0;
    set_given(laws, memory, warmth, shares, by_force ? 0.0 : target, rest, room->given);
    memcpy(room->about, memory->tension, (size_t)(k + 1) * sizeof(double));
    for (int64_t i = 0; i < k; i++) {
        room->moved[i] = memory->speed[i] * span;
        if (!room->taken_given) room->taken[i] = fabs(memory->speed[i]);
        c->drag[i] = laws->drag[i] / span;
        c->slip[i] = (int8_t)memory->slip[i];
        if (!laws->worn) continue;
        double factor = wear_factor(laws, memory->travel[i]);
        room->pulling[i] = laws->pulling[i] * factor, room->releasing[i] = laws->releasing[i] * factor;
    }
    for (int64_t i = 0; laws->gives && i < k; i++)
        c->bristle[i] = bristle_of(laws, i), c->kept[i] = memory->tension[i] - memory->tension[i + 1];
    double change = INFINITY, residual = INFINITY, accepted = SOLVER.accepted;
    *solves = 0;
    for (int64_t done = 0; done < (one_pass ? 1 : SOLVER.trials); done++) {
        set_bars(laws, room, shares);
        if (by_force) c->trial[0] = target, c->stiffness[0] = 0.0;
        else if (c->rigid_in) c->trial[0] = memory->tension[0], c->stiffness[0] = 0.0;
        if (hanging) c->trial[last_bar] = weight, c->stiffness[last_bar] = 0.0;
        else if (c->rigid_out) c->trial[last_bar] = memory->tension[last_bar], c->stiffness[last_bar] = 0.0;
        if (laws->varied) set_cones(laws, room, span);
        if (by_force && hanging) { /* docs/model.md (47) */
            double range[2];
            range_of_drive(k, weight, c->low, c->high, c->force, range);
            if (!(range[0] * (1.0 - ROUNDING.relative) <= target
                  && target <= range[1] * (1.0 + ROUNDING.relative)))
                return INFINITY;
        }
        *solves += equilibrium(c, hanging, SOLVER.from_before, SOLVER.from_guess, &residual);
        change = 0.0, accepted = SOLVER.accepted;
        for (int64_t j = 0; j <= k; j++) {
            change = most(fabs(c->tension[j] - room->about[j]), change);
            accepted = most(accepted, ROUNDING.relative * c->tension[j]); /* docs/model.md (250) */
        }
        double *followed = c->ratios;
        for (int64_t i = 0; search.close >= 0.0 && i < k; i++)
            followed[i] = followed_speed(laws, memory->speed[i], c->w[i] / span, span);
        if (search.close >= 0.0) compare_speeds(&search, k, room->taken, followed);
        int again = done < SOLVER.full_passes && go_on(&search);
        if (one_pass || (residual <= accepted && !again && (straight || change <= 0.1 * accepted))) break;
        if (again) renew_speeds(&search, k, room->taken, followed);
        /* after a while it swings from side to side of a bend in some law */
        int full = done < SOLVER.full_passes;
        for (int64_t j = 0; j <= k; j++)
            room->about[j] = full ? c->tension[j] : 0.5 * (room->about[j] + c->tension[j]);
        for (int64_t i = 0; i < k; i++) room->moved[i] = full ? c->w[i] : 0.5 * (room->moved[i] + c->w[i]);
    }
    if (!(residual <= accepted)) return INFINITY;
    return straight ? 0.0 : change * (SOLVER.accepted / accepted);
}

double balance(
    const bar_laws *laws, bar_memory *memory, step_room *room, int by_force, double target, double weight,
    double warmth, double span, const double rest[], int64_t *solves) {
    creep_shares shares[CREEPS];
    set_shares(laws, span, shares);
    double change =
        balance_room(laws, memory, room, shares, by_force, target, weight, warmth, span, rest, solves);
    return change < INFINITY && keep(laws, memory, &room->chain, shares, span) ? change : INFINITY;
}
