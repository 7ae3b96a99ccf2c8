/* One step of the chain: backward Euler, balanced to rounding.

   Nothing here knows a closed form of the tension along a sheath. A node is in balance when the two bars and
   the friction, projected on the tangent of the sheath, add to zero; the bars press the contact force into
   it. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "lumped.h"

static const double TOLERANCE = 1e-9; /* N, between passes; displacements of 1e-2 m round so */
enum { PASSES = 60 };                 /* more than that and the step is halved */

static double turn_of_bar(const Chain *chain, const double *turns, int64_t j) {
    return j > 0 && j < chain->nodes ? 0.5 * (turns[j - 1] + turns[j]) : 0.0;
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
        double right = j < k ? state->position[j] : goal->out;
        memory->base[j] = rest[j] + goal->growth[j] - chain->expansion[j] * goal->warmth;
        memory->base[j] += left - right;
        memory->soft[j] = chain->compliance[j] * goal->compliance[j];
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
    held[0] *= goal->friction[i], held[1] *= goal->friction[i];
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

void take_over(
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

/* Curved laws are straightened about the last pass until the tensions stay; straight laws need one. */
int64_t balance(
    const Chain *chain, const State *state, const double *rest, const Inputs *goal, double span,
    Memory *memory) {
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
        if (change < TOLERANCE || (chain->straight && done == 0)) return done + 1;
    }
    return -PASSES;
}

void find_rest(const Chain *chain, const double *turns, const double *compliance, double *rest) {
    double tension = chain->pretension;
    for (int64_t j = 0; j < chain->nodes + 1; j++) {
        double creep = 0.0, clearance = chain->clearance_per_turn * turn_of_bar(chain, turns, j);
        for (int64_t c = 0; c < chain->creeps; c++) creep += chain->creep_compliance[j * chain->creeps + c];
        rest[j] = (chain->compliance[j] * compliance[j] + creep) * tension;
        rest[j] -= chain->toe[j] * expm1(-tension / chain->toe_scale[j]);
        rest[j] -= clearance * expm1(-tension / chain->clearance_scale);
    }
    rest[0] -= chain->slack;
}
