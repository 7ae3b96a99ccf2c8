#include "core.h"

enum { MOST_AROUND = 256 }; /* triangles that meet in one point */
enum { MOST_PENDING = 64 }; /* boxes put off: one more than the tree has rows */

typedef struct { /* triangles in a tree of boxes */
    const double (*corners)[3][3];
    const int64_t *order;
    const double (*low)[3], (*high)[3];
    int64_t leaves, group; /* boxes of the lowest row, triangles in each */
} Tree;

static const double PI = 3.14159265358979323846;

static void difference3(const double a[3], const double b[3], double result[3]) {
    for (int c = 0; c < 3; c++) result[c] = a[c] - b[c];
}

/* Square of the distance to a box, 0 inside [m²]. */
static double square_to_box(const double p[3], const Tree *tree, int64_t box) {
    double total = 0.0;
    for (int c = 0; c < 3; c++)
        total += squared(most(most(tree->low[box][c] - p[c], p[c] - tree->high[box][c]), 0.0));
    return total;
}

/* Nearest point q of the side a b, and the square of its distance. */
static double nearest_on_side(const double p[3], const double a[3], const double b[3], double q[3]) {
    double along[3], from_a[3];
    difference3(b, a, along);
    difference3(p, a, from_a);
    double share = within(dot3(from_a, along) / most(dot3(along, along), 1e-300), 0.0, 1.0);
    for (int c = 0; c < 3; c++) q[c] = a[c] + share * along[c];
    return squared(q[0] - p[0]) + squared(q[1] - p[1]) + squared(q[2] - p[2]);
}

/* Nearest point q of a triangle, and the square of its distance: the foot of the perpendicular where it falls
   inside, else the nearest point of a side. */
static double nearest_on_triangle(const double p[3], const double t[3][3], double q[3]) {
    double b[3], c[3], d[3];
    difference3(t[1], t[0], b);
    difference3(t[2], t[0], c);
    difference3(p, t[0], d);
    double bb = dot3(b, b), bc = dot3(b, c), cc = dot3(c, c), db = dot3(d, b), dc = dot3(d, c);
    double whole = bb * cc - bc * bc;
    if (whole > ROUNDING.exact * bb * cc) {
        double u = (cc * db - bc * dc) / whole, v = (bb * dc - bc * db) / whole;
        if (u >= 0.0 && v >= 0.0 && u + v <= 1.0) {
            for (int k = 0; k < 3; k++) q[k] = t[0][k] + u * b[k] + v * c[k];
            return squared(q[0] - p[0]) + squared(q[1] - p[1]) + squared(q[2] - p[2]);
        }
    }
    double least = INFINITY;
    for (int k = 0; k < 3; k++) {
        double at[3], square = nearest_on_side(p, t[k], t[(k + 1) % 3], at);
        if (square >= least) continue;
        least = square;
        for (int j = 0; j < 3; j++) q[j] = at[j];
    }
    return least;
}

/* Visit the triangles within a distance of p, those of near boxes first. With `around` they are gathered, and
   how many there are is returned; else the distance shrinks to the nearest, whose point becomes q [m²]. */
static int64_t search(const double p[3], double *square, const Tree *tree, double q[3], int64_t around[]) {
    int64_t pending[MOST_PENDING], top = 0, count = 0;
    double away[MOST_PENDING]; /* square of the distance to each of them */
    pending[0] = 0, away[0] = 0.0;
    while (top >= 0) { /* each box is taken up once at most */
        int64_t box = pending[top];
        if (away[top--] > *square) continue;
        if (box < tree->leaves - 1) {
            double first = square_to_box(p, tree, 2 * box + 1), other = square_to_box(p, tree, 2 * box + 2);
            int nearer = first < other; /* it goes on top, and is taken up first */
            pending[++top] = 2 * box + 1 + nearer, away[top] = most(first, other);
            pending[++top] = 2 * box + 2 - nearer, away[top] = least(first, other);
            continue;
        }
        const int64_t *inside = tree->order + (box - tree->leaves + 1) * tree->group;
        for (int64_t i = 0; i < tree->group; i++) {
            if (inside[i] < 0) continue;
            double at[3], far = nearest_on_triangle(p, tree->corners[inside[i]], at);
            if (around && far <= *square && count < MOST_AROUND) around[count++] = inside[i];
            if (around || far >= *square) continue;
            *square = far;
            for (int c = 0; c < 3; c++) q[c] = at[c];
        }
    }
    return count;
}

static int has_corner(const double t[3][3], const double corner[3], double near) {
    for (int c = 0; c < 3; c++)
        if (distance3(t[c], corner) <= near) return 1;
    return 0;
}

