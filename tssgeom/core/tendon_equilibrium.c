/* Equilibrium of a loaded tendon whose every contact may stick or slide: one step, any size.

   The tendon is a chain of elastic bars between contacts. A contact with movement w > 0 slides towards the
   proximal end and is on the lower side of its friction cone, one with w < 0 on the upper side; inside it
   sticks, or gives way like a spring. Policy iteration on a tridiagonal M-matrix determines which contacts
   slide; docs/model.md (40)-(46), (279). */
#include "tendon_bars.h"

/* Whether a contact gives way before it slides. */
static inline int gives(const bar_chain *c, int64_t i) { return c->bristle[i] < INFINITY; }

/* Solve the bar laws with every contact doing what `slip` says, for the movements w [m]. */
static void solve(const bar_chain *c) {
    int64_t k = c->k;
    for (int64_t i = 0; i < k; i++) {
        double before = 0.0, here = 1.0, behind = 0.0, right = 0.0;
        if (i == 0 && c->rigid_in && c->tight[0]) {
            right = c->shift;
        } else if ((c->slip[i] != STUCK || gives(c, i)) && !(i == k - 1 && c->rigid_out)) {
            int slides = c->slip[i] != STUCK; /* else it gives way; docs/model.md (279) */
            double side = !slides ? 1.0 : c->slip[i] == PULLED ? c->low[i] : c->high[i];
            double drag = slides ? c->drag[i] : c->bristle[i];
            double near = c->tight[i] ? side * c->stiffness[i] : 0.0;
            double far = c->tight[i + 1] ? c->stiffness[i + 1] : 0.0;
            if (near + far + drag > 0.0) {
                before = -near, here = near + far + drag, behind = -far; /* docs/model.md (43) */
                right = slides ? -c->slip[i] * c->force[i] : -c->kept[i];
                if (c->tight[i]) right += side * c->trial[i];
                if (c->tight[i + 1]) right -= c->trial[i + 1];
            }
        }
        if (i > 0) here -= before * c->ratios[i - 1], right -= before * c->w[i - 1];
        if (here <= 0.0) behind = 0.0, here = 1.0, right = 0.0; /* slack all around: any movement will do */
        c->ratios[i] = behind / here;
        c->w[i] = right / here;
    }
    for (int64_t i = k - 2; i >= 0; i--) c->w[i] -= c->ratios[i] * c->w[i + 1];
}

/* Tension of a bar by Hooke's law alone, negative where slack [N]; docs/model.md (40). */
static inline double linear(const bar_chain *c, int64_t j) {
    double near = j > 0 ? c->w[j - 1] : 0.0, far = j < c->k ? c->w[j] : 0.0;
    return c->trial[j] + c->stiffness[j] * (near - far);
}

/* Tension before a contact that gives way, from that behind it [N]; docs/model.md (279). */
static inline double given_way(const bar_chain *c, int64_t i) {
    return c->tension[i + 1] + c->kept[i] + c->bristle[i] * c->w[i];
}

/* Set the tension of every bar from the movements, zero where it is slack; docs/model.md (40), (45). */
static void set_tensions(const bar_chain *c) {
    int64_t last_contact = c->k - 1;
    double *tension = c->tension;
    for (int64_t j = 0; j <= c->k; j++) tension[j] = most(0.0, linear(c, j));
    if (c->rigid_in) { /* docs/model.md (45) */
        double upper = (tension[1] + c->force[0] + c->drag[0] * c->w[0]) / c->low[0];
        double lower = most(0.0, tension[1] - c->force[0] + c->drag[0] * c->w[0]) / c->high[0];
        double still = gives(c, 0) ? given_way(c, 0) : c->trial[0]; /* within the cone */
        int slides = c->w[0] != 0.0 && !gives(c, 0);
        double held = !slides ? least(upper, most(lower, still)) : c->w[0] > 0.0 ? upper : lower;
        tension[0] = c->w[0] > c->shift ? 0.0 : held;
    }
    if (c->rigid_out) {
        double near = tension[last_contact], force = c->force[last_contact]; /* of the bar and the contact before it */
        double still = gives(c, last_contact) ? near - c->kept[last_contact] : c->trial[last_contact + 1];
        double here = most(c->low[last_contact] * near - force, still);
        tension[last_contact + 1] = most(0.0, least(c->high[last_contact] * near + force, here));
    }
}

