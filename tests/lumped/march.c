/* The chain in time: backward Euler steps, each balanced to rounding.

   Nothing here knows a closed form of the tension along a sheath. A node is in balance when the two bars and
   the friction, projected on the tangent of the sheath, add to zero; the bars press the contact force into
   it. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lumped.h"

static const double TOLERANCE = 1e-9; /* N, between passes; displacements of 1e-2 m round so */
enum { PASSES = 60 };                 /* more than that and the step is halved */
static const double LEAST_PART = 1.0 / 4096.0; /* of a step: twelve halvings */

typedef struct { /* what a step leaves to the next; k nodes, b bars, c relaxation times */
    double *position; /* [k] displacement of the nodes, towards the proximal end [m] */
    double *tension;  /* [b] N */
    double *friction; /* [k] against motion to the proximal end [N] */
    double *slip;     /* [k] of the last step [m] */
    double *travel;   /* [k] slipped so far, either way [m] */
    double *speed;    /* [k] as the friction feels it [m/s] */
    double *creep;    /* [b][c] m */
    double work;      /* turned into heat by friction [J] */
} State;

typedef struct { /* what is imposed at one time */
    double drive, warmth; /* N or m, K above the start */
    double *growth;       /* [b] m each bar's path is longer than at the start */
    double *turns;        /* [k] rad, 0 at the fittings */
} Inputs;

typedef struct { /* memory of a step */
    double *base, *soft, *offset, *slope, *last, *tension, *moved, *sweep;
    double (*up)[3], (*down)[3];
} Memory;

/* Cut a piece off memory. */
static double *piece(double **memory, int64_t count) {
    double *result = *memory;
    *memory += count;
    return result;
}

static double turn_of_bar(const Chain *chain, const double *turns, int64_t j) {
    return j > 0 && j < chain->nodes ? 0.5 * (turns[j - 1] + turns[j]) : 0.0;
}

/* Put in what is imposed at grid point g, between two frames of the path. */
static void impose(Inputs *now, const Chain *chain, const Imposed *imposed, int64_t g) {
    int64_t k = chain->nodes, at = imposed->frame[g];
    int64_t after = at + 1 < imposed->frames ? at + 1 : imposed->frames - 1;
    double share = imposed->weight[g];
    now->drive = imposed->drive[g], now->warmth = imposed->warmth[g];
    now->growth[0] = now->growth[k] = now->turns[0] = now->turns[k - 1] = 0.0;
    const double *longer = imposed->growth, *turns = imposed->turns;
    for (int64_t j = 0; j < k - 1; j++)
        now->growth[j + 1] = (1.0 - share) * longer[at * (k - 1) + j] + share * longer[after * (k - 1) + j];
    for (int64_t i = 0; i < k - 2; i++)
        now->turns[i + 1] = (1.0 - share) * turns[at * (k - 2) + i] + share * turns[after * (k - 2) + i];
}

static double mixed(double before, double after, double share) {
    return share < 1.0 ? before + share * (after - before) : after;
}

static void between(Inputs *goal, const Inputs *before, const Inputs *after, double share, int64_t k) {
    goal->drive = mixed(before->drive, after->drive, share);
    goal->warmth = mixed(before->warmth, after->warmth, share);
    for (int64_t j = 0; j < k + 1; j++) goal->growth[j] = mixed(before->growth[j], after->growth[j], share);
    for (int64_t i = 0; i < k; i++) goal->turns[i] = mixed(before->turns[i], after->turns[i], share);
}

/* Weights of old creep, old and new tension; the tension is linear over x relaxation times. */
static void creep_weights(double x, double weights[3]) {
    double kept = exp(-x), mean = -expm1(-x) / x;
    weights[0] = kept, weights[1] = mean - kept, weights[2] = 1.0 - mean;
}

/* Extension [m] of each bar if no node moves, and its compliance [m/N], creep included. */
static void offers(
    const Chain *chain, const State *state, const double *rest, const Inputs *goal, double span,
    Memory *memory) {
    int64_t k = chain->nodes, creeps = chain->creeps;
    for (int64_t j = 0; j < k + 1; j++) {
        double left = j > 0 ? state->position[j - 1] : chain->force_driven ? 0.0 : goal->drive;
        double right = j < k ? state->position[j] : 0.0;
        memory->base[j] = rest[j] + goal->growth[j] - chain->expansion[j] * goal->warmth;
        memory->base[j] += left - right;
        memory->soft[j] = chain->compliance[j];
        for (int64_t c = 0; c < creeps; c++) {
            double share[3], compliance = chain->creep_compliance[j * creeps + c];
            creep_weights(span / chain->creep_time[c], share);
            double crept = share[0] * state->creep[j * creeps + c];
            memory->base[j] -= crept + share[1] * compliance * state->tension[j];
            memory->soft[j] += share[2] * compliance;
        }
    }
}

