/* Curvatures sensed along a fibre; docs/model.md (36) to (38).

   A piece of x metres goes on with the probability 1/(1 + rate x). A kind has curvature components of a variance
   [1/m²], straight where 0, whose covariance decays with decay [1/m], constant where 0; share is its
   probability. */
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
