/* Conventions of the compiled core. Every entry of this folder keeps them, and `build.py` reads them.

   An ENTRY is called from Python as a function of the same name without `tss_`; its wrapper is generated.

   Parameters
     int64_t n            a size; the wrapper takes it from the first array that has it as a dimension,
                          any other integer, and every double, is an argument
     const T a[n][3]      input, C-contiguous, read only; T is double, int64_t, uint8_t (0 or 1) or char
     OPTIONAL const T a[] input or NULL
     INOUT T a[n]         changed in place
     OUT T a[n]           made by the wrapper and returned; every element is written
     OUT T *x             one number, returned
     WORK double w[…]     memory of the caller's for the time of the call, without a meaning before or after
   Nothing is allocated, nothing is kept between calls, and there is no state beside the constants, so that
   entries may run in any number of threads.

   Units are SI (m, rad, N, s) unless the comment of an entry says otherwise. Numbers of equations are those of
   docs/model.md. Matrices are stored by rows. A covariance of the state r, T, a, b of one coordinate is its
   upper triangle: 00, 01, 02, 03, 11, 12, 13, 22, 23, 33.

   Digits. Sums run in the order in which they are written, and are neither fused nor reordered by the compiler,
   so that every processor gives the same result; only the last digit of sin, cos, exp and log is the C
   library's own.

   Return codes. A `status` is 0, or one of the codes below; results are then without meaning. NaN and singular
   input ends in a code, never in a loop without end: every loop has a bound. */
#pragma once

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "constants.h"

typedef int status;
enum {
    DONE = 0,
    NO_FINITE_CURVE = 1,
    NO_EQUILIBRIUM = 2,
    WRONG_SIZE = 3, /* sizes or indices that do not belong to each other: a mistake of the caller */
};

#if defined(_WIN32)
#define ENTRY __declspec(dllexport)
#else
#define ENTRY __attribute__((visibility("default")))
#endif
#define OUT
#define INOUT
#define OPTIONAL
#define WORK

static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }
static inline double within(double x, double low, double high) { return least(most(x, low), high); }
static inline double squared(double x) { return x * x; }
static inline double dot3(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static inline double distance3(const double a[3], const double b[3]) {
    return sqrt(squared(a[0] - b[0]) + squared(a[1] - b[1]) + squared(a[2] - b[2]));
}

/* Median of some numbers [n], which are put into another order. */
double median_of(int64_t n, double values[]);

/* The number that a sort would put at index k; the numbers [n] are put into another order. */
double quantile_of(int64_t n, double values[], int64_t k);
