/* Sensed points before a fit, and what follows from a fitted route: curvature, angle and pieces. SI units. */
#pragma once
#include "core.h"

void normals(const double tangent[3], double first[3], double second[3]);
int64_t pieces_of_curvature(
    int64_t n, const double s[], const double tangent[][3], const double bend[][3], const double covariance[][10],
    double freedom, double points, int64_t joints[], double *work);
void angles_of_pieces(
    const double s[], const double phi[], int64_t count, const int64_t joints[], double angle[], double *work);
double outlier_limit(int64_t count, double variance);
double residual_variance(double known, double robust, double spacing);

double tss_spacing_of_pieces(int64_t n, const double points[n][3], double length, double work[n]);
void tss_path_length(int64_t n, const double points[n][3], const double weight[n], int64_t *ignored, double *path);
