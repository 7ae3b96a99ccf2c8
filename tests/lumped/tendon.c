/* One tendon in time: its memory, what is imposed on it, and how its ends answer. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lumped.h"

struct Tendon {
    const Chain *chain;
    State state;
    Inputs before, after, goal; /* of the grid points on both sides, and of the part of a step between them */
    double *rest;
    Memory step;
};

/* Cut a piece off memory. */
static double *piece(double **memory, int64_t count) {
    double *result = *memory;
    *memory += count;
    return result;
}

/* Mix two rows of `count` entries. */
static void row_between(
    double *to, const double *from, int64_t count, int64_t before, int64_t after, double share) {
    const double *a = from + before * count, *b = from + after * count;
    for (int64_t i = 0; i < count; i++) to[i] = (1.0 - share) * a[i] + share * b[i];
}

/* Put in what is imposed at grid point g, between two frames of the path. */
static void impose(Inputs *now, const Chain *chain, const Imposed *imposed, int64_t g) {
    int64_t k = chain->nodes, at = imposed->frame[g];
    int64_t after = at + 1 < imposed->frames ? at + 1 : imposed->frames - 1;
    double share = imposed->weight[g];
    now->drive = imposed->drive[g], now->warmth = imposed->warmth[g];
    now->growth[0] = now->growth[k] = now->turns[0] = now->turns[k - 1] = 0.0;
    now->compliance[0] = now->compliance[k] = now->friction[0] = now->friction[k - 1] = 1.0;
    row_between(now->growth + 1, imposed->growth, k - 1, at, after, share);
    row_between(now->turns + 1, imposed->turns, k - 2, at, after, share);
    row_between(now->friction + 1, imposed->friction, k - 2, at, after, share);
    row_between(now->compliance + 1, imposed->compliance, k - 1, at, after, share);
}

static double mixed(double before, double after, double share) {
    return share < 1.0 ? before + share * (after - before) : after;
}

static void between(Inputs *goal, const Inputs *before, const Inputs *after, double share, int64_t k) {
    goal->drive = mixed(before->drive, after->drive, share);
    goal->warmth = mixed(before->warmth, after->warmth, share);
    for (int64_t j = 0; j < k + 1; j++) goal->growth[j] = mixed(before->growth[j], after->growth[j], share);
    for (int64_t j = 0; j < k + 1; j++)
        goal->compliance[j] = mixed(before->compliance[j], after->compliance[j], share);
    for (int64_t i = 0; i < k; i++) {
        goal->turns[i] = mixed(before->turns[i], after->turns[i], share);
        goal->friction[i] = mixed(before->friction[i], after->friction[i], share);
    }
}

static void write_row(double *to, const double *from, int64_t row, int64_t count, int64_t ends_only) {
    if (ends_only) to[2 * row] = from[0], to[2 * row + 1] = from[count - 1];
    else memcpy(to + row * count, from, (size_t)count * sizeof *from);
}

void tendon_record(const Tendon *tendon, Records *records, int64_t row) {
    const State *state = &tendon->state;
    int64_t k = tendon->chain->nodes;
    write_row(records->tension, state->tension, row, k + 1, records->ends_only);
    write_row(records->position, state->position, row, k, records->ends_only);
    write_row(records->friction, state->friction, row, k, records->ends_only);
    write_row(records->slip, state->slip, row, k, records->ends_only);
    records->work[row] = state->work;
}

