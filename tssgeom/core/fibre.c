#include "fibre.h"
#include "lanes.h"

#include <string.h>

/* Of the weight of all pieces, below which one is left out, and scale of a weight that is kept in range. */
static const double NEGLIGIBLE = 1e-10, LARGE = 1e100;
enum { TERMS = 30 };

/* Transition of the states over a step, and the covariance that it adds. */
typedef struct {
    double over[STATES][STATES], columns[STATES][STATES], added[STATES][STATES], decay;
} Step;

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
    double weight;
    int64_t kind, start;
} Last;

/* What was sensed, and the prior of its pieces. */
typedef struct {
    int64_t n, k;
    const double *s, (*bend)[2], *precision, *variance, *decay, *share, rate;
} Fibre;

static double factorial(int64_t n) { return n < 2 ? 1.0 : (double)n * factorial(n - 1); }

/* ∫ u^m exp(−2λu) du from 0 to h. */
static double moment(int64_t m, double decay, double h) {
    double x = 2.0 * decay * h, sum = 0.0, term = 1.0, whole = factorial(m) / pow(2.0 * decay, (double)(m + 1));
    if (isinf(h)) return whole;
    if (x < 2.0) {
        for (int64_t i = 0; i < TERMS; i++) sum += term / (double)(m + i + 1), term *= -x / (double)(i + 1);
        return sum * pow(h, (double)(m + 1));
    }
    for (int64_t i = 0; i <= m; i++) sum += term, term *= x / (double)(i + 1);
    return whole * (1.0 - exp(-x) * sum);
}

/* Covariance of the states, grown over a step h; infinite for that of the prior; docs/model.md (37). */
static void grown(double variance, double decay, double h, double out[STATES][STATES]) {
    memset(out, 0, STATES * sizeof *out);
    if (decay == 0.0) {
        out[0][0] = isinf(h) ? variance : 0.0;
        return;
    }
    const int64_t p = STATES - 1;
    double intensity = variance * pow(2.0 * decay, 2.0 * STATES - 1.0) * squared(factorial(p)) / factorial(2 * p);
    for (int64_t i = 0; i < STATES; i++)
        for (int64_t j = i; j < STATES; j++)
            out[i][j] = out[j][i] =
                intensity * moment(2 * p - i - j, decay, h) / (factorial(p - i) * factorial(p - j));
}

static Step step_over(double h, double variance, double decay) {
    Step step = {.decay = decay};
    double less = exp(-decay * h);
    for (int64_t i = 0; i < STATES; i++)
        for (int64_t j = i; j < STATES; j++)
            if (i == j || decay > 0.0)
                step.over[i][j] = step.columns[j][i] = less * pow(h, (double)(j - i)) / factorial(j - i);
    grown(variance, decay, h, step.added);
    return step;
}

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

