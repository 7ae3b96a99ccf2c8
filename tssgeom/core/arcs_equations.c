/* The normal equations of fitting a chain of arcs to points, exactly and in linear time.

   A change of any parameter before a point moves the point by a rigid twist (a, θ): δx = a + θ × x. The
   normal equations therefore need of each piece only the moments of its points, and cost O(points +
   pieces²); docs/model.md (30) to (32). */
#include "arcs.h"

#include <string.h>

/* Twist of a turn θ about a centre: a = -θ × centre; docs/model.md (31). */
static void twist_of_turn(const double theta[3], const double centre[3], double twist[6]) {
    twist[0] = -(theta[1] * centre[2] - theta[2] * centre[1]);
    twist[1] = -(theta[2] * centre[0] - theta[0] * centre[2]);
    twist[2] = -(theta[0] * centre[1] - theta[1] * centre[0]);
    for (int i = 0; i < 3; i++) twist[3 + i] = theta[i];
}

/* Twist of every parameter [m], the first piece it moves, and the piece it bends (or -1); position and
   frame are those where each piece begins. */
static void twists(
    const Chain *chain, int64_t free, double position[][3], double frame[][3][3], double twist[][6],
    int64_t first[], int64_t own[]) {
    int64_t k = chain->k, shifts = free ? 2 : 3, row = shifts + 2;
    const Form *form = chain->form;
    double theta[3], moved[2][3], turned[2][3], local[4][3];
    memset(twist, 0, (size_t)chain->m * sizeof *twist);
    for (int64_t a = 0; a < chain->m; a++) first[a] = 0, own[a] = -1;
    for (int64_t c = 0; c < shifts; c++) {
        if (free) memcpy(twist[c], frame[0][1 + c], 3 * sizeof(double));
        else twist[c][c] = 1.0;
    }
    for (int c = 0; c < 2; c++) twist_of_turn(frame[0][1 + c], position[0], twist[shifts + c]);
    for (int64_t j = 1; j < k; j++) {
        const double *bend = form->piece[j].bend, *before = form->piece[j - 1].bend;
        double d0 = before[0] - bend[0], d1 = before[1] - bend[1];
        for (int i = 0; i < 3; i++) theta[i] = d0 * frame[j][2][i] - d1 * frame[j][1][i]; /* t × e1 = e2 */
        twist_of_turn(theta, position[j], twist[row]);
        first[row++] = j;
    }
    for (int64_t j = 0; j < k; j++) {
        if (!chain->curved[j]) continue;
        if (j + 1 < k) {
            const double *bend = form->piece[j].bend, h = form->piece[j + 1].begin - form->piece[j].begin;
            ArcFunctions f = arc_frame(bend, h, local);
            turn_by_curvature(f, bend, h, turned);
            position_by_curvature(f, bend, h, moved);
        }
        for (int c = 0; c < 2; c++, row++) {
            first[row] = j + 1, own[row] = j;
            if (j + 1 == k) continue;
            double shift[3];
            in_axes(frame[j], turned[c], theta);
            in_axes(frame[j], moved[c], shift);
            twist_of_turn(theta, position[j + 1], twist[row]);
            for (int i = 0; i < 3; i++) twist[row][i] += shift[i];
        }
    }
}

/* Write matrix, gradient, cost and squares of a chain; (31), (32). Unknown stations are first moved towards
   the feet of their points, by at most `reach` at a time [m]. */
void normal_equations(const Data *data, Chain *chain, double reach, Work w) {
    int64_t k = chain->k, m = chain->m;
    double(*position)[3] = (double(*)[3])take(&w, 3 * k), (*frame)[3][3] = (double(*)[3][3])take(&w, 9 * k);
    double(*twist)[6] = (double(*)[6])take(&w, 6 * m), (*moments)[9][9] = (double(*)[9][9])take(&w, 81 * k);
    int64_t *first = (int64_t *)take(&w, m), *own = (int64_t *)take(&w, m);
    /* moments, and those with the residual, of a piece and all that follow */
    double(*beyond)[6][7] = (double(*)[6][7])take(&w, 42 * (k + 1));
    joint_frames(chain, position, frame);
    twists(chain, data->free, position, frame, twist, first, own);
    chain->cost = moments_of_points(data, chain, position, frame, reach, moments, w);
    memset(beyond[k], 0, sizeof *beyond);
    for (int64_t j = k - 1; j >= 0; j--)
        for (int a = 0; a < 6; a++) {
            for (int b = 0; b < 6; b++) beyond[j][a][b] = beyond[j + 1][a][b] + moments[j][a][b];
            beyond[j][a][6] = beyond[j + 1][a][6] + moments[j][a][8];
        }
    int side = 7; /* of the own components 6 and 7 in turn */
    for (int64_t b = 0; b < m; b++) {
        int64_t here = first[b], of = own[b];
        double response[6], slope = 0.0;
        if (of >= 0) side = 13 - side;
        for (int i = 0; i < 6; i++) {
            response[i] = 0.0;
            for (int c = 0; c < 6; c++) response[i] += beyond[here][i][c] * twist[b][c];
            slope += beyond[here][i][6] * twist[b][i];
        }
        chain->gradient[b] = of >= 0 ? slope + moments[of][side][8] : slope;
        for (int64_t a = 0; a < m; a++) {
            if (first[a] > here || (first[a] == here && a > b)) continue;
            double value = 0.0;
            for (int i = 0; i < 6; i++) value += twist[a][i] * response[i];
            if (of >= 0 && first[a] <= of)
                for (int i = 0; i < 6; i++) value += twist[a][i] * moments[of][i][side];
            else if (of >= 0 && own[a] == of) value += moments[of][a == b ? side : 6][side];
            chain->matrix[a * m + b] = chain->matrix[b * m + a] = value;
        }
    }
}

/* How the foot of the last point moves along the chain with each parameter [m]; (31). A parameter that
   carries the end forwards leaves the point behind it. */
void slide_of_end(int64_t n, const Chain *chain, double slide[], Work w) {
    int64_t k = chain->k, m = chain->m, side = 1;
    double(*position)[3] = (double(*)[3])take(&w, 3 * k), (*frame)[3][3] = (double(*)[3][3])take(&w, 9 * k);
    double(*twist)[6] = (double(*)[6])take(&w, 6 * m), local[4][3], end[3], tangent[3], by[2][3], moved[3];
    int64_t *first = (int64_t *)take(&w, m), *own = (int64_t *)take(&w, m);
    joint_frames(chain, position, frame);
    twists(chain, 1, position, frame, twist, first, own);
    const double *bend = chain->form->piece[k - 1].bend;
    double h = chain->stations[n - 1] - chain->form->piece[k - 1].begin;
    ArcFunctions f = arc_frame(bend, h, local);
    position_by_curvature(f, bend, h, by);
    in_axes(frame[k - 1], local[0], end);
    in_axes(frame[k - 1], local[1], tangent);
    for (int c = 0; c < 3; c++) end[c] += position[k - 1][c];
    for (int64_t a = 0; a < m; a++) {
        if (own[a] >= 0) side = 1 - side;
        for (int c = 0; c < 3; c++) {
            int d = (c + 1) % 3, e = (c + 2) % 3;
            moved[c] = twist[a][c] + twist[a][3 + d] * end[e] - twist[a][3 + e] * end[d];
        }
        if (own[a] == k - 1) in_axes(frame[k - 1], by[side], moved);
        slide[a] = -dot3(tangent, moved);
    }
}
