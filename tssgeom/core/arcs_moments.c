/* Positions along a chain of arcs, and moments of the points on it.

   The chain starts at a position with axes (tangent and two normals, carried along without twist). Piece j
   runs from arc length b_j to b_j+1 with constant curvature components K_j on the normals, so a straight
   piece and a change of the bending plane are regular points. The last piece goes on without end;
   docs/model.md (30).

   Moments of a piece are the products of the rows of its points (n, x × n, n·dx/dK, residual), summed: all
   that the normal equations of a fit need of it; (32). */
#include "arcs.h"

#include <string.h>

/* Position and axes (rows: position, tangent, normals) at arc length h, in the axes at the start of the
   arc; returns the functions of its squared turn. */
ArcFunctions arc_frame(const double bend[2], double h, double local[4][3]) {
    ArcFunctions f = arc_functions((bend[0] * bend[0] + bend[1] * bend[1]) * h * h);
    double a = f.a, b = f.b, w0 = bend[0] * h, w1 = bend[1] * h;
    local[0][0] = h * a, local[0][1] = h * b * w0, local[0][2] = h * b * w1;
    local[1][0] = 1 - b * (w0 * w0 + w1 * w1), local[1][1] = a * w0, local[1][2] = a * w1;
    local[2][0] = -a * w0, local[2][1] = 1 - b * w0 * w0, local[2][2] = -b * w0 * w1;
    local[3][0] = -a * w1, local[3][1] = -b * w0 * w1, local[3][2] = 1 - b * w1 * w1;
    return f;
}

void in_axes(double axes[3][3], const double local[3], double world[3]) {
    for (int c = 0; c < 3; c++)
        world[c] = local[0] * axes[0][c] + local[1] * axes[1][c] + local[2] * axes[2][c];
}

void joint_frames(const Chain *chain, double position[][3], double frame[][3][3]) {
    memcpy(position[0], chain->form->start, sizeof chain->form->start);
    memcpy(frame[0], chain->form->axes, sizeof chain->form->axes);
    double local[4][3];
    for (int64_t j = 1; j < chain->k; j++) {
        double h = chain->form->piece[j].begin - chain->form->piece[j - 1].begin;
        arc_frame(chain->form->piece[j - 1].bend, h, local);
        in_axes(frame[j - 1], local[0], position[j]);
        for (int c = 0; c < 3; c++) position[j][c] += position[j - 1][c];
        for (int c = 0; c < 3; c++) in_axes(frame[j - 1], local[1 + c], frame[j][c]);
    }
}

/* Derivatives of the position at arc length h by both curvature components, in the axes at the start. */
void position_by_curvature(ArcFunctions f, const double bend[2], double h, double moved[2][3]) {
    double h2 = h * h;
    for (int c = 0; c < 2; c++) {
        double turned = 2 * h2 * h2 * f.db * bend[c];
        moved[c][0] = 2 * h2 * h * f.da * bend[c];
        moved[c][1] = turned * bend[0];
        moved[c][2] = turned * bend[1];
        moved[c][1 + c] += h2 * f.b;
    }
}

/* Turn of the axes at arc length h by both curvature components, in the axes at the start. */
void turn_by_curvature(ArcFunctions f, const double bend[2], double h, double turned[2][3]) {
    double q = (bend[0] * bend[0] + bend[1] * bend[1]) * h * h, a = 1.0 - q * f.c;
    double w1 = -bend[1] * h, w2 = bend[0] * h; /* rotation vector on (t, e1, e2): (0, w1, w2) */
    for (int c = 0; c < 2; c++) {
        double v1 = c == 0 ? 0.0 : -h, v2 = c == 0 ? h : 0.0, dot = w1 * v1 + w2 * v2;
        turned[c][0] = f.b * (w1 * v2 - w2 * v1);
        turned[c][1] = a * v1 + f.c * dot * w1, turned[c][2] = a * v2 + f.c * dot * w2;
    }
}

