/* Bring a tendon of finite volumes to equilibrium in one step of drive and route.

   n faces; tension [n + 1] N is changed; turn before and after [n] is μΔφ of each face; stiffness [n + 1]
   N/m; memory [8 n + 1]. Return the number of parts into which the step was cut, 0 where it failed. */
int64_t pull(
    int64_t n, double *tension, const double *turn_before, const double *turn_after, const double *stiffness,
    double drive, double *memory);
