/* A mechanism of several tendons in one sample: what its march and those beside it share. */
#pragma once
#include "tendon_bars.h"

enum { MOST = 4, HOLDS = 40 }; /* coordinates; numbers of what holds one beside its stiffness */

/* Tensions at both ends [N], and their derivatives by the position of the drive and of the load [N/m]. */
typedef struct {
    double in, out, in_by_in, in_by_out, out_by_in, out_by_out;
} end_forces;

/* One tendon from trial to trial, and from sample to sample. */
typedef struct {
    bar_laws laws;
    step_room room;
    double drive, target; /* where the last trial took its drive, before and behind its play [m] or [N] */
    end_forces forces;    /* of that trial */
} pulled;
_Static_assert(sizeof(pulled) <= 96 * sizeof(double), "room of march_machine");

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
    double *taken;        /* [n][k+1] speed at which friction that follows late is taken [m/s] */
    pulled *tendons;      /* [n] */
    int goes_on;          /* whether the rows before those of drive, end and load are of the sample before */
} sample;

/* Begin the tendons of a machine in room [n][96], with work [21 n][k+1]. */
pulled *begin_tendons(int64_t n, int64_t k, const double *plant, double *room, double *work);
/* Bring one tendon to a trial of the coordinates; returns whether it is in equilibrium. */
int try_tendon(const sample *it, int64_t i, const double z[]);
/* Keep what the last trial did to the tendons in their memories; returns whether all is finite. */
int keep_trial(const sample *it);

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
