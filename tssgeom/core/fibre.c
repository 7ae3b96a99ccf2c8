#include "fibre.h"
#include "lanes.h"

#include <string.h>

/* Of the weight of all pieces, below which one is left out; chosen: of 24 to 200 gratings the evidence changes by
   less than 3e-4. Scale of a weight that is kept in range. */
static const double NEGLIGIBLE = 1e-8, LARGE = 1e100;

/* Both components of the curvature at a site, given the sites of its piece up to there. */
typedef struct {
    double covariance[STATES][STATES], mean[2][STATES];
} Smooth;

/* A piece that goes on: its first site, and ln weight, times 1/scale. */
typedef struct {
    double start, exponent, scale;
    Smooth at;
} Piece;

/* A piece that may end at a site. */
typedef struct {
    double upto; /* sum of the weights of those before it and its own */
    int64_t kind, start;
} Last;

/* What was sensed, and the prior of its pieces. */
typedef struct {
    int64_t n, k;
    const double *s, (*bend)[2], *precision, *variance, *decay, *share, rate;
    Step *steps;                       /* of each kind to each site [k][n] */
    double (*prior)[STATES][STATES];   /* covariance of each kind where a piece begins [k] */
} Fibre;

/* The covariance of states before a step with those after it. */
static inline void across(const Step *step, const Smooth *at, double out[STATES][STATES]) {
    for (int64_t a = 0; a < STATES; a++)
        for (int64_t b = 0; b < STATES; b++) {
            out[a][b] = 0.0;
            for (int64_t c = a; c < STATES; c++) out[a][b] += step->over[a][c] * at->covariance[c][b];
        }
}

INLINE void carry(const Step *step, Smooth *at) {
    Lanes rows[STATES], mean[2] = {all(0.0), all(0.0)};
    for (int64_t a = 0; a < STATES; a++) rows[a] = load(at->covariance[a]);
    for (int64_t a = 0; a < STATES; a++) {
        Lanes with = all(0.0), sum = load(step->added[a]);
        for (int64_t c = a; c < STATES; c++) with += step->over[a][c] * rows[c];
        for (int64_t c = 0; c < STATES; c++) sum += with[c] * load(step->columns[c]);
        store(sum, at->covariance[a]);
        for (int64_t e = 0; e < 2; e++) mean[e] += at->mean[e][a] * load(step->columns[a]);
    }
    for (int64_t e = 0; e < 2; e++) store(mean[e], at->mean[e]);
}

/* Take in what a grating sensed; the ln likelihood is the result less ln scale. */
INLINE double observe(Smooth *at, const double bend[2], double precision, double *scale) {
    double off[2] = {bend[0] - at->mean[0][0], bend[1] - at->mean[1][0]};
    double total = 1.0 + at->covariance[0][0] * precision, weight = precision / total;
    Lanes with = load(at->covariance[0]);
    for (int64_t e = 0; e < 2; e++) store(load(at->mean[e]) + weight * off[e] * with, at->mean[e]);
    for (int64_t a = 0; a < STATES; a++)
        store(load(at->covariance[a]) - weight * with[a] * with, at->covariance[a]);
    *scale *= total;
    return -0.5 * weight * (squared(off[0]) + squared(off[1]));
}

static inline double goes_on(const Fibre *of, int64_t start, int64_t site) {
    return 1.0 / (1.0 + of->rate * (of->s[site] - of->s[start]));
}

/* Compute steps and priors once, where there is room for them. */
static void prepare(Fibre *of, double work[]) {
    of->steps = (Step *)work;
    of->prior = (double(*)[STATES][STATES])(work + of->k * of->n * OF_STEP);
    for (int64_t k = 0; k < of->k; k++) {
        grown(of->variance[k], of->decay[k], INFINITY, of->prior[k]);
        for (int64_t i = 0; i < of->n; i++)
            of->steps[k * of->n + i] =
                step_over(i > 0 ? of->s[i] - of->s[i - 1] : 0.0, of->variance[k], of->decay[k]);
    }
}

/* Take one site more into all pieces of a kind, and begin one there. */
static void extend(const Fibre *of, int64_t kind, int64_t j, Piece pieces[], int64_t count, double log_total) {
    double variance = of->variance[kind], decay = of->decay[kind];
    double straight = -0.5 * of->precision[j] * (squared(of->bend[j][0]) + squared(of->bend[j][1]));
    pieces[count] = (Piece){.start = (double)j, .exponent = log_total + log(of->share[kind]), .scale = 1.0};
    memcpy(pieces[count].at.covariance, of->prior[kind], sizeof of->prior[kind]);
    for (int64_t e = 0; e <= count; e++) {
        Piece *piece = pieces + e;
        if (decay > 0.0 && e < count) carry(of->steps + kind * of->n + j, &piece->at);
        if (variance > 0.0)
            piece->exponent += observe(&piece->at, of->bend[j], of->precision[j], &piece->scale);
        else
            piece->exponent += straight;
        if (piece->scale > LARGE) piece->exponent -= log(piece->scale), piece->scale = 1.0;
    }
}

