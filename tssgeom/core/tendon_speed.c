/* Friction that depends on speed, and the search for the speeds that it follows late; docs/model.md (52), (185), (313). */
#include "tendon_bars.h"

double speed_factor(const bar_laws *laws, double slid, double span, double at, double grows, double *slope) {
    double gain = laws->speed_gain, path = laws->speed_reference * span, factor = 1.0, rise = 0.0;
    if (gain != 0.0) factor = most(0.0, 1.0 + gain * log1p(slid / path)), rise = gain / (path + slid);
    const double *table = table_of(laws->tables, CURVE.speed);
    if (table) {
        double turn, value = table_value(table, at, &turn);
        rise = rise * value + factor * turn * grows, factor *= value;
    }
    *slope = rise;
    return factor;
}

double followed_speed(const bar_laws *laws, double before, double speed, double span) {
    double kept = exp(-span / laws->speed_memory);
    return copysign(kept * fabs(before) + (1.0 - kept) * fabs(speed), speed);
}

speed_search search_speeds(const bar_laws *laws) {
    const double *table = laws->speed_memory > 0.0 ? table_of(laws->tables, CURVE.speed) : NULL;
    return (speed_search){.share = 1.0, .close = table ? SOLVER.speeds * table[(int64_t)table[0]] : -1.0};
}

void compare_speeds(speed_search *search, int64_t k, const double taken[], const double followed[]) {
    for (int64_t i = 0; i < k; i++) {
        double off = fabs(followed[i]) - taken[i];
        search->sum += off, search->most = most(search->most, fabs(off));
    }
}

int go_on(speed_search *search) {
    int again = search->most > search->close && search->close >= 0.0;
    double fell = search->before - search->sum;
    if (search->before != 0.0 && fell != 0.0)
        search->share = within(search->share * search->before / fell, 1.0 / SOLVER.speed_share, SOLVER.speed_share);
    search->before = search->sum, search->sum = search->most = 0.0;
    return again;
}

void renew_speeds(const speed_search *search, int64_t k, double taken[], const double followed[]) {
    for (int64_t i = 0; i < k; i++)
        taken[i] = most(0.0, taken[i] + search->share * (fabs(followed[i]) - taken[i]));
}