/** Return position [m] and axes (tangent, both normals) of a chain at arc lengths `s` [r] [m]; (30).

`form` has rows = k + 4 rows. */
ENTRY status tss_along_chain(
    int64_t r, int64_t rows, const double s[r], const double form[rows][3], OUT double position[r][3],
    OUT double frame[r][3][3], WORK double work[12 * rows]) {
    if (rows < 5) return WRONG_SIZE;
    Chain chain = chain_of(rows - 4, 0, form, NULL, NULL, NULL, 0.0);
    double(*begin)[3] = (double(*)[3])work, (*axes)[3][3] = (double(*)[3][3])(work + 3 * rows), local[4][3];
    joint_frames(&chain, begin, axes);
    for (int64_t i = 0, j = 0; i < r; i++) {
        j = piece_of(&chain, s[i], j);
        arc_frame(chain.form->piece[j].bend, s[i] - chain.form->piece[j].begin, local);
        in_axes(axes[j], local[0], position[i]);
        for (int c = 0; c < 3; c++) position[i][c] += begin[j][c];
        for (int c = 0; c < 3; c++) in_axes(axes[j], local[1 + c], frame[i][c]);
    }
    return DONE;
}

/* The plane in which a piece bends: its curvature, the direction of that on both normals, and axes: the
   tangent where the piece begins, the normal that it bends to, and the one across. In it the piece is at x
   = (x₀, κg) with tangent (1 - κ²g, κx₀), where x₀ = sin κh/κ and g = (1 - cos κh)/κ² are regular for a
   straight piece too. */
typedef struct {
    double kappa, towards[2], axes[3][3];
} Plane;

static Plane bending_plane(double frame[3][3], const double bend[2]) {
    Plane p = {.kappa = sqrt(bend[0] * bend[0] + bend[1] * bend[1]), .towards = {1.0, 0.0}};
    if (p.kappa > 0.0) p.towards[0] = bend[0] / p.kappa, p.towards[1] = bend[1] / p.kappa;
    for (int c = 0; c < 3; c++) {
        p.axes[0][c] = frame[0][c];
        p.axes[1][c] = p.towards[0] * frame[1][c] + p.towards[1] * frame[2][c];
        p.axes[2][c] = p.towards[0] * frame[2][c] - p.towards[1] * frame[1][c];
    }
    return p;
}

/* Offset of a point from the start of a piece, on the axes of its plane. */
static inline void offset(const double point[3], const double begin[3], const Plane *plane, double off[3]) {
    double d[3] = {point[0] - begin[0], point[1] - begin[1], point[2] - begin[2]};
    for (int e = 0; e < 3; e++) off[e] = dot3(d, plane->axes[e]);
}

/* x₀ and g farther on by `move` along an arc of curvature κ. */
static inline void advance(double kappa, double move, double *x, double *g) {
    double square = kappa * kappa;
    ArcFunctions f = arc_functions(square * move * move);
    double forward = f.a * move, aside = f.b * move * move, tangent = 1.0 - square * *g, x0 = *x;
    *x = x0 + tangent * forward - square * x0 * aside;
    *g += x0 * forward + tangent * aside;
}

/* Add rows of 1, x₀ and g, with the sums of the products of these and of those with the residual. */
static void add_rows(double row[8][3], double products[3][3], const double off[3], double own[9][9]) {
    for (int a = 0; a < 8; a++) {
        double half[3];
        for (int q = 0; q < 3; q++) {
            half[q] = 0.0;
            for (int p = 0; p < 3; p++) half[q] += row[a][p] * products[p][q];
        }
        for (int b = a; b < 8; b++) {
            double total = 0.0;
            for (int q = 0; q < 3; q++) total += half[q] * row[b][q];
            own[a][b] += total;
            own[b][a] = own[a][b];
        }
        double total = 0.0;
        for (int q = 0; q < 3; q++) total += row[a][q] * off[q];
        own[a][8] += total;
        own[8][a] = own[a][8];
    }
}

/* position × axis: the turning part of a row about the origin. */
static void about_origin(const double position[3], const double axis[3], double turn[3]) {
    for (int c = 0; c < 3; c++) {
        int d = (c + 1) % 3, e = (c + 2) % 3;
        turn[c] = position[d] * axis[e] - position[e] * axis[d];
    }
}