/* Sum over all partitions, and the likeliest of them; all pieces that may end at a site where `last` is given. */
static double forward(
    const Fibre *of, int64_t origin[], int64_t kind[], Last *last, int64_t first[], double work[]) {
    Piece *pieces = (Piece *)work;
    double *likeliest = work + of->k * of->n * OF_PIECE, *count = likeliest + of->n + 1, *further = count + of->k;
    double log_total = 0.0;
    int64_t entries = 0;
    likeliest[0] = 1.0;
    memset(count, 0, (size_t)of->k * sizeof *count);
    for (int64_t j = 0; j < of->n; j++) {
        double ending = 0.0, going = 0.0, best = -1.0;
        if (last) first[j] = entries;
        origin[j + 1] = kind[j + 1] = 0;
        for (int64_t k = 0; k < of->k; k++) {
            Piece *own = pieces + k * of->n;
            extend(of, k, j, own, (int64_t)count[k], log_total);
            for (int64_t e = 0; e <= (int64_t)count[k]; e++) {
                int64_t start = (int64_t)own[e].start;
                double weight = exp(own[e].exponent - log_total) / own[e].scale, on = goes_on(of, start, j);
                double ends = weight * (j + 1 < of->n ? on - goes_on(of, start, j + 1) : on);
                going += further[k * of->n + e] = weight * on, ending += ends;
                if (last) last[entries++] = (Last){ending, k, start};
                if (ends * likeliest[start] > best)
                    best = ends * likeliest[start], origin[j + 1] = start, kind[j + 1] = k;
            }
        }
        for (int64_t k = 0; k < of->k; k++) { /* now that all that goes on is known */
            Piece *own = pieces + k * of->n;
            int64_t kept = 0;
            for (int64_t e = 0; e <= (int64_t)count[k]; e++) {
                if (further[k * of->n + e] < NEGLIGIBLE * going) continue;
                if (kept < e) own[kept] = own[e];
                kept++;
            }
            count[k] = (double)kept;
        }
        likeliest[j + 1] = best / ending;
        log_total += log(ending);
    }
    if (last) first[of->n] = entries;
    return log_total;
}

/** ln of the evidence of curvatures at n sites, over all partitions into pieces of k kinds; docs/model.md (36),
without the constant of Gaussian densities, that is Σ ln(precision/2π) over the sites that were read.

s [n]: arc length of the sites [m]; bend [n][2]: components sensed there [1/m]; precision [n]: of each, 0 where none
was read [m²]. Also returned: begin and kind of the last of the likeliest pieces before each site [n + 1]. */
ENTRY void tss_fibre_evidence(
    int64_t n, int64_t k, const double s[n], const double bend[n][2], const double precision[n],
    const double variance[k], const double decay[k], const double share[k], double rate,
    OUT double *log_evidence, OUT int64_t origin[n + 1], OUT int64_t kind[n + 1],
    WORK double work[79 * k * n + 3 * n + 20 * k]) {
    Fibre of = {n, k, s, bend, precision, variance, decay, share, rate, NULL, NULL};
    origin[0] = kind[0] = 0;
    prepare(&of, work);
    *log_evidence = forward(&of, origin, kind, NULL, NULL, work + k * n * OF_STEP + k * STATES * STATES);
}

/* The states at a site of a piece, by the sites up to there; and how they depend on those at the next site. */
typedef struct {
    Smooth filtered;
    double root[STATES][STATES], gain[STATES][STATES], after[2][STATES]; /* by columns */
} Site;

/* A piece of a draw, between arc lengths; `next` is another one of the same kind that begins at the same site. */
typedef struct {
    int64_t end, draw, next;
    double left, right;
} Drawn;

