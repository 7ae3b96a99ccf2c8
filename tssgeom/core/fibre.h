/* Curvatures sensed along a fibre; docs/model.md (36) to (38). */
#pragma once
#include "core.h"

enum {
    STATES = 4, /* of a smooth component y_k = (d/ds + λ)^k κ; Matérn covariance of the order 7/2 */
    NORMALS = 2 * STATES,
    OF_PIECE = 3 + STATES * STATES + 2 * STATES, /* numbers of a piece that goes on */
    OF_STEP = 3 * STATES * STATES + 1,           /* of a step along the fibre */
    OF_SITE = 3 * STATES * STATES + 4 * STATES   /* and of a site of a filtered piece */
};

/* Transition of the states over a step, and the covariance that it adds. */
typedef struct {
    double over[STATES][STATES], columns[STATES][STATES], added[STATES][STATES], decay;
} Step;

/* Covariance of the states, grown over a step h; infinite for that of the prior; docs/model.md (37). */
void grown(double variance, double decay, double h, double out[STATES][STATES]);

Step step_over(double h, double variance, double decay);

/* Lower triangle L of a covariance L Lᵀ; 0 where it has none. */
void root_of(const double covariance[STATES][STATES], double root[STATES][STATES]);

/* Columns of a lower triangle, as `root_of`. */
void columns_of(const double covariance[STATES][STATES], double column[STATES][STATES]);

/** ln of the evidence of curvatures at n sites, over all partitions into pieces of k kinds; docs/model.md (36).

A piece of x metres goes on with the probability 1/(1 + rate x). A kind has curvature components of a variance
[1/m²], straight where 0, whose covariance decays with decay [1/m], constant where 0; share is its probability.
Without the constant of Gaussian densities, that is Σ ln(precision/2π) over the sites that were read.

s [n]: arc length of the sites, from the proximal to the distal end [m]; bend [n][2]: components sensed there
[1/m]; precision [n]: of each, 0 where none was read [m²]. Returned with it is the likeliest partition: where
the last piece of the sites before each one begins, and its kind [n + 1]. */
ENTRY void tss_fibre_evidence(
    int64_t n, int64_t k, const double s[n], const double bend[n][2], const double precision[n],
    const double variance[k], const double decay[k], const double share[k], double rate,
    OUT double *log_evidence, OUT int64_t origin[n + 1], OUT int64_t kind[n + 1],
    WORK double work[79 * k * n + 3 * n + 20 * k]);

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
    WORK double work[3 * k * n * n + 85 * k * n + 80 * n + 20 * k + 5 * d * n]);
