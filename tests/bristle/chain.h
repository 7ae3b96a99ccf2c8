typedef struct {
    int elements, kinds, curve_points, load_points, pull_points;
    int load_node, drive_mode, far_mode;
    double drive, far;
    const double *length, *curve_strain, *curve_tension, *start_strain, *load_move, *load_force;
    const double *pull_stretch, *pull_force;
    const double *bend, *rub_pull, *rub_release, *rub_straight, *stiffness, *share;
    const double *node_stiffness, *node_limit;
    const double *extra_strain;
    double *move, *slip, *node_slip, *tension, *work, *ends;
} Chain;

int bristle_step(const Chain *chain, int most, double tolerance);
