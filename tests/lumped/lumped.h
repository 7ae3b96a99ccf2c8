/* What stays the same during a run: fields as in assembly.py; k nodes, b = k + 1 bars, c relaxation times. */
typedef struct {
    int64_t nodes, creeps;
    const double *compliance, *toe, *toe_scale;      /* [b] m/N, m, N */
    double clearance_per_turn, clearance_scale;      /* m/rad, N */
    const double *expansion;                         /* [b] m/K */
    const double *creep_compliance, *creep_time;     /* [b][c] m/N, [c] s */
    const double *friction, *floor, *drag, *share;   /* [k] 1, N, N s/m, m */
    double asymmetry, curvature_gain, load_exponent, load_reference, wear_gain, wear_travel;
    double speed_law[4], speed_lag, pretension, slack; /* N, m */
    int64_t load_is_normal, by_speed, straight, force_driven, weight;
} Chain;

/* The state after each step that is kept, f of them; if `ends_only`, the first and last entry of each. */
typedef struct {
    int64_t ends_only;
    double *tension, *position, *friction, *slip, *work; /* [f][b], [f][k] three times, [f] */
} Records;

/* How far along its path a run is imposed at g times; the path has p frames. */
typedef struct {
    int64_t times, frames;
    const double *span, *drive, *warmth;   /* [g] s, N or m, K */
    const int64_t *frame;                  /* [g] */
    const double *weight;                  /* [g] towards the next frame */
    const double *growth, *turns;          /* [p][k - 1] m, [p][k - 2] rad */
    const double *friction, *compliance;   /* [p][k - 2], [p][k - 1] factors on those of the chain */
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

typedef struct { /* what a step leaves to the next; k nodes, b bars, c relaxation times */
    double *position; /* [k] displacement of the nodes, towards the proximal end [m] */
    double *tension;  /* [b] N */
    double *friction; /* [k] against motion to the proximal end [N] */
    double *slip;     /* [k] of the last step [m] */
    double *travel;   /* [k] slipped so far, either way [m] */
    double *speed;    /* [k] as the friction feels it [m/s] */
    double *creep;    /* [b][c] m */
    double work;      /* turned into heat by friction [J] */
} State;

typedef struct { /* what is imposed at one time */
    double drive, out, warmth; /* N or m, m of the far end, K above the start */
    double *growth;       /* [b] m each bar's path is longer than at the start */
    double *turns;        /* [k] rad, 0 at the fittings */
    double *friction;     /* [k] factor on the coefficient of each node, 1 at the fittings */
    double *compliance;   /* [b] factor on the elastic compliance of each bar, 1 outside the sheath */
} Inputs;

typedef struct { /* memory of a step */
    double *base, *soft, *offset, *slope, *last, *tension, *moved, *sweep;
    double (*up)[3], (*down)[3];
} Memory;

/* Extension [m] of each bar in the pretensioned state, on its way of loading, less what is slack. */
void find_rest(const Chain *chain, const double *turns, const double *compliance, double *rest);

/* Balance the chain under what is imposed after `span` [s]; return passes, below 0 without a balance. */
int64_t balance(
    const Chain *chain, const State *state, const double *rest, const Inputs *goal, double span,
    Memory *memory);

/* Take over tension and motion of a balanced step. */
void take_over(const Chain *chain, State *state, const Inputs *goal, const Memory *memory, double span);

/* One tendon at a time of its run: made at rest, or NULL without memory; the chain must outlive it. */
typedef struct Tendon Tendon;
Tendon *tendon_new(const Chain *chain, const Imposed *imposed);
void tendon_free(Tendon *tendon);

/* Go on to what is imposed at grid point g. */
void tendon_next(Tendon *tendon, const Imposed *imposed, int64_t g);

/* Take that share of the way from the grid point before; return its drive. */
double tendon_part(Tendon *tendon, double share);

/* Balance it with this drive and the far end moved by `out` [m] towards the drive; return as `balance`. */
int64_t tendon_try(Tendon *tendon, double drive, double out, double span);

/* Tension at drive and load [N]; slopes of the first by drive and load, of the second [N/m, 1 by a force]. */
void tendon_ends(const Tendon *tendon, double ends[6]);

/* Keep what was tried; write it down. */
void tendon_keep(Tendon *tendon, double span);
void tendon_record(const Tendon *tendon, Records *records, int64_t row);

/* Run the steps; return how many, or minus the grid point, from 1, where the balance did not converge. */
int64_t march(const Chain *chain, const Imposed *imposed, Records *records, int64_t *passes);