/* Gain of the states at a site by those at the next one, and the root of the covariance that is left. */
static void link_to_next(const Step *step, Site *site) {
    double with[STATES][STATES], root[STATES][STATES], left[STATES][STATES];
    Smooth after = site->filtered;
    across(step, &site->filtered, with);
    carry(step, &after);
    memcpy(site->after, after.mean, sizeof site->after);
    root_of((const double(*)[STATES])after.covariance, root);
    memcpy(left, site->filtered.covariance, sizeof left);
    for (int64_t b = 0; b < STATES; b++) { /* each state apart: x = root⁻¹ with, then its gain root⁻ᵀ x */
        for (int64_t a = 0; a < STATES; a++) {
            double x = with[a][b];
            for (int64_t c = 0; c < a; c++) x -= root[a][c] * with[c][b];
            with[a][b] = root[a][a] > 0.0 ? x / root[a][a] : 0.0;
        }
        for (int64_t a = STATES - 1; a >= 0; a--) {
            double x = with[a][b];
            for (int64_t c = a + 1; c < STATES; c++) x -= root[c][a] * site->gain[c][b];
            site->gain[a][b] = root[a][a] > 0.0 ? x / root[a][a] : 0.0;
        }
    }
    for (int64_t a = 0; a < STATES; a++)
        for (int64_t b = 0; b < STATES; b++)
            for (int64_t c = 0; c < STATES; c++) left[a][b] -= with[c][a] * with[c][b];
    columns_of((const double(*)[STATES])left, site->root);
}

/* Filter a piece of a kind from `start` to before `end`, for all draws of it. */
static void filter_piece(const Fibre *of, int64_t kind, int64_t start, int64_t end, Site sites[]) {
    double decay = of->decay[kind], scale = 1.0;
    Smooth at = {.mean = {{0.0}}};
    const Step *steps = of->steps + kind * of->n;
    memcpy(at.covariance, of->prior[kind], sizeof at.covariance);
    for (int64_t i = start; i < end; i++) {
        if (i > start && decay > 0.0) carry(steps + i, &at);
        observe(&at, of->bend[i], of->precision[i], &scale);
        sites[i].filtered = at;
        if (i + 1 < end && decay > 0.0) link_to_next(steps + i + 1, sites + i);
    }
}

/* Draw the states at the sites of a filtered piece. */
static void draw_states(
    double decay, int64_t start, int64_t end, const Site sites[], const double normal[],
    double state[][2][STATES]) {
    double root[STATES][STATES];
    columns_of(sites[end - 1].filtered.covariance, root);
    for (int64_t i = end - 1; i >= start; i--) {
        if (i + 1 < end && decay == 0.0) {
            memcpy(state[i], state[i + 1], sizeof state[i]);
            continue;
        }
        const Site *site = sites + i;
        const double(*column)[STATES] = i + 1 < end ? site->root : (const double(*)[STATES])root;
        for (int64_t e = 0; e < 2; e++) {
            const double *given = normal + NORMALS * i + STATES * e;
            Lanes drawn = load(site->filtered.mean[e]);
            for (int64_t b = 0; b < STATES; b++) {
                if (i + 1 < end) drawn += (state[i + 1][e][b] - site->after[e][b]) * load(site->gain[b]);
                drawn += given[b] * load(column[b]);
            }
            store(drawn, state[i][e]);
        }
    }
}

/* Curvature at an arc length of a piece, from the states at the sites on both sides, or at its outer one. */
static double curvature_at(
    const Fibre *of, double decay, int64_t start, int64_t end, double state[][2][STATES], int64_t *near,
    double at, double out[2]) {
    while (*near + 2 < end && of->s[*near + 1] < at) (*near)++;
    int64_t i = *near;
    int outer = !(at > of->s[start] && at < of->s[end - 1]); /* NaN too */
    if (at >= of->s[end - 1]) i = end - 1;
    double x = at - of->s[i], h = outer ? 1.0 : of->s[i + 1] - of->s[i], v = x / h;
    for (int64_t e = 0; e < 2; e++) {
        double here = state[i][e][0], slope = state[i][e][1] - decay * here;
        if (outer) {
            out[e] = decay > 0.0 ? exp(-decay * fabs(x)) * ((1.0 + decay * fabs(x)) * here + x * slope) : here;
            continue;
        }
        double next = state[i + 1][e][0], there = state[i + 1][e][1] - decay * next, less = 1.0 - v;
        out[e] = less * less * (1.0 + 2.0 * v) * here + v * v * (3.0 - 2.0 * v) * next;
        if (decay > 0.0) out[e] += h * v * less * (less * slope - v * there);
    }
    return sqrt(squared(out[0]) + squared(out[1]));
}

/* Cut the fibre for each draw, from the distal end; `head` begins the list of the pieces of a kind from a site. */
static void draw_pieces(
    const Fibre *of, const Last last[], const int64_t first[], int64_t d, const double uniform[][2 * of->n],
    int64_t head[], Drawn drawn[], uint8_t smooth[]) {
    int64_t count = 0;
    for (int64_t c = 0; c < of->k * of->n; c++) head[c] = -1;
    for (int64_t c = 0; c < d; c++) {
        const double *chance = uniform[c];
        double right = of->s[of->n - 1];
        smooth[c] = 0;
        for (int64_t end = of->n, start; end > 0; end = start) {
            double left = of->s[0], share = *chance++ * last[first[end] - 1].upto;
            int64_t e = first[end - 1], latest = first[end] - 1;
            while (e < latest) { /* by bisection */
                int64_t middle = (e + latest) / 2;
                if (last[middle].upto < share) e = middle + 1;
                else latest = middle;
            }
            start = last[e].start;
            if (start > 0) left = of->s[start - 1] + *chance++ * (of->s[start] - of->s[start - 1]);
            smooth[c] |= of->decay[last[e].kind] > 0.0;
            int64_t *begin = head + last[e].kind * of->n + start;
            drawn[count] = (Drawn){end, c, *begin, left, right};
            *begin = count++, right = left;
        }
    }
}