/* Straighten what node i passes on, T_left = r T_right + f + d w: `up` if w > 0, `down` if w < 0.

   On the tangent of the sheath (a − b) cos(turn/2) = ± (grip (a + b) h(v) + floor + drag v). */
static void contact(
    const Chain *chain, const State *state, const Inputs *goal, double span, int64_t i, double total,
    double slip, double up[3], double down[3]) {
    double cosine = cos(0.5 * goal->turns[i]), held[2], factor = 1.0, extra = 0.0;
    grip(chain, goal->turns[i], state->travel[i], total, i, held);
    if (chain->by_speed && i > 0 && i < chain->nodes - 1) {
        double kept = chain->speed_lag > 0.0 ? exp(-span / chain->speed_lag) : 0.0;
        double fresh = (1.0 - kept) / span, rise;
        factor = speed_factor(kept * state->speed[i] + fresh * slip, chain->speed_law, &rise);
        factor -= rise * fresh * slip;
        extra = rise * fresh * total;
    }
    double g = held[0] * factor, d = chain->drag[i] / span + held[0] * extra;
    up[0] = (cosine + g) / (cosine - g), up[1] = chain->floor[i] / (cosine - g), up[2] = d / (cosine - g);
    g = held[1] * factor, d = chain->drag[i] / span + held[1] * extra;
    down[0] = (cosine - g) / (cosine + g), down[1] = -chain->floor[i] / (cosine + g);
    down[2] = d / (cosine + g);
}

/* Take over tension and motion of a balanced step. */
static void take_over(
    const Chain *chain, State *state, const Inputs *goal, const Memory *memory, double span) {
    int64_t k = chain->nodes, creeps = chain->creeps;
    const double *tension = memory->tension, *moved = memory->moved;
    for (int64_t c = 0; c < creeps; c++) {
        double share[3];
        creep_weights(span / chain->creep_time[c], share);
        for (int64_t j = 0; j < k + 1; j++) {
            double pulled = share[1] * state->tension[j] + share[2] * tension[j];
            state->creep[j * creeps + c] =
                share[0] * state->creep[j * creeps + c] + chain->creep_compliance[j * creeps + c] * pulled;
        }
    }
    double kept = chain->speed_lag > 0.0 ? exp(-span / chain->speed_lag) : 0.0;
    for (int64_t i = 0; i < k; i++) {
        double loss = tension[i] - tension[i + 1];
        state->work += 0.5 * (state->tension[i] - state->tension[i + 1] + loss) * moved[i];
        state->friction[i] = loss * cos(0.5 * goal->turns[i]);
        state->position[i] += moved[i];
        state->slip[i] = moved[i];
        state->travel[i] += fabs(moved[i]);
        state->speed[i] = kept * state->speed[i] + (1.0 - kept) * fabs(moved[i]) / span;
    }
    memcpy(state->tension, tension, (size_t)(k + 1) * sizeof *tension);
}

/* Bring the state to what is imposed after `span` [s]; return passes, below 0 without a balance.

   Curved laws are straightened about the last pass until the tensions stay; straight laws need one. */
static int64_t advance(
    const Chain *chain, State *state, const double *rest, const Inputs *goal, double span, Memory *memory) {
    int64_t k = chain->nodes;
    double *last = memory->last;
    offers(chain, state, rest, goal, span, memory);
    memcpy(memory->tension, state->tension, (size_t)(k + 1) * sizeof *last);
    memcpy(memory->moved, state->slip, (size_t)k * sizeof *last);
    memcpy(last, state->tension, (size_t)(k + 1) * sizeof *last);
    for (int64_t done = 0; done < PASSES; done++) {
        for (int64_t j = 0; j < k + 1; j++) {
            double clearance = chain->clearance_per_turn * turn_of_bar(chain, goal->turns, j);
            double extension = stretched(
                last[j], memory->soft[j], chain->toe[j], chain->toe_scale[j], clearance,
                chain->clearance_scale, &memory->slope[j]);
            memory->offset[j] = extension - memory->slope[j] * last[j] - memory->base[j];
        }
        for (int64_t i = 0; i < k; i++)
            contact(
                chain, state, goal, span, i, last[i] + last[i + 1], fabs(memory->moved[i]), memory->up[i],
                memory->down[i]);
        if (!answer(
                chain, memory->offset, memory->slope, (const double (*)[3])memory->up,
                (const double (*)[3])memory->down, chain->force_driven ? goal->drive : 0.0, memory->tension,
                memory->moved, memory->sweep))
            return -PASSES;
        double change = 0.0;
        for (int64_t j = 0; j < k + 1; j++) {
            double by = fabs(memory->tension[j] - last[j]);
            if (!(by <= change)) change = by;
            last[j] = memory->tension[j];
        }
        if (change < TOLERANCE || (chain->straight && done == 0)) {
            take_over(chain, state, goal, memory, span);
            return done + 1;
        }
    }
    return -PASSES;
}

