/* One step of the Kalman filter of a route, for numbers of the type NUMBER: one λ, or four side by side.

   The state of a coordinate is r, r' = T, T' = a, and b; its covariance p is shared by x, y and z. */

typedef struct { NUMBER p00, p01, p02, p03, p11, p12, p13, p22, p23, p33; } NAMED(Triangle);

/* Carry a covariance over a step: F p F' + Q, with Q what white noise of intensity 1 brings; (20). */
INLINE NAMED(Triangle) NAMED(predict_covariance)(NAMED(Triangle) p, const double f[12], double h) {
    double r1 = f[0], r2 = f[1], r3 = f[2], t1 = f[3], t2 = f[4], t3 = f[5];
    double a1 = f[6], a2 = f[7], a3 = f[8], b1 = f[9], b2 = f[10], b3 = f[11];
    NUMBER c0 = p.p00 + r1 * p.p01 + r2 * p.p02 + r3 * p.p03;
    NUMBER c1 = p.p01 + r1 * p.p11 + r2 * p.p12 + r3 * p.p13;
    NUMBER c2 = p.p02 + r1 * p.p12 + r2 * p.p22 + r3 * p.p23;
    NUMBER c3 = p.p03 + r1 * p.p13 + r2 * p.p23 + r3 * p.p33;
    NUMBER d1 = t1 * p.p11 + t2 * p.p12 + t3 * p.p13;
    NUMBER d2 = t1 * p.p12 + t2 * p.p22 + t3 * p.p23;
    NUMBER d3 = t1 * p.p13 + t2 * p.p23 + t3 * p.p33;
    NUMBER e1 = a1 * p.p11 + a2 * p.p12 + a3 * p.p13;
    NUMBER e2 = a1 * p.p12 + a2 * p.p22 + a3 * p.p23;
    NUMBER e3 = a1 * p.p13 + a2 * p.p23 + a3 * p.p33;
    NUMBER g1 = b1 * p.p11 + b2 * p.p12 + b3 * p.p13;
    NUMBER g2 = b1 * p.p12 + b2 * p.p22 + b3 * p.p23;
    NUMBER g3 = b1 * p.p13 + b2 * p.p23 + b3 * p.p33;
    double h2 = h * h, h3 = h2 * h, h4 = h2 * h2;
    return (NAMED(Triangle)){
        c0 + r1 * c1 + r2 * c2 + r3 * c3 + h3 * h4 / 252, t1 * c1 + t2 * c2 + t3 * c3 + h3 * h3 / 72,
        a1 * c1 + a2 * c2 + a3 * c3 + h2 * h3 / 30,       b1 * c1 + b2 * c2 + b3 * c3 + h4 / 24,
        t1 * d1 + t2 * d2 + t3 * d3 + h2 * h3 / 20,       a1 * d1 + a2 * d2 + a3 * d3 + h4 / 8,
        b1 * d1 + b2 * d2 + b3 * d3 + h3 / 6,             a1 * e1 + a2 * e2 + a3 * e3 + h3 / 3,
        b1 * e1 + b2 * e2 + b3 * e3 + h2 / 2,             b1 * g1 + b2 * g2 + b3 * g3 + h,
    };
}

/* Carry the mean of all coordinates over a step; `out` may be `m`. */
INLINE void NAMED(predict_mean)(NUMBER m[3][4], const double f[12], NUMBER out[3][4]) {
    for (int c = 0; c < 3; c++) {
        NUMBER t = m[c][1], a = m[c][2], b = m[c][3];
        out[c][0] = m[c][0] + f[0] * t + f[1] * a + f[2] * b;
        out[c][1] = f[3] * t + f[4] * a + f[5] * b;
        out[c][2] = f[6] * t + f[7] * a + f[8] * b;
        out[c][3] = f[9] * t + f[10] * a + f[11] * b;
    }
}

/* Covariance before the first point is observed. */
INLINE NAMED(Triangle) NAMED(initial_covariance)(const double ends[4], NUMBER ratio) {
    NUMBER none = 0.0 * ratio;
    return (NAMED(Triangle)){
        ends[0] * ratio, none, none, none, ends[1] * ratio, none, none, ends[2] * ratio, none, ends[3] * ratio};
}