/* Whether a point lies on a side that one triangle alone has. */
static int is_on_rim(const double p[3], const Tree *tree, int64_t count, const int64_t around[]) {
    double at[3];
    for (int64_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            const double *a = tree->corners[around[i]][c], *b = tree->corners[around[i]][(c + 1) % 3];
            double near = 10.0 * WALL.same_point * distance3(a, b) + 1e-15;
            if (sqrt(nearest_on_side(p, a, b, at)) > near) continue;
            int shared = 0;
            for (int64_t j = 0; j < count && !shared; j++) {
                const double (*other)[3] = tree->corners[around[j]];
                shared = j != i && has_corner(other, a, near) && has_corner(other, b, near);
            }
            if (!shared) return 1;
        }
    return 0;
}

/* Angle that a triangle takes around a point q on it: 2π inside, π on a side, its own at a corner [rad]. */
static double angle_at(const double t[3][3], const double q[3], double near) {
    double a[3], b[3];
    for (int c = 0; c < 3; c++)
        if (distance3(t[c], q) <= near) {
            difference3(t[(c + 1) % 3], t[c], a);
            difference3(t[(c + 2) % 3], t[c], b);
            double size = most(sqrt(dot3(a, a) * dot3(b, b)), 1e-300);
            return acos(within(dot3(a, b) / size, -1.0, 1.0));
        }
    for (int c = 0; c < 3; c++)
        if (sqrt(nearest_on_side(q, t[c], t[(c + 1) % 3], a)) <= near) return PI;
    return 2.0 * PI;
}

static void add_normal(const double t[3][3], double weight, double sum[3]) {
    double a[3], b[3];
    difference3(t[1], t[0], a);
    difference3(t[2], t[0], b);
    double n[3] = { a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0] };
    double size = most(sqrt(dot3(n, n)), 1e-300);
    for (int c = 0; c < 3; c++) sum[c] += weight * (n[c] / size);
}

/* Whether the boxes are a complete binary tree, its lowest row full, and every triangle is one of those given. */
static int is_tree(int64_t f, int64_t g, int64_t b, const int64_t order[]) {
    int64_t leaves = (b + 1) / 2;
    if (b < 1 || leaves > (int64_t)1 << (MOST_PENDING - 2) || (leaves & (leaves - 1)) || 2 * leaves - 1 != b) return 0;
    if (g % leaves) return 0;
    for (int64_t i = 0; i < g; i++)
        if (order[i] >= f) return 0;
    return 1;
}

/** Find the nearest point of a wall of triangles for each point; docs/model.md (144).

Parameters: points [n][3] and the corners of the triangles [f][3][3], in m. Boxes around the triangles in a
complete binary tree, the children of box k being 2k + 1 and 2k + 2: lower and upper corners [b][3], infinite
where a box is empty, and the numbers of the triangles in the boxes of the lowest row [g], -1 for none.
Returns the nearest points [n][3] and their distances [n] in m; the side [n], +1 where the normal of the wall
points towards the point and -1 where it points away; and whether the nearest point is on the rim of the wall,
where the side is undefined [n]. */
ENTRY status tss_nearest_on_wall(
    int64_t n, int64_t f, int64_t g, int64_t b, const double points[n][3], const double corners[f][3][3],
    const int64_t order[g], const double low[b][3], const double high[b][3],
    OUT double position[n][3], OUT double distance[n], OUT double side[n], OUT uint8_t on_rim[n]) {
    if (!is_tree(f, g, b, order)) return WRONG_SIZE;
    Tree tree = { corners, order, low, high, (b + 1) / 2, 2 * g / (b + 1) };
    int64_t around[MOST_AROUND];
    for (int64_t i = 0; i < n; i++) {
        double at[3], away[3], normal[3] = { 0.0, 0.0, 0.0 }, angle = 0.0;
        double square = INFINITY;
        for (int c = 0; c < 3; c++) position[i][c] = points[i][c]; /* for points that are not finite */
        search(points[i], &square, &tree, position[i], NULL);
        distance[i] = sqrt(square);
        double near = WALL.same_point * (distance[i] + POINTS.least_extent);
        square = near * near;
        int64_t count = search(position[i], &square, &tree, at, around);
        for (int64_t k = 0; k < count; k++) { /* the mean normal, weighted by angle; (144) */
            const double (*t)[3] = corners[around[k]];
            nearest_on_triangle(position[i], t, at);
            double part = angle_at(t, at, 10.0 * near + WALL.same_point * distance3(t[0], t[1]));
            angle += part;
            add_normal(t, part, normal);
        }
        difference3(points[i], position[i], away);
        side[i] = dot3(away, normal) >= 0.0 ? 1.0 : -1.0;
        on_rim[i] = angle < 2.0 * PI && is_on_rim(position[i], &tree, count, around);
    }
    return DONE;
}
