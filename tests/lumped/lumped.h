/* What stays the same during a run: fields as in assembly.py; k nodes, b = k + 1 bars, c relaxation times. */
typedef struct {
    int64_t nodes, creeps;
    const double *compliance, *toe, *toe_scale;      /* [b] m/N, m, N */
    double clearance_per_turn, clearance_scale;      /* m/rad, N */
    const double *expansion;                         /* [b] m/K */
    const double *creep_compliance, *creep_time;     /* [b][c] m/N, [c] s */
    const double *friction, *floor, *drag, *share;   /* [k] 1, N, N s/m, m */
    double asymmetry, curvature_gain, load_exponent, load_reference, wear_gain, wear_travel;
    double speed_law[4], speed_lag, pretension;
    int64_t load_is_normal, by_speed, straight, force_driven, weight;
} Chain;

/* The state after each step that is kept, f of them. */
typedef struct {
    double *tension, *position, *friction, *slip, *work; /* [f][b], [f][k] three times, [f] */
} Records;

/* How far along its path a run is imposed at g times; the path has p frames. */
typedef struct {
    int64_t times, frames;
    const double *span, *drive, *warmth;   /* [g] s, N or m, K */
    const int64_t *frame;                  /* [g] */
    const double *weight;                  /* [g] towards the next frame */
    const double *growth, *turns;          /* [p][k - 1] m, [p][k - 2] rad */
    const uint8_t *keep;                   /* [g] */
} Imposed;

/* A curved law of a bar: extension [m] when taut beyond its loose length; its compliance there [m/N]. */
double stretched(
    double tension, double compliance, double toe, double toe_scale, double clearance, double clearance_scale,
    double *slope);

/* What a sliding speed [m/s] makes of the friction; its slope [s/m] where that is above zero. */
double speed_factor(double speed, const double law[4], double *slope);

/* Coulomb force per sum of the two tensions at node i, for pulling and for releasing [1]. */
void grip(const Chain *chain, double turn, double travel, double total, int64_t i, double result[2]);

/* Fill in tension [b] and motion [k] of a step; return whether there is an equilibrium. work: [24 k + 40]. */
int answer(
    const Chain *chain, const double *offset, const double *slope, const double (*up)[3],
    const double (*down)[3], double drive, double *tension, double *moved, double *work);

/* Run the steps; return how many, or minus the grid point, from 1, where no balance was found. */
int64_t march(const Chain *chain, const Imposed *imposed, Records *records, int64_t *passes);