/* Take one site more into all pieces of a kind, and begin one there. */
static void extend(const Fibre *of, int64_t kind, int64_t j, Piece pieces[], int64_t count, double log_total) {
    double variance = of->variance[kind], decay = of->decay[kind];
    Step step = step_over(j > 0 ? of->s[j] - of->s[j - 1] : 0.0, variance, decay);
    double straight = -0.5 * of->precision[j] * (squared(of->bend[j][0]) + squared(of->bend[j][1]));
    pieces[count] = (Piece){.start = (double)j, .exponent = log_total + log(of->share[kind]), .scale = 1.0};
    grown(variance, decay, INFINITY, pieces[count].at.covariance);
    for (int64_t e = 0; e <= count; e++) {
        Piece *piece = pieces + e;
        if (decay > 0.0 && e < count) carry(&step, &piece->at);
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
                if (last) last[entries++] = (Last){ends, k, start};
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

void tss_fibre_evidence(
    int64_t n, int64_t k, const double s[n], const double bend[n][2], const double precision[n],
    const double variance[k], const double decay[k], const double share[k], double rate,
    double *log_evidence, int64_t origin[n + 1], int64_t kind[n + 1],
    double work[30 * k * n + 3 * n + 4 * k]) {
    Fibre of = {n, k, s, bend, precision, variance, decay, share, rate};
    origin[0] = kind[0] = 0;
    *log_evidence = forward(&of, origin, kind, NULL, NULL, work);
}

/* Lower triangle L of a covariance L Lᵀ; 0 where it has none. */
static void root_of(double covariance[STATES][STATES], double root[STATES][STATES]) {
    memset(root, 0, STATES * sizeof *root);
    for (int64_t a = 0; a < STATES; a++)
        for (int64_t b = 0; b <= a; b++) {
            double sum = covariance[a][b];
            for (int64_t c = 0; c < b; c++) sum -= root[a][c] * root[b][c];
            root[a][b] = a == b ? sqrt(most(sum, 0.0)) : root[b][b] > 0.0 ? sum / root[b][b] : 0.0;
        }
}

static void solve_lower(double root[STATES][STATES], double x[STATES]) {
    for (int64_t a = 0; a < STATES; a++) {
        for (int64_t c = 0; c < a; c++) x[a] -= root[a][c] * x[c];
        x[a] = root[a][a] > 0.0 ? x[a] / root[a][a] : 0.0;
    }
}

/* States at a site given those sampled at the next one. */
static void given_next(const Step *step, const double next[2][STATES], Smooth *at) {
    double with[STATES][STATES], root[STATES][STATES], gain[STATES][STATES];
    Smooth after = *at;
    across(step, at, with);
    carry(step, &after);
    root_of(after.covariance, root);
    for (int64_t b = 0; b < STATES; b++) {
        for (int64_t a = 0; a < STATES; a++) gain[b][a] = with[a][b];
        solve_lower(root, gain[b]);
    }
    for (int64_t e = 0; e < 2; e++) {
        double off[STATES];
        for (int64_t a = 0; a < STATES; a++) off[a] = next[e][a] - after.mean[e][a];
        solve_lower(root, off);
        for (int64_t b = 0; b < STATES; b++)
            for (int64_t a = 0; a < STATES; a++) at->mean[e][b] += gain[b][a] * off[a];
    }
    for (int64_t a = 0; a < STATES; a++)
        for (int64_t b = 0; b < STATES; b++)
            for (int64_t c = 0; c < STATES; c++) at->covariance[a][b] -= gain[a][c] * gain[b][c];
}

/* Draw the states at the sites from `start` to before `end`. */
static void draw_states(
    const Fibre *of, int64_t kind, int64_t start, int64_t end, const Step steps[], const double normal[],
    Smooth filtered[], double state[][2][STATES]) {
    double decay = of->decay[kind], scale = 1.0;
    Smooth at = {.mean = {{0.0}}};
    grown(of->variance[kind], decay, INFINITY, at.covariance);
    for (int64_t i = start; i < end; i++) {
        if (i > start && decay > 0.0) carry(steps + kind * of->n + i, &at);
        observe(&at, of->bend[i], of->precision[i], &scale);
        filtered[i] = at;
    }
    for (int64_t i = end - 1; i >= start; i--) {
        if (i + 1 < end && decay == 0.0) {
            memcpy(state[i], state[i + 1], sizeof state[i]);
            continue;
        }
        double root[STATES][STATES];
        if (i + 1 < end)
            given_next(steps + kind * of->n + i + 1, (const double(*)[STATES])state[i + 1], filtered + i);
        root_of(filtered[i].covariance, root);
        for (int64_t e = 0; e < 2; e++)
            for (int64_t a = 0; a < STATES; a++) {
                state[i][e][a] = filtered[i].mean[e][a];
                for (int64_t b = 0; b <= a; b++)
                    state[i][e][a] += root[a][b] * normal[NORMALS * i + STATES * e + b];
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

status tss_fibre_draws(
    int64_t n, int64_t k, int64_t m, int64_t d, const double s[n], const double bend[n][2],
    const double precision[n], const double variance[k], const double decay[k], const double share[k],
    double rate, const double node[m], const double uniform[d][2 * n], const double normal[d][8 * n],
    double curvature[d][m][2], double angle[d][m], uint8_t smooth[d],
    double work[3 * k * n * n + 85 * k * n + 64 * n + 4 * k]) {
    Fibre of = {n, k, s, bend, precision, variance, decay, share, rate};
    if (n < 2 || k < 1 || m < 2 || (m - 1) % (n - 1)) return WRONG_SIZE;
    const int64_t each = (m - 1) / (n - 1);
    Last *last = (Last *)work;
    work += 3 * k * n * (n + 1) / 2 + 3;
    int64_t *first = (int64_t *)work, *origin = first + n + 1, *kind = origin + n + 1;
    Step *steps = (Step *)(work += 3 * n + 3);
    Smooth *filtered = (Smooth *)(work += k * n * OF_STEP);
    double(*state)[2][STATES] = (double(*)[2][STATES])(work += n * (OF_PIECE - 3));
    work += n * NORMALS;
    forward(&of, origin, kind, last, first, work);
    for (int64_t c = 0; c < k * n; c++)
        steps[c] = step_over(c % n ? s[c % n] - s[c % n - 1] : 0.0, variance[c / n], decay[c / n]);
    for (int64_t c = 0; c < d; c++) {
        const double *chance = uniform[c];
        double right = s[n - 1];
        memset(angle[c], 0, (size_t)m * sizeof(double));
        smooth[c] = 0;
        for (int64_t end = n, start; end > 0; end = start) {
            double total = 0.0, left = s[0], value, at, here[2];
            int64_t e = first[end - 1];
            for (int64_t i = e; i < first[end]; i++) total += last[i].weight;
            for (total *= *chance++; e + 1 < first[end] && (total -= last[e].weight) > 0.0;) e++;
            int64_t of_kind = last[e].kind, near = start = last[e].start;
            if (start > 0) left = s[start - 1] + *chance * (s[start] - s[start - 1]);
            chance += start > 0;
            draw_states(&of, of_kind, start, end, steps, normal[c], filtered, state);
            smooth[c] |= decay[of_kind] > 0.0;
            value = curvature_at(&of, decay[of_kind], start, end, state, &near, at = left, here);
            int64_t a = start > 0 ? (start - 1) * each + 1 : 0;
            for (; a < m && (end == n || node[a] < right); a++) {
                if (node[a] < left) continue;
                double next = curvature_at(&of, decay[of_kind], start, end, state, &near, node[a], curvature[c][a]);
                angle[c][a] += 0.5 * (value + next) * (node[a] - at);
                value = next, at = node[a];
            }
            double next = curvature_at(&of, decay[of_kind], start, end, state, &near, right, here);
            if (a < m) angle[c][a] += 0.5 * (value + next) * (right - at);
            right = left;
        }
        for (int64_t a = 1; a < m; a++) angle[c][a] += angle[c][a - 1];
    }
    return DONE;
}