/* Extension [m] of each bar in the pretensioned state, on its way of loading. */
static void find_rest(const Chain *chain, const double *turns, double *rest) {
    double tension = chain->pretension;
    for (int64_t j = 0; j < chain->nodes + 1; j++) {
        double creep = 0.0, clearance = chain->clearance_per_turn * turn_of_bar(chain, turns, j);
        for (int64_t c = 0; c < chain->creeps; c++) creep += chain->creep_compliance[j * chain->creeps + c];
        rest[j] = (chain->compliance[j] + creep) * tension;
        rest[j] -= chain->toe[j] * expm1(-tension / chain->toe_scale[j]);
        rest[j] -= clearance * expm1(-tension / chain->clearance_scale);
    }
}

static void record(Records *records, int64_t row, const State *state, int64_t k) {
    size_t bytes = (size_t)k * sizeof(double);
    memcpy(records->tension + row * (k + 1), state->tension, bytes + sizeof(double));
    memcpy(records->position + row * k, state->position, bytes);
    memcpy(records->friction + row * k, state->friction, bytes);
    memcpy(records->slip + row * k, state->slip, bytes);
    records->work[row] = state->work;
}

/* Run the steps in memory [60 (k + 8) + b c]; see lumped.h. */
static int64_t run(
    const Chain *chain, const Imposed *imposed, Records *records, int64_t *passes, double *memory) {
    int64_t k = chain->nodes, b = k + 1, steps = 0, kept = 0;
    State state = { piece(&memory, k), piece(&memory, b), piece(&memory, k), piece(&memory, k),
                    piece(&memory, k), piece(&memory, k), piece(&memory, b * chain->creeps), 0.0 };
    Inputs before = { 0.0, 0.0, piece(&memory, b), piece(&memory, k) };
    Inputs after = { 0.0, 0.0, piece(&memory, b), piece(&memory, k) };
    Inputs goal = { 0.0, 0.0, piece(&memory, b), piece(&memory, k) };
    double *rest = piece(&memory, b);
    Memory step = { piece(&memory, b), piece(&memory, b), piece(&memory, b), piece(&memory, b),
                    piece(&memory, b), piece(&memory, b), piece(&memory, k), piece(&memory, 24 * k + 40),
                    (double (*)[3])piece(&memory, 3 * k), (double (*)[3])piece(&memory, 3 * k) };
    for (int64_t j = 0; j < b; j++) { /* pretensioned: one tension, no friction, creep at rest */
        state.tension[j] = chain->pretension;
        for (int64_t c = j * chain->creeps; c < (j + 1) * chain->creeps; c++)
            state.creep[c] = chain->creep_compliance[c] * chain->pretension;
    }
    for (int64_t i = 1; i < k - 1; i++) goal.turns[i] = imposed->turns[i - 1];
    find_rest(chain, goal.turns, rest);
    impose(&before, chain, imposed, 0);
    *passes = 0;
    for (int64_t g = 0; g < imposed->times; g++) {
        impose(&after, chain, imposed, g);
        double done = 0.0, part = 1.0;
        while (done < 1.0) { /* at most 4096 parts */
            double next = done + part < 1.0 ? done + part : 1.0;
            between(&goal, &before, &after, next, k);
            int64_t used = advance(chain, &state, rest, &goal, (next - done) * imposed->span[g], &step);
            steps++;
            *passes += used < 0 ? -used : used;
            if (used >= 0) done = next;
            else if ((part *= 0.5) < LEAST_PART) return -g - 1;
        }
        if (imposed->keep[g]) record(records, kept++, &state, k);
        Inputs swap = before;
        before = after, after = swap;
    }
    return steps;
}

int64_t march(const Chain *chain, const Imposed *imposed, Records *records, int64_t *passes) {
    int64_t k = chain->nodes;
    double *memory = calloc((size_t)(60 * (k + 8) + (k + 1) * chain->creeps), sizeof *memory);
    int64_t steps = memory == NULL ? -1 : run(chain, imposed, records, passes, memory);
    free(memory);
    return steps;
}