/* Moments of a piece from the sums of products of 1, x₀, g and the residuals on both normals. */
static void add_sums_across(
    const double of[12], const double position[3], const Plane *plane, double moments[9][9]) {
    double first[8][3] = {{0}}, second[8][3] = {{0}}; /* rows of both normals, by 1, x₀ and g */
    double kappa = plane->kappa, turn[3][3];
    for (int e = 0; e < 3; e++) about_origin(position, plane->axes[e], turn[e]);
    for (int c = 0; c < 3; c++) {
        double t = plane->axes[0][c], u = plane->axes[1][c], v = plane->axes[2][c];
        first[c][0] = u, first[c][1] = -kappa * t, first[c][2] = -kappa * kappa * u;
        second[c][0] = v;
        first[3 + c][0] = turn[1][c];
        first[3 + c][1] = v - kappa * turn[0][c];
        first[3 + c][2] = -kappa * kappa * turn[1][c];
        second[3 + c][0] = turn[2][c], second[3 + c][1] = -u, second[3 + c][2] = kappa * t;
    }
    first[6][2] = plane->towards[0], first[7][2] = plane->towards[1];
    second[6][2] = -plane->towards[1], second[7][2] = plane->towards[0];
    double products[3][3] = {{of[0], of[1], of[2]}, {of[1], of[3], of[4]}, {of[2], of[4], of[5]}};
    add_rows(first, products, of + 6, moments);
    add_rows(second, products, of + 9, moments);
}

/* Unknown stations: they are moved to the feet of their points, by at most `reach` [m] at a time and a
   second time where the first took them far; a reach of 0 leaves them where they are. Only distances across
   the chain count. */
static double moments_across(
    const Data *data, Chain *chain, double position[][3], double frame[][3][3], double reach,
    double moments[][9][9], Work w) {
    Plane *planes = (Plane *)take(&w, chain->k * (int64_t)(sizeof *planes / sizeof(double)));
    double(*sums)[12] = (double(*)[12])take(&w, 12 * chain->k); /* of products with 1, x₀ and g */
    memset(sums, 0, (size_t)chain->k * sizeof *sums);
    for (int64_t j = 0; j < chain->k; j++) planes[j] = bending_plane(frame[j], chain->form->piece[j].bend);
    double cost = 0.0, near = FOOT.near * reach;
    /* each point goes on from where the last one was before it moved: both may be worked on at once */
    int64_t base = 0;
    double base_at = chain->form->piece[0].begin, base_x = 0.0, base_g = 0.0;
    for (int64_t i = 0; i < data->n; i++) {
        double s = chain->stations[i], r1 = 0.0, off[3];
        int64_t j = piece_of(chain, s, base);
        if (j != base) base = j, base_at = chain->form->piece[j].begin, base_x = base_g = 0.0;
        advance(planes[j].kappa, s - base_at, &base_x, &base_g);
        base_at = s;
        double x = base_x, g = base_g;
        for (int64_t steps = reach > 0.0 ? FOOT.steps : 0; steps >= 0; steps--) {
            double kappa = planes[j].kappa, t0 = 1.0 - kappa * kappa * g, t1 = kappa * x;
            offset(data->points[i], position[j], &planes[j], off);
            double o0 = off[0] - x, o1 = off[1] - kappa * g;
            r1 = t0 * o1 - t1 * o0;
            if (steps == 0) break;
            double slope = most(1.0 - kappa * r1, FOOT.least_slope);
            double move = within((t0 * o0 + t1 * o1) / slope, -reach, reach);
            if (!(fabs(move) >= near)) steps = 1; /* there is no other step */
            s += move;
            int64_t before = j;
            j = piece_of(chain, s, j);
            if (j != before) x = g = 0.0, move = s - chain->form->piece[j].begin;
            advance(planes[j].kappa, move, &x, &g);
        }
        double r2 = off[2], w = data->weight[i], *of = sums[j];
        chain->stations[i] = s;
        chain->square[i] = r1 * r1 + r2 * r2;
        if (!(w > 0.0)) continue;
        cost += w * chain->square[i];
        double wx = w * x, wg = w * g;
        of[0] += w, of[1] += wx, of[2] += wg, of[3] += wx * x, of[4] += wx * g, of[5] += wg * g;
        of[6] += w * r1, of[7] += wx * r1, of[8] += wg * r1;
        of[9] += w * r2, of[10] += wx * r2, of[11] += wg * r2;
    }
    for (int64_t j = 0; j < chain->k; j++) add_sums_across(sums[j], position[j], &planes[j], moments[j]);
    return cost;
}