/* How far a contact is above both sides of its cone, and its movement, all as forces [N]. */
typedef struct {
    double low, high, motion;
} cone_excess;

/* docs/model.md (41), (42) */
static inline cone_excess excess(const bar_chain *c, int64_t i, double near, double far) {
    if (i == 0 && c->rigid_in) near = 0.0; /* a rigid end is judged as if it were loose */
    double motion = gives(c, i) ? far - near + c->kept[i] + c->bristle[i] * c->w[i] /* docs/model.md (279) */
                                : SOLVER.motion * (c->stiffness[i] + c->stiffness[i + 1]) * c->w[i];
    far += c->drag[i] * c->w[i];
    return (cone_excess){
        far - c->low[i] * near + c->force[i], far - c->high[i] * near - c->force[i], motion};
}

/* The same with tight bars linear even below zero, and slack bars at zero. */
static inline cone_excess marked_excess(const bar_chain *c, int64_t i) {
    return excess(c, i, c->tight[i] ? linear(c, i) : 0.0, c->tight[i + 1] ? linear(c, i + 1) : 0.0);
}

static double greatest(int64_t n, const double values[]) {
    double result = values[0];
    for (int64_t i = 1; i < n; i++) result = most(result, values[i]);
    return result;
}

/* Mark anew which bars are tight; returns whether any mark changed. */
static int mark_tight(const bar_chain *c, double tie) {
    int changed = 0;
    for (int64_t j = c->rigid_in ? 1 : 0; j <= c->k; j++) {
        int now = linear(c, j) >= -tie;
        changed |= now != c->tight[j];
        c->tight[j] = (int8_t)now;
    }
    return changed;
}

static inline int64_t free_contacts(const bar_chain *c) { return c->rigid_out ? c->k - 1 : c->k; }

/* Greatest residual of the complementarity [N]; with `renew`, chooses slip and tight anew. */
static double judge(const bar_chain *c, int renew) {
    double worst = 0.0;
    for (int64_t i = 0; i < free_contacts(c); i++) {
        cone_excess over = excess(c, i, c->tension[i], c->tension[i + 1]);
        double left = least(most(over.high, over.motion), over.low); /* docs/model.md (42) */
        if (i == 0 && c->rigid_in) {
            double taut = c->stiffness[1] * (c->w[0] - c->shift);
            if (renew) c->tight[0] = taut <= left;
            left = least(taut, left);
        }
        double stiff = c->stiffness[i] + c->stiffness[i + 1] + (gives(c, i) ? c->bristle[i] : 0.0);
        double rounding = ROUNDING.single * stiff * fabs(c->w[i]);
        worst = most(fabs(left) - rounding, worst);
        if (renew) c->slip[i] = over.low < over.motion ? PULLED : over.high > over.motion ? RELEASED : STUCK;
    }
    if (renew) mark_tight(c, SOLVER.accuracy * (greatest(c->k + 1, c->tension) + 1e-9));
    return worst;
}

/* Solves spent and the residual of the semi-smooth Newton iteration. */
static int64_t newton(const bar_chain *c, double accepted, int64_t patience, double *residual) {
    *residual = INFINITY;
    for (int64_t turn = 0; turn < patience; turn++) {
        if (turn > 0) judge(c, 1);
        solve(c);
        set_tensions(c);
        *residual = judge(c, 0);
        if (*residual <= accepted) return turn + 1;
    }
    return patience;
}

/* Choose anew which contacts that are not pulled are released; returns whether any changed. */
static int choose_released(const bar_chain *c, double tie) {
    int changed = 0;
    for (int64_t i = 0; i < free_contacts(c); i++) {
        cone_excess over = marked_excess(c, i);
        if (c->slip[i] == STUCK && over.high > tie + over.motion) c->slip[i] = RELEASED, changed = 1;
        else if (c->slip[i] == RELEASED && over.motion > tie + over.high) c->slip[i] = STUCK, changed = 1;
    }
    return changed;
}

