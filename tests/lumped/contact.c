/* The local laws of the chain: how a bar stretches and what a contact can hold. */
#include <math.h>
#include <stdint.h>

#include "lumped.h"

/* Below it a friction coefficient that depends on the load does so no more [N]. */
static const double LEAST_LOAD = 1e-3;

/* extension = compliance T + toe (1 − e^(−T/toe_scale)) + clearance (1 − e^(−T/clearance_scale)) */
double stretched(
    double tension, double compliance, double toe, double toe_scale, double clearance, double clearance_scale,
    double *slope) {
    double a = toe * exp(-tension / toe_scale), b = clearance * exp(-tension / clearance_scale);
    *slope = compliance + a / toe_scale + b / clearance_scale;
    return compliance * tension + (toe - a) + (clearance - b);
}

/* law: gain, reference speed, Stribeck gain, Stribeck speed */
double speed_factor(double speed, const double law[4], double *slope) {
    *slope = (law[0] > 0.0 ? law[0] : 0.0) / (law[1] + speed);
    return 1.0 + law[0] * log1p(speed / law[1]) + law[2] * exp(-speed / law[3]);
}

/* Two bars that pull with a and b press (a + b) sin(turn/2) into a vertex; `total` is a + b [N]. */
void grip(const Chain *chain, double turn, double travel, double total, int64_t i, double result[2]) {
    if (i == 0 || i == chain->nodes - 1) {
        result[0] = result[1] = 0.5 * chain->friction[i];
        return;
    }
    double press = sin(0.5 * turn);
    result[0] = result[1] = 0.0;
    if (press == 0.0) return;
    double both = chain->friction[i] * press * (1.0 + chain->curvature_gain * turn / chain->share[i]);
    if (chain->wear_gain != 0.0) both *= 1.0 - chain->wear_gain * expm1(-travel / chain->wear_travel);
    if (chain->load_exponent != 0.0) {
        double load = fmax(0.5 * total, LEAST_LOAD) / chain->load_reference;
        if (chain->load_is_normal) load *= 2.0 * press / chain->share[i];
        both *= pow(load, chain->load_exponent);
    }
    result[0] = both * (1.0 + chain->asymmetry);
    result[1] = both * (1.0 - chain->asymmetry);
}
