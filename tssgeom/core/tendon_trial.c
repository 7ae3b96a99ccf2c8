/* One tendon of a machine in a trial of its coordinates: its balance, and how its tensions follow from its ends. */
#include "tendon_machine.h"

#include <string.h>

/* Stretch per tension of one bar [m/N]; 0 where nothing of it moves, without end where it is slack. */
static double softness(const bar_chain *c, int64_t j) {
    return !(c->tension[j] > 0.0) ? INFINITY : c->stiffness[j] > 0.0 ? 1.0 / c->stiffness[j] : 0.0;
}

/* Ratio of the tensions behind and before a contact, and its friction for each metre that it moves, both with what
   its own tensions make of them; returns whether it moves at all. */
static int moves(const pulled *own, int64_t i, double *ratio, double *drag) {
    const bar_chain *c = &own->room.chain;
    int8_t slip = c->slip[i];
    *ratio = slip == PULLED ? c->low[i] : slip == RELEASED ? c->high[i] : 1.0;
    *drag = slip == STUCK ? c->bristle[i] : c->drag[i];
    if (own->laws.loaded && slip != STUCK) { /* docs/model.md (346) */
        double exponent = slip == PULLED ? own->room.pulling[i] : own->room.releasing[i];
        double by_load = -0.5 * slip * *ratio * c->tension[i] * exponent * own->room.steep[i];
        *ratio = (*ratio + by_load) / (1.0 - by_load), *drag /= 1.0 - by_load;
    }
    return *drag < INFINITY;
}

/* Slopes of both tensions: a contact that moves passes a change on, one that does not ends it; (174), (280). */
static end_forces slopes_of(const pulled *own, int by_force) {
    const bar_chain *c = &own->room.chain;
    int64_t k = c->k, first = 0, last = k - 1; /* contacts that do not move, the nearest to drive and load */
    end_forces f = {.in = c->tension[0], .out = c->tension[k]};
    double ratio, drag, share = 1.0, sides = 1.0;
    while (first < k && moves(own, first, &ratio, &drag)) first++;
    while (last >= 0 && moves(own, last, &ratio, &drag)) last--;
    if (!by_force && f.in > 0.0) { /* as the drive feels it */
        double soft = softness(c, first);
        for (int64_t i = first - 1; i >= 0; i--) {
            moves(own, i, &ratio, &drag);
            double behind = drag == 0.0 ? ratio * soft : ratio / (1.0 / soft + drag), bar = softness(c, i);
            soft = bar + behind;
            share *= bar == 0.0 ? behind > 0.0 : behind / soft;
            sides *= ratio;
        }
        f.in_by_in = 1.0 / soft;
        if (first < k) share = 0.0;
        if (share > 0.0) f.out_by_in = share / softness(c, k), f.in_by_out = -f.out_by_in / sides;
    }
    if (f.out > 0.0) { /* as the load feels it */
        double soft = last >= 0 ? softness(c, last + 1) : by_force ? INFINITY : softness(c, 0);
        for (int64_t i = last + 1; i < k; i++) {
            moves(own, i, &ratio, &drag);
            soft = softness(c, i + 1) + (drag == 0.0 ? soft / ratio : 1.0 / (ratio / soft + drag));
        }
        f.out_by_out = -1.0 / soft;
    }
    return f;
}

pulled *begin_tendons(int64_t n, int64_t k, const double *plant, double *room, double *work) {
    pulled *tendons = (pulled *)room;
    for (int64_t i = 0; i < n; i++) {
        tendons[i].laws = laws_of(k, plant + i * (17 * (k + 1) + 430));
        tendons[i].room = room_of(k, work + 21 * i * (k + 1));
        tendons[i].room.steep = work + (21 * i + 20) * (k + 1);
        begin_room(&tendons[i].laws, &tendons[i].room);
    }
    return tendons;
}

int try_tendon(const sample *it, int64_t i, const double z[]) {
    int64_t k = it->k, solves;
    pulled *own = it->tendons + i;
    bar_laws *laws = &own->laws;
    step_room *room = &own->room;
    bar_memory before = memory_of(k, (double *)it->before + i * (9 * (k + 1) + 7));
    double end = it->end[i], engaged = before.held[HELD.engaged], finite = 0.0;
    creep_shares shares[CREEPS];
    own->drive = it->drive[i];
    for (int64_t j = 0; j < it->m; j++) {
        own->drive += it->proximal[i * it->m + j] * z[j];
        end += it->distal[i * it->m + j] * z[j];
    }
    if (laws->speed_memory > 0.0) room->taken = it->taken + i * (k + 1), room->taken_given = 1;
    own->target = own->drive;
    if (!it->by_force) own->target = least(own->drive + laws->backlash, most(own->drive, engaged)); /* (59) */
    if (laws->worn) set_step_factor(laws, &before, before.held[HELD.time] + it->span);
    for (int64_t j = 0; j <= k; j++) it->rest[j] = laws->rest[j] + before.rest[j];
    it->rest[k] -= end; /* docs/model.md (172) */
    set_shares(laws, it->span, shares);
    double change = balance_room(
        laws, &before, room, shares, it->by_force, own->target, 0.0, it->warmth, it->span, it->rest, &solves);
    const bar_chain *c = &room->chain;
    for (int64_t j = 0; j < k; j++) finite += 0.0 * c->tension[j] + 0.0 * c->w[j];
    if (!(change <= 1e2 * SOLVER.accepted) || finite + 0.0 * c->tension[k] != 0.0) return 0;
    own->forces = slopes_of(own, it->by_force);
    if (own->target == engaged && laws->backlash > 0.0) own->forces.in_by_in = own->forces.out_by_in = 0.0;
    return 1;
}

int keep_trial(const sample *it) {
    int64_t size = 9 * (it->k + 1) + 7;
    memcpy(it->trial, it->before, (size_t)(it->n * size) * sizeof(double));
    for (int64_t i = 0; i < it->n; i++) {
        pulled *own = it->tendons + i;
        bar_memory memory = memory_of(it->k, it->trial + i * size);
        creep_shares shares[CREEPS];
        set_shares(&own->laws, it->span, shares);
        if (!keep(&own->laws, &memory, &own->room.chain, shares, it->span)) return 0;
        memory.held[HELD.time] += it->span, memory.held[HELD.engaged] = own->target;
        memory.held[HELD.drive] = own->drive;
    }
    return 1;
}