/* Choose anew which contacts are pulled, and whether a rigid drive is taut; returns whether any changed. */
static int choose_pulled(const bar_chain *c, double tie) {
    int changed = 0;
    for (int64_t i = 0; i < free_contacts(c); i++) {
        cone_excess over = marked_excess(c, i);
        double other = most(over.high, over.motion);
        if (i == 0 && c->rigid_in) {
            double taut = c->stiffness[1] * (c->w[0] - c->shift);
            int now = taut <= least(other, over.low) + (c->tight[0] ? tie : -tie);
            if (c->tight[0] != now) c->tight[0] = (int8_t)now, changed = 1;
        }
        if (c->slip[i] != PULLED && over.low < other - tie) c->slip[i] = PULLED, changed = 1;
        else if (c->slip[i] == PULLED && other < over.low - tie)
            c->slip[i] = over.high > over.motion ? RELEASED : STUCK, changed = 1;
    }
    return changed;
}

/* Solve by policy iteration within policy iteration, which cannot cycle; returns the solves spent.

   The inner loop decides what is released, the outer one what is pulled, and each w is above the one before.
   Slack bars stay as they are marked; docs/model.md (46). */
static int64_t solve_nested(const bar_chain *c, double tie) {
    int64_t solves = 0;
    for (int64_t outer = 0; outer < 4 * c->k; outer++) {
        for (int64_t inner = 0; inner < 4 * c->k; inner++) {
            solve(c);
            solves++;
            if (!choose_released(c, tie)) break;
        }
        if (!choose_pulled(c, tie)) break;
    }
    return solves;
}

/* Movement [m] to one side of the cone; near and far without it, negative where slack [N]. */
static double balanced_move(
    const bar_chain *c, int64_t i, double near, double far, double side, double kept, double drag) {
    double k_near = c->stiffness[i], k_far = c->stiffness[i + 1];
    double move = (side * near + kept - far) / (k_far + side * k_near + drag);
    if (move > 0.0 && far + k_far * move < 0.0 && side * k_near + drag > 0.0) /* the far bar stays slack */
        return (side * near + kept) / (side * k_near + drag);
    if (move < 0.0 && near - k_near * move < 0.0 && k_far + drag > 0.0) /* the near bar stays slack */
        return (kept - far) / (k_far + drag);
    return move;
}

/* Improve w by sweeps that balance one contact after the other, slowly but surely; docs/model.md (46). */
static void relax(const bar_chain *c, int64_t sweeps) {
    int64_t last_contact = c->k - 1, count = free_contacts(c);
    if (c->rigid_out) c->w[last_contact] = 0.0;
    for (int64_t pass = 0; pass < sweeps; pass++) {
        for (int64_t turn = 0; turn < count; turn++) {
            int64_t i = pass % 2 == 0 ? turn : count - 1 - turn;
            c->w[i] = 0.0;
            double near = i == 0 && c->rigid_in ? 0.0 : linear(c, i), far = linear(c, i + 1);
            double low = c->low[i], high = c->high[i], force = c->force[i], drag = c->drag[i];
            if (gives(c, i)) { /* docs/model.md (279) */
                double still = balanced_move(c, i, near, far, 1.0, -c->kept[i], c->bristle[i]);
                double released = balanced_move(c, i, near, far, high, force, drag);
                c->w[i] = most(balanced_move(c, i, near, far, low, -force, drag), least(still, released));
            } else if (most(0.0, far) < low * most(0.0, near) - force) /* outside of the cone; (41) */
                c->w[i] = most(0.0, balanced_move(c, i, near, far, low, -force, drag));
            else if (most(0.0, far) > high * most(0.0, near) + force)
                c->w[i] = least(0.0, balanced_move(c, i, near, far, high, force, drag));
            if (i == 0 && c->rigid_in) c->w[0] = most(c->shift, c->w[0]);
        }
    }
}