/* Observe the position y with a variance; `off` becomes the innovation. Returns its variance. */
INLINE NUMBER NAMED(observe_position)(
    NAMED(Triangle) *p, NUMBER m[3][4], const double y[3], NUMBER variance, NUMBER off[3]) {
    NUMBER s = p->p00 + variance, inverse = 1.0 / s;
    NUMBER k0 = p->p00 * inverse, k1 = p->p01 * inverse, k2 = p->p02 * inverse, k3 = p->p03 * inverse;
    for (int c = 0; c < 3; c++) {
        NUMBER v = y[c] - m[c][0];
        m[c][0] += k0 * v, m[c][1] += k1 * v, m[c][2] += k2 * v, m[c][3] += k3 * v;
        off[c] = v;
    }
    NUMBER shrink = variance * inverse;
    p->p11 -= k1 * p->p01, p->p12 -= k1 * p->p02, p->p13 -= k1 * p->p03;
    p->p22 -= k2 * p->p02, p->p23 -= k2 * p->p03, p->p33 -= k3 * p->p03;
    p->p00 *= shrink, p->p01 *= shrink, p->p02 *= shrink, p->p03 *= shrink;
    return s;
}

/* Observe the direction with a variance; `off` becomes the innovation. Returns its variance; (90). */
INLINE NUMBER NAMED(observe_tangent)(
    NAMED(Triangle) *p, NUMBER m[3][4], const double tangent[3], NUMBER variance, NUMBER off[3]) {
    NUMBER s = p->p11 + variance, inverse = 1.0 / s;
    NUMBER k0 = p->p01 * inverse, k1 = p->p11 * inverse, k2 = p->p12 * inverse, k3 = p->p13 * inverse;
    for (int c = 0; c < 3; c++) {
        NUMBER v = tangent[c] - m[c][1];
        m[c][0] += k0 * v, m[c][1] += k1 * v, m[c][2] += k2 * v, m[c][3] += k3 * v;
        off[c] = v;
    }
    NUMBER shrink = variance * inverse;
    p->p00 -= k0 * p->p01, p->p02 -= k0 * p->p12, p->p03 -= k0 * p->p13;
    p->p22 -= k2 * p->p12, p->p23 -= k2 * p->p13, p->p33 -= k3 * p->p13;
    p->p01 *= shrink, p->p11 *= shrink, p->p12 *= shrink, p->p13 *= shrink;
    return s;
}

/* Update by the prior of the last station: a and b are zero with the given variances. Returns the determinant
   of the covariance of the two innovations, which `off` becomes, and their variances. */
INLINE NUMBER NAMED(observe_end)(
    NAMED(Triangle) *p, NUMBER m[3][4], NUMBER variance_a, NUMBER variance_b, NUMBER off[2][3], NUMBER spread[2]) {
    NUMBER s = p->p22 + variance_a, over_s = 1.0 / s;
    NUMBER k0 = p->p02 * over_s, k1 = p->p12 * over_s, k2 = p->p22 * over_s, k3 = p->p23 * over_s;
    NUMBER q00 = p->p00 - k0 * p->p02, q01 = p->p01 - k0 * p->p12, q02 = p->p02 - k0 * p->p22;
    NUMBER q03 = p->p03 - k0 * p->p23, q11 = p->p11 - k1 * p->p12, q12 = p->p12 - k1 * p->p22;
    NUMBER q13 = p->p13 - k1 * p->p23, q22 = p->p22 * variance_a * over_s, q23 = p->p23 - k2 * p->p23;
    NUMBER q33 = p->p33 - k3 * p->p23;
    NUMBER z = q33 + variance_b, over_z = 1.0 / z;
    NUMBER l0 = q03 * over_z, l1 = q13 * over_z, l2 = q23 * over_z, l3 = q33 * over_z;
    for (int c = 0; c < 3; c++) {
        NUMBER a = m[c][2], b = m[c][3] - k3 * a;
        off[0][c] = a, off[1][c] = b;
        m[c][0] -= k0 * a + l0 * b, m[c][1] -= k1 * a + l1 * b;
        m[c][2] -= k2 * a + l2 * b, m[c][3] -= k3 * a + l3 * b;
    }
    *p = (NAMED(Triangle)){
        q00 - l0 * q03, q01 - l0 * q13, q02 - l0 * q23, q03 - l0 * q33, q11 - l1 * q13,
        q12 - l1 * q23, q13 - l1 * q33, q22 - l2 * q23, q23 - l2 * q33, q33 * variance_b * over_z};
    spread[0] = s, spread[1] = z;
    return s * z;
}