/* Curvature, its magnitude and angle at the nodes [m] of a piece of a draw; `each` nodes go with an interval. */
static void at_nodes(
    const Fibre *of, double decay, int64_t start, const Drawn *piece, double state[][2][STATES], int64_t m,
    int64_t each, const double node[], double curvature[][2], double magnitude[], double angle[]) {
    double value, at = piece->left, here[2];
    int64_t near = start, a = start > 0 ? (start - 1) * each + 1 : 0, end = piece->end;
    value = curvature_at(of, decay, start, end, state, &near, at, here);
    for (; a < m && (end == of->n || node[a] < piece->right); a++) {
        if (node[a] < piece->left) continue;
        magnitude[a] = curvature_at(of, decay, start, end, state, &near, node[a], curvature[a]);
        angle[a] += 0.5 * (value + magnitude[a]) * (node[a] - at);
        value = magnitude[a], at = node[a];
    }
    double last = curvature_at(of, decay, start, end, state, &near, piece->right, here);
    if (a < m) angle[a] += 0.5 * (value + last) * (piece->right - at);
}

/** Draws d from the posterior of the curvature on m nodes; docs/model.md (38).

Nodes: (m - 1)/(n - 1) even ones in each interval of the sites [m]; uniform [d][2 n], normal [d][8 n]: random
numbers. Returned are the evidence as of `tss_fibre_evidence`, components [d][m][2] and their magnitude [d][m]
[1/m], accumulated angle [d][m] [rad], and whether a draw has a smooth piece [d]. */
ENTRY status tss_fibre_draws(
    int64_t n, int64_t k, int64_t m, int64_t d, const double s[n], const double bend[n][2],
    const double precision[n], const double variance[k], const double decay[k], const double share[k],
    double rate, const double node[m], const double uniform[d][2 * n], const double normal[d][8 * n],
    OUT double *log_evidence, OUT double curvature[d][m][2], OUT double magnitude[d][m], OUT double angle[d][m],
    OUT uint8_t smooth[d],
    WORK double work[3 * k * n * n + 85 * k * n + 80 * n + 20 * k + 5 * d * n]) {
    Fibre of = {n, k, s, bend, precision, variance, decay, share, rate, NULL, NULL};
    if (n < 2 || k < 1 || m < 2 || (m - 1) % (n - 1)) return WRONG_SIZE;
    const int64_t each = (m - 1) / (n - 1);
    Last *last = (Last *)work;
    work += 3 * k * n * (n + 1) / 2 + 3;
    int64_t *first = (int64_t *)work, *origin = first + n + 1, *kind = origin + n + 1;
    prepare(&of, work += 3 * n + 3);
    Site *sites = (Site *)(work += k * n * OF_STEP + k * STATES * STATES);
    double(*state)[2][STATES] = (double(*)[2][STATES])(work += n * OF_SITE);
    Drawn *drawn = (Drawn *)(work += n * NORMALS);
    int64_t *head = (int64_t *)(work += 5 * d * n);
    work += k * n;
    *log_evidence = forward(&of, origin, kind, last, first, work);
    draw_pieces(&of, last, first, d, uniform, head, drawn, smooth);
    memset(angle[0], 0, (size_t)(d * m) * sizeof(double));
    for (int64_t c = 0; c < k * n; c++) {
        const int64_t of_kind = c / n, start = c % n;
        int64_t longest = start;
        for (int64_t e = head[c]; e >= 0; e = drawn[e].next)
            if (drawn[e].end > longest) longest = drawn[e].end;
        filter_piece(&of, of_kind, start, longest, sites);
        for (int64_t e = head[c]; e >= 0; e = drawn[e].next) {
            int64_t of_draw = drawn[e].draw;
            draw_states(decay[of_kind], start, drawn[e].end, sites, normal[of_draw], state);
            at_nodes(
                &of, decay[of_kind], start, drawn + e, state, m, each, node, curvature[of_draw],
                magnitude[of_draw], angle[of_draw]);
        }
    }
    for (int64_t c = 0; c < d; c++)
        for (int64_t a = 1; a < m; a++) angle[c][a] += angle[c][a - 1];
    return DONE;
}
