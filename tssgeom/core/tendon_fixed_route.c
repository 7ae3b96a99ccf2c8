/* A chain of bars on a route that stands: exact there, and the first guess of an equilibrium elsewhere.

   The tension is carried from the drive to the load, as far as the friction of each contact makes it; a
   position finds its tension by the secant method; docs/model.md (3), (47). */
#include "tendon_bars.h"

/* Carry tension[0] to the distal end as on a fixed route; returns the stretch gained [m], and its slope;
   docs/model.md (64). */
static double carry(const bar_chain *c, double *slope) {
    double gained = 0.0, gain = 0.0, share = 1.0, *tension = c->tension;
    if (c->stiffness[0] > 0.0)
        gained = (tension[0] - c->trial[0]) / c->stiffness[0], gain = 1.0 / c->stiffness[0];
    for (int64_t i = 0; i < c->k; i++) {
        double lower = c->low[i] * tension[i] - c->force[i], upper = c->high[i] * tension[i] + c->force[i];
        double here = most(0.0, c->trial[i + 1]);
        c->slip[i] = STUCK;
        if (here < lower) here = lower, c->slip[i] = PULLED, share *= c->low[i];
        else if (here > upper) here = upper, c->slip[i] = RELEASED, share *= c->high[i];
        else share = 0.0;
        tension[i + 1] = here;
        if (c->stiffness[i + 1] > 0.0) {
            gained += (here - c->trial[i + 1]) / c->stiffness[i + 1];
            gain += share / c->stiffness[i + 1];
        }
    }
    *slope = gain;
    return gained;
}

/* Proximal tensions between which the load stays: its own, shrunk and grown by all cones; docs/model.md (47). */
void range_of_drive(
    int64_t k, double weight, const double low[], const double high[], const double force[],
    double range[2]) {
    range[0] = weight, range[1] = weight;
    for (int64_t i = k - 1; i >= 0; i--) {
        range[0] = most(0.0, range[0] - force[i]) / high[i];
        range[1] = (range[1] + force[i]) / low[i];
    }
}

/* Carry the tension of a range that gains the shift; returns what is gained [m]. */
static double find_drive(const bar_chain *c, const double range[2]) {
    double lowest = range[0], highest = range[1], below = lowest, above = highest, *start = c->tension, slope;
    start[0] = within(c->trial[0], lowest, highest);
    for (int64_t secant = 0; secant < SOLVER.trials; secant++) {
        double gained = carry(c, &slope);
        if (gained > c->shift) above = start[0];
        else below = start[0];
        double new = start[0] - (gained - c->shift) / most(1e-3 / c->stiffness[1], slope);
        if ((new <= below && below == lowest) || (new >= above && above == highest))
            new = least(highest, most(lowest, new));
        else if (!(below < new && new < above))
            new = above == INFINITY ? 2.0 * below + 1.0 : 0.5 * (below + above);
        if (fabs(new - start[0]) <= 1e-13 * start[0]) break;
        start[0] = new;
    }
    return carry(c, &slope);
}

void guess_fixed_route(bar_chain *c, int hanging) {
    int64_t k = c->k;
    double range[2] = {0.0, INFINITY}, slope;
    for (int64_t j = 0; j <= k; j++) c->tight[j] = 1;
    if (!c->rigid_in && c->stiffness[0] == 0.0) {
        c->tension[0] = c->trial[0];
        carry(c, &slope);
        return;
    }
    if (hanging) range_of_drive(k, c->trial[k], c->low, c->high, c->force, range);
    double gained = find_drive(c, range), drive = c->tension[0];
    if (drive >= range[1])
        for (int64_t i = 0; i < k; i++) c->slip[i] = PULLED;
    else if (hanging && 0.0 < drive && drive <= range[0])
        for (int64_t i = 0; i < k; i++) c->slip[i] = RELEASED;
    else if (drive <= 0.0 && gained > c->shift)
        c->tight[0] = 0; /* more is given than the tendon can take back */
}
