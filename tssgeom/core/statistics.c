#include "statistics.h"

#include <string.h>

/* Put the values into order as far as needed for element k to be where a sort would put it (Hoare). */
static void select_kth(int64_t n, double values[], int64_t k) {
    int64_t low = 0, high = n - 1;
    while (low < high) {
        double pivot = values[low + (high - low) / 2];
        int64_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot) i++;
            while (values[j] > pivot) j--;
            if (i <= j) {
                double swap = values[i];
                values[i++] = values[j];
                values[j--] = swap;
            }
        }
        if (k <= j) high = j;
        else if (k >= i) low = i;
        else return;
    }
}

double median_of(int64_t n, double values[]) {
    if (n == 0) return NAN;
    for (int64_t i = 0; i < n; i++)
        if (isnan(values[i])) return NAN;
    int64_t half = n / 2;
    select_kth(n, values, half);
    if (n % 2) return values[half];
    double below = values[0];
    for (int64_t i = 1; i < half; i++) below = most(below, values[i]);
    return 0.5 * (below + values[half]);
}

double quantile_of(int64_t n, double values[], int64_t k) {
    if (n == 0) return NAN;
    select_kth(n, values, k);
    return values[k];
}

/** Return the median of some numbers [n]. */
ENTRY double tss_median(int64_t n, const double values[n], WORK double work[n]) {
    memcpy(work, values, (size_t)n * sizeof *work);
    return median_of(n, work);
}

/** Return the nearest non-decreasing sequence in weighted least squares (pool adjacent violators).

Parameters: values and positive weights [n]. */
ENTRY void tss_isotonic_regression(
    int64_t n, const double x[n], const double weight[n], OUT double result[n], WORK double work[3][n]) {
    double *level = work[0], *mass = work[1], *count = work[2];
    int64_t top = 0;
    for (int64_t i = 0; i < n; i++, top++) {
        level[top] = x[i], mass[top] = weight[i], count[top] = 1.0;
        for (; top > 0 && level[top - 1] > level[top]; top--) {
            double total = mass[top - 1] + mass[top];
            level[top - 1] = (mass[top - 1] * level[top - 1] + mass[top] * level[top]) / total;
            mass[top - 1] = total;
            count[top - 1] += count[top];
        }
    }
    for (int64_t block = 0, i = 0; block < top; block++)
        for (int64_t k = 0; k < (int64_t)count[block]; k++) result[i++] = level[block];
}

/** Whether this processor has AVX2. */
ENTRY int64_t tss_has_avx2(void) {
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2") != 0;
#else
    return 0;
#endif
}
