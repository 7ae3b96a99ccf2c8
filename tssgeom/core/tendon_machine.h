/* A mechanism of several tendons in one sample: what its march and those beside it share. */
#pragma once
#include "tendon_bars.h"

enum { MOST = 4, HOLDS = 40 }; /* coordinates; numbers of what holds one beside its stiffness */

/* What does not change from trial to trial of one sample. */
typedef struct {
    int64_t n, k, m;
    const double *plant, *proximal, *distal, *stiffness, *holds, *at_rest; /* as `march_machine` */
    const double *drive, *end, *load;
    int by_force;
    double friction, slides; /* of the only coordinate: that which holds it, and against its motion */
    double span, warmth;
    const double *before; /* [n] memories of 9 (k + 1) + 7 numbers before the sample */
    double *trial;        /* [n] the same of the trial */
    double *rest;         /* [k+1] */
    double *work;         /* of a room */
    double *taken;        /* [n][k+1] speed at which friction that follows late is taken [m/s] */
} sample;

/* Force against a coordinate z by its weight, hardening spring and table, a row of `holds`; docs/model.md (173). */
double held_by(const double law[], double z);
/* Its derivative. */
double held_slope(const double law[], double z);
/* Solve slope · step = −left [m] by elimination with pivots; a coordinate that nothing holds does not move. */
void solve_step(int64_t m, double slope[], double left[], double step[]);
/* Move the coordinates to where all forces balance; returns whether they do; docs/model.md (175). */
int solve_balance(const sample *it, double z[]);
/* Read T_in, T_out [N], x_in, x_out [m] of every tendon after a sample with the coordinates z. */
void read_ends(const sample *it, const double z[], double ends[]);