/* Add one row of a fit, of some weight, to the moments of its piece; docs/model.md (32). */
static inline void add_row(double weight, const double row[9], double moments[9][9]) {
    for (int a = 0; a < 9; a++)
        for (int b = 0; b < 9; b++) moments[a][b] += weight * row[a] * row[b];
}

/* Known stations: every coordinate counts; docs/model.md (30). */
static double moments_known(
    const Data *data, Chain *chain, double position[][3], double frame[][3][3], double moments[][9][9]) {
    double cost = 0.0, local[4][3], moved[2][3], x[3], by[2][3];
    for (int64_t i = 0, j = 0; i < data->n; i++) {
        double s = chain->stations[i], weight = data->weight[i];
        j = piece_of(chain, s, j);
        const double *bend = chain->form->piece[j].bend, h = s - chain->form->piece[j].begin;
        ArcFunctions f = arc_frame(bend, h, local);
        in_axes(frame[j], local[0], x);
        for (int c = 0; c < 3; c++) x[c] += position[j][c];
        const double *p = data->points[i];
        chain->square[i] = squared(p[0] - x[0]) + squared(p[1] - x[1]) + squared(p[2] - x[2]);
        if (!(weight > 0.0)) continue;
        cost += weight * chain->square[i];
        position_by_curvature(f, bend, h, moved);
        for (int c = 0; c < 2; c++) in_axes(frame[j], moved[c], by[c]);
        for (int c = 0; c < 3; c++) {
            int d = (c + 1) % 3, e = (c + 2) % 3;
            double row[9] = {[6] = by[0][c], by[1][c], p[c] - x[c]};
            row[c] = 1.0, row[3 + d] = x[e], row[3 + e] = -x[d]; /* x × n */
            add_row(weight, row, moments[j]);
        }
    }
    return cost;
}

/* Add the rows of the sensed directions to the moments of their pieces; returns their cost, (94). */
static double add_tangents(
    const Data *data, const Chain *chain, double frame[][3][3], double moments[][9][9]) {
    double cost = 0.0, local[4][3], by[2][3], off[3];
    for (int64_t i = 0, j = 0; i < data->n; i++) {
        double weight = data->unit_weight[i];
        if (!(weight > 0.0)) continue;
        j = piece_of(chain, chain->stations[i], j);
        const double *bend = chain->form->piece[j].bend, h = chain->stations[i] - chain->form->piece[j].begin;
        ArcFunctions f = arc_frame(bend, h, local);
        turn_by_curvature(f, bend, h, by);
        for (int c = 0; c < 3; c++) off[c] = dot3(data->unit[i], frame[j][c]);
        for (int part = 2; part < 4; part++) { /* t × e1 = e2, t × e2 = -e1 */
            double *turn = local[5 - part], sign = part == 2 ? 1.0 : -1.0, row[9] = {0};
            in_axes(frame[j], turn, row + 3);
            for (int c = 0; c < 3; c++) row[3 + c] *= sign;
            for (int c = 0; c < 2; c++) row[6 + c] = sign * dot3(by[c], turn);
            row[8] = dot3(off, local[part]);
            cost += weight * row[8] * row[8];
            add_row(weight, row, moments[j]);
        }
    }
    return cost;
}

/* Moments of each piece [k], in the world's axes; writes squared distances, moves unknown stations towards
   the feet of their points, by at most `reach` at a time [m], and returns the weighted sum of squares; docs/model.md
   (30). */
double moments_of_points(
    const Data *data, Chain *chain, double position[][3], double frame[][3][3], double reach,
    double moments[][9][9], Work w) {
    memset(moments, 0, (size_t)chain->k * sizeof *moments);
    double cost = data->free ? moments_across(data, chain, position, frame, reach, moments, w)
                             : moments_known(data, chain, position, frame, moments);
    if (data->unit == NULL || data->unit_weight == NULL) return cost;
    return cost + add_tangents(data, chain, frame, moments);
}
