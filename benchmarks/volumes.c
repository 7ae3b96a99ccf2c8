/* Finite volumes of a tendon: implicit, by Tresca's iteration. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "volumes.h"

static const double TOLERANCE = 1e-10;        /* of the greatest tension */
static const int64_t PASSES = 4;              /* for each face, before a step is halved */
static const double LEAST_PART = 1.0 / 4096;  /* of a step */

typedef struct {
    double *slides; /* side to which each face slides, 0 where it sticks */
    double *limit;  /* friction at its limit [N] */
    double *force, *start; /* what it holds, and held before [N] */
    double *moved;  /* m */
    double *behind; /* share of the movement of the next face, by elimination */
    double *turn;   /* μΔφ */
} Faces;

/* Movements of the faces that slide, each at its limit, by elimination [m]. */
static void move_faces(int64_t n, const Faces *faces, const double *stiffness) {
    double *moved = faces->moved, *behind = faces->behind, last = 0.0;
    for (int64_t i = 0; i < n; i++) {
        moved[i] = behind[i] = 0.0;
        if (faces->slides[i] != 0.0) {
            double near = stiffness[i];
            double diagonal = near + stiffness[i + 1] - (i > 0 ? near * behind[i - 1] : 0.0);
            moved[i] = (faces->start[i] - faces->slides[i] * faces->limit[i] + near * last) / diagonal;
            behind[i] = stiffness[i + 1] / diagonal;
        }
        last = moved[i];
    }
    for (int64_t i = n - 2; i >= 0; i--) moved[i] += behind[i] * moved[i + 1];
}

/* Guess which faces slide and how much friction each holds, solve, and repeat until both stay. */
static int balance(
    int64_t n, const double *old, const double *stiffness, double drive, const Faces *faces,
    double *tension) {
    double greatest = drive, side = (drive > old[0]) - (drive < old[0]);
    for (int64_t i = 0; i <= n; i++) greatest = fmax(greatest, old[i]);
    memcpy(tension, old, (size_t)(n + 1) * sizeof *tension);
    tension[0] = drive;
    for (int64_t i = 0; i < n; i++) {
        faces->slides[i] = side, faces->moved[i] = faces->limit[i] = 0.0;
        faces->force[i] = faces->start[i] = tension[i] - tension[i + 1];
    }
    double enough = TOLERANCE * greatest;
    for (int64_t pass = 0; pass < PASSES * n; pass++) {
        double worst = 0.0;
        int turned = 0;
        for (int64_t i = 0; i < n; i++) {
            double limit = fmax(0.5 * faces->turn[i] * (tension[i] + tension[i + 1]), 0.0);
            double was = faces->slides[i];
            worst = fmax(worst, fabs(limit - faces->limit[i]));
            faces->limit[i] = limit;
            if (was == 0.0)
                faces->slides[i] = (faces->force[i] > limit + enough) - (faces->force[i] < -limit - enough);
            else if (faces->moved[i] * was < 0.0)
                faces->slides[i] = 0.0;
            turned |= was != faces->slides[i];
        }
        if (worst <= enough && !turned) return 1;
        move_faces(n, faces, stiffness);
        for (int64_t k = 1; k < n; k++)
            tension[k] = old[k] + stiffness[k] * (faces->moved[k - 1] - faces->moved[k]);
        tension[n] = old[n] + stiffness[n] * faces->moved[n - 1];
        for (int64_t i = 0; i < n; i++) faces->force[i] = tension[i] - tension[i + 1];
    }
    return 0;
}

int64_t pull(
    int64_t n, double *tension, const double *turn_before, const double *turn_after, const double *stiffness,
    double drive, double *memory) {
    Faces faces = { memory,         memory + n,     memory + 2 * n, memory + 3 * n,
                    memory + 4 * n, memory + 5 * n, memory + 6 * n };
    double *trial = memory + 7 * n, done = 0.0, part = 1.0, start = tension[0];
    int64_t parts = 0;
    while (done < 1.0) { /* at most 4096 parts */
        double goal = fmin(done + part, 1.0);
        for (int64_t i = 0; i < n; i++)
            faces.turn[i] = turn_before[i] + goal * (turn_after[i] - turn_before[i]);
        if (balance(n, tension, stiffness, start + goal * (drive - start), &faces, trial)) {
            memcpy(tension, trial, (size_t)(n + 1) * sizeof *tension);
            done = goal;
            parts++;
        } else if ((part *= 0.5) < LEAST_PART) {
            return 0;
        }
    }
    return parts;
}