/* Free the tensions on the cone from the rounding of the solve, and mark the rigid ends. */
static void free_from_rounding(const bar_chain *c) {
    if (c->rigid_in) {
        double over = gives(c, 0) ? given_way(c, 0) - c->tension[0] : c->w[0];
        if (fabs(over) <= (gives(c, 0) ? ROUNDING.relative * c->tension[0] : 0.0)) over = 0.0;
        c->slip[0] = over > 0.0 ? PULLED : over < 0.0 ? RELEASED : STUCK;
    }
    if (c->rigid_out) c->slip[c->k - 1] = STUCK;
    for (int64_t i = 0; i < c->k; i++) {
        if (c->slip[i] == STUCK || !(c->tension[i + 1] > 0.0 && c->stiffness[i + 1] > 0.0)) continue;
        double side = c->slip[i] == PULLED ? c->low[i] : c->high[i];
        if (c->w[i] == 0.0 && !gives(c, i))
            c->slip[i] = STUCK; /* a mark left over from a bar that was taken for slack on the way */
        else
            c->tension[i + 1] = /* on the side of the cone; docs/model.md (41) */
                most(0.0, side * c->tension[i] - c->slip[i] * c->force[i] - c->drag[i] * c->w[i]);
    }
}

int64_t equilibrium(bar_chain *c, int hanging, int64_t from_before, int64_t from_guess, double *residual) {
    double scale = 1e-6;
    for (int64_t j = 0; j <= c->k; j++) scale = most(fabs(c->trial[j]), scale), c->tight[j] = 1;
    for (int64_t i = 0; i < c->k; i++) c->w[i] = 0.0;
    double accepted = SOLVER.accuracy * scale;
    int64_t solves = newton(c, accepted, from_before, residual);
    if (*residual > accepted) {
        guess_fixed_route(c, hanging);
        accepted = SOLVER.accuracy * most(greatest(c->k + 1, c->tension), scale);
        solves += newton(c, accepted, from_guess, residual);
    }
    int64_t sweeps = 20;
    for (int64_t attempt = 0; attempt < c->rounds && !(*residual <= accepted); attempt++, sweeps *= 4) {
        if (attempt > 0) {
            relax(c, sweeps);
            set_tensions(c);
            judge(c, 1);
        }
        for (int64_t marking = 0; marking < SOLVER.from_guess; marking++) {
            solves += solve_nested(c, 0.01 * accepted);
            set_tensions(c);
            *residual = judge(c, 0);
            if (*residual <= accepted || !mark_tight(c, accepted)) break;
        }
    }
    if (!(*residual <= accepted)) c->rounds = SOLVER.rounds / 2;
    free_from_rounding(c);
    return solves;
}

/** Return the equilibrium of bars between contacts that may stick or slide; docs/model.md (40)-(47).

`trial` [N] and `stiffness` [N/m] of each bar; `cone` [6, k] is low, high [1], force [N] and drag [N/m] of
each contact, then what it resists before it slides [N/m], inf where it does not give, and its friction before
the step [N]; (279). `shift` [m] is the movement of a rigid proximal end; `slip` [k] a guess. `from_before`,
`from_guess` are Newton iterations. Returns the solves spent, the tensions [N], movement [m] and slip of each
contact, and the residual [N]. */
ENTRY int64_t tss_equilibrium(
    int64_t k, const double trial[k + 1], const double stiffness[k + 1], const double cone[6][k],
    int64_t rigid_in, int64_t rigid_out, double shift, int64_t hanging, const double slip[k],
    int64_t from_before, int64_t from_guess, OUT double tension[k + 1], OUT double contacts[2][k],
    OUT double residual[1], WORK double work[20][k + 1]) {
    residual[0] = NAN;
    if (k == 0) return 0;
    bar_chain c = room_of(k, work[0]).chain;
    for (int64_t j = 0; j <= k; j++) c.trial[j] = trial[j], c.stiffness[j] = stiffness[j];
    for (int64_t i = 0; i < k; i++) {
        c.low[i] = cone[0][i], c.high[i] = cone[1][i], c.force[i] = cone[2][i], c.drag[i] = cone[3][i];
        c.bristle[i] = cone[4][i], c.kept[i] = cone[5][i], c.slip[i] = (int8_t)slip[i];
    }
    c.rounds = SOLVER.rounds, c.rigid_in = (int)rigid_in, c.rigid_out = (int)rigid_out, c.shift = shift;
    int64_t solves = equilibrium(&c, (int)hanging, from_before, from_guess, residual);
    for (int64_t j = 0; j <= k; j++) tension[j] = c.tension[j];
    for (int64_t i = 0; i < k; i++) contacts[0][i] = c.w[i], contacts[1][i] = c.slip[i];
    return solves;
}