Tendon *tendon_new(const Chain *chain, const Imposed *imposed) {
    int64_t k = chain->nodes, b = k + 1;
    size_t room = (size_t)(66 * (k + 8) + b * chain->creeps) * sizeof(double);
    Tendon *tendon = calloc(1, sizeof *tendon + room);
    if (tendon == NULL) return NULL;
    double *memory = (double *)(tendon + 1);
    tendon->chain = chain;
    tendon->state = (State){ piece(&memory, k), piece(&memory, b), piece(&memory, k), piece(&memory, k),
                             piece(&memory, k), piece(&memory, k), piece(&memory, b * chain->creeps), 0.0 };
    Inputs *inputs[] = { &tendon->before, &tendon->after, &tendon->goal };
    for (int n = 0; n < 3; n++)
        *inputs[n] = (Inputs){ 0.0, 0.0, 0.0, piece(&memory, b), piece(&memory, k), piece(&memory, k),
                               piece(&memory, b) };
    tendon->rest = piece(&memory, b);
    tendon->step = (Memory){ piece(&memory, b), piece(&memory, b), piece(&memory, b), piece(&memory, b),
                             piece(&memory, b), piece(&memory, b), piece(&memory, k),
                             piece(&memory, 24 * k + 40), (double (*)[3])piece(&memory, 3 * k),
                             (double (*)[3])piece(&memory, 3 * k) };
    for (int64_t j = 0; j < b; j++) { /* pretensioned: one tension, no friction, creep at rest */
        tendon->state.tension[j] = chain->pretension;
        for (int64_t c = j * chain->creeps; c < (j + 1) * chain->creeps; c++)
            tendon->state.creep[c] = chain->creep_compliance[c] * chain->pretension;
    }
    for (int64_t i = 1; i < k - 1; i++) tendon->goal.turns[i] = imposed->turns[i - 1];
    for (int64_t j = 0; j < b; j++)
        tendon->goal.compliance[j] = j > 0 && j < k ? imposed->compliance[j - 1] : 1.0;
    find_rest(chain, tendon->goal.turns, tendon->goal.compliance, tendon->rest);
    impose(&tendon->after, chain, imposed, 0);
    return tendon;
}

void tendon_free(Tendon *tendon) { free(tendon); }

void tendon_next(Tendon *tendon, const Imposed *imposed, int64_t g) {
    Inputs swap = tendon->before;
    tendon->before = tendon->after, tendon->after = swap;
    impose(&tendon->after, tendon->chain, imposed, g);
}

double tendon_part(Tendon *tendon, double share) {
    between(&tendon->goal, &tendon->before, &tendon->after, share, tendon->chain->nodes);
    return tendon->goal.drive;
}

int64_t tendon_try(Tendon *tendon, double drive, double out, double span) {
    tendon->goal.drive = drive, tendon->goal.out = out;
    return balance(tendon->chain, &tendon->state, tendon->rest, &tendon->goal, span, &tendon->step);
}

void tendon_keep(Tendon *tendon, double span) {
    take_over(tendon->chain, &tendon->state, &tendon->goal, &tendon->step, span);
}

/* A node that holds its position for small changes of tension. One without friction never does. */
static int sticks(const Memory *step, int64_t i) {
    const double *up = step->up[i], *down = step->down[i];
    return step->moved[i] == 0.0 && (up[0] != down[0] || up[1] != down[1]);
}

/* From an end inwards the change of tension is T[0] a + T[1] e and that of motion w[0] a + w[1] e: a changes
   the tension at this end, e moves it. The first thing that holds (a node that sticks, a slack bar, the other
   end) says a of e and of what happens at the other end. */
void tendon_ends(const Tendon *tendon, double ends[6]) {
    const Memory *step = &tendon->step;
    int64_t k = tendon->chain->nodes;
    const double *tension = step->tension;
    ends[0] = tension[0], ends[1] = tension[k];
    for (int side = 0; side < 2; side++) { /* 0: from the drive, 1: from the load */
        double T[2] = { 1.0, 0.0 }, w[2] = { 0.0, 1.0 }, held[2] = { 0.0, 0.0 }, other = 0.0;
        for (int64_t n = 0; n <= k; n++) {
            int64_t j = side ? k - n : n, i = side ? j - 1 : j;
            held[0] = T[0], held[1] = T[1];
            if (tension[j] <= 0.0) break;
            for (int c = 0; c < 2; c++) w[c] += (side ? 1.0 : -1.0) * step->slope[j] * T[c];
            held[0] = w[0], held[1] = w[1];
            if (n == k) {
                other = 1.0;
                if (side && tendon->chain->force_driven) held[0] = T[0], held[1] = T[1];
                break;
            }
            if (sticks(step, i)) break;
            const double *law = step->moved[i] < 0.0 ? step->down[i] : step->up[i];
            for (int c = 0; c < 2; c++)
                T[c] = side ? law[0] * T[c] + law[2] * w[c] : (T[c] - law[2] * w[c]) / law[0];
        }
        double *slopes = ends + 2 + 2 * side; /* by the drive, by the load */
        slopes[side] = -held[1] / held[0], slopes[1 - side] = other / held[0];
        if (!side && tendon->chain->force_driven) slopes[0] = 1.0, slopes[1] = 0.0;
    }
}
