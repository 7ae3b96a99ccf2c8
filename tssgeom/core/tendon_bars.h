/* Bars and contacts: what the files of the tendon share. */
#pragma once
#include "tendon.h"

enum { CREEPS = 3 };    /* elements of creep */
enum { LAW_ROWS = 17, PLANT_NUMBERS = 23 }; /* of LAW, then of PLANT, then the tables of CURVE */

/* What a contact does: slides towards the proximal end, holds, slides towards the distal end. */
enum { PULLED = 1, STUCK = 0, RELEASED = -1 };

/* The grid of a tendon on a route: length and mean φ of k − 1 bars, angle and span of k contacts. */
typedef struct {
    double *length, *mean_angle, *angle, *span;
} contact_grid;

/* Laws of k + 1 bars and k contacts; the fields are those of LAW and PLANT in constants_tendon_rows.py. */
typedef struct {
    int64_t k;
    const double *soft, *toe, *toe_scale, *saved, *creep_soft[CREEPS], *warm, *rest;
    const double *pulling, *releasing, *fitting, *low, *high, *force, *drag;
    const double *tables; /* of CURVE */
    double pretension, load, saved_scale, clearance, creep_time[CREEPS], load_exponent, load_reference;
    double wear_gain, wear_travel, speed_gain, speed_reference, speed_memory, backlash;
    const double *presliding;    /* movement before a contact slides [m], at a tension of [N] */
    double presliding_reference;
    double now; /* factor of all friction in this step, by time and position [1] */
    int curved, by_rate, varied, swift;
    int loaded, by_speed, worn; /* whether friction depends on tension; on speed; on what was before */
    int late;                   /* whether it follows another speed than that of the step */
    int creeps;                 /* whether any bar does */
    int gives;                  /* whether contacts do, before they slide */
} bar_laws;

/* What one step leaves to the next: the rows of MEMORY and the numbers of HELD. */
typedef struct {
    double *tension, *creep[CREEPS], *rest, *displacement, *speed, *travel, *slip, *held;
} bar_memory;

/* Linear laws of k + 1 bars and friction of the k contacts between them for one step, and their solution. */
typedef struct {
    int64_t k;
    double *trial; /* [k+1] tension of each bar if no contact moved, negative where it would be slack [N] */
    double *
        stiffness; /* [k+1] 0 where the tension is given (force drive, dead weight) and at rigid ends [N/m] */
    double *low; /* [k] least T[i+1] over T[i], but for the force of friction [1] */
    double *high; /* [k] greatest T[i+1] over T[i], but for the force of friction [1] */
    double *force; /* [k] T[i+1] lies between low·T[i] − force and high·T[i] + force [N] */
    double *drag; /* [k] friction for each metre moved in this step [N/m] */
    double *bristle; /* [k] friction for each metre that a contact gives before it slides; INFINITY: none [N/m] */
    double *kept; /* [k] friction before the step, of a contact that gives [N] */
    int rigid_in; /* whether the proximal end moves by exactly `shift` */
    int rigid_out; /* whether the distal end is fixed */
    double shift; /* [m] */
    double *tension; /* [k+1] N */
    double *w; /* [k] movement of each contact [m] */
    double *ratios; /* [k] of the elimination */
    int64_t rounds; /* of relaxation at most; half of them once all were in vain */
    int8_t *slip; /* [k] what each contact does */
    int8_t *tight; /* [k+1] whether each bar carries tension */
} bar_chain;

/* Room of one step: the chain, and what bars and contacts would do; 20 rows of k + 1 numbers. */
typedef struct {
    bar_chain chain;
    double *given; /* [k+1] stretch of each bar if no contact moved [m] */
    double *about, *moved; /* [k+1] N, [k] m: the last pass */
    double *pulling, *releasing; /* [k] exponents after wear [1] */
    double *steep; /* [k] rise of the factor of friction with the tension at each contact [1/N] */
    double *taken; /* [k] speed at which friction that follows late is taken [m/s] */
    int taken_given; /* whether `taken` was set by whoever takes the step */
} step_room;

/* Search for the speeds at which friction is taken that it follows then, pass by pass; docs/model.md (313). */
typedef struct {
    double sum, before; /* of how far they are off, in this pass and the one before [m/s] */
    double most;        /* by which any is off [m/s] */
    double share;       /* of that which is added to them [1] */
    double close;       /* by which they may be off [m/s]; negative where friction follows none late */
} speed_search;

/* Shares of old creep, old and new tension in the creep after a step; docs/model.md (57). */
typedef struct {
    double kept, old, new;
} creep_shares;

/* The tables of CURVE in a plant. */
const double *tables_of(int64_t k, const double *plant);
bar_laws laws_of(int64_t k, const double *plant);
bar_memory memory_of(int64_t k, double *block);
step_room room_of(int64_t k, double *work);
contact_grid grid_of(int64_t k, double *work);
size_t memory_bytes(int64_t k);
size_t plant_bytes(int64_t k);

/* Put bars at their fractions of a route; docs/model.md (41). */
void discretise(
    int64_t k, const double edge[], int64_t p, const double length[], const double angle[],
    contact_grid grid);
int64_t add_bends(
    int64_t p, const double length[], const double angle[], int64_t m, const double bends[][3],
    double *pieces[2], double *spare[2]);
double total(int64_t n, const double values[]);
double row_dot(int64_t n, const double a[], const double b[]);
double quadratic_form(int64_t n, const double a[], const double *matrix, int64_t width);

/* Stretch of a taut bar [m] and its slope [m/N]; docs/model.md (50). */
double stretch_of(const bar_laws *laws, int64_t j, double tension, double *slope);
/* Table of a law, or NULL where there is none; and its value and slope, constant beyond its ends; (185). */
const double *table_of(const double *tables, int64_t which);
double table_value(const double table[], double x, double *slope);
/* What the tension at a contact makes of the friction there [1], and its slope [1/N]; docs/model.md (52). */
double load_factor(const bar_laws *laws, double load, double *slope);
/* What sliding so far in a step makes of friction [1], and its slope [1/m]; docs/model.md (52), (185).

   The table is taken at the speed `at`, which grows by `grows` for each metre [1/s]. */
double speed_factor(const bar_laws *laws, double slid, double span, double at, double grows, double *slope);
/* The speed that friction follows after a step, with the sign of the step's; docs/model.md (185). */
double followed_speed(const bar_laws *laws, double before, double speed, double span);
speed_search search_speeds(const bar_laws *laws);
/* Compare the speeds [k] of one tendon in a pass with those that friction follows after it. */
void compare_speeds(speed_search *search, int64_t k, const double taken[], const double followed[]);
/* End a pass in which all were compared: the share is the secant's; returns whether another pass is needed. */
int go_on(speed_search *search);
void renew_speeds(const speed_search *search, int64_t k, double taken[], const double followed[]);
/* Friction for each metre by which a contact gives way before it slides: as stiff as makes it slide where it is
   said [N/m]; its friction before the step is that from which it gives way; docs/model.md (279). */
double bristle_of(const bar_laws *laws, int64_t i);
/* What the path slid so far, time and position make of it [1]; docs/model.md (52), (185). */
double wear_factor(const bar_laws *laws, double travel);
/* Set the factor of a step that ends at a time [s] since the run began. */
void set_step_factor(bar_laws *laws, const bar_memory *memory, double time);
/* Cones of a plant whose contacts have these curve angles [k]. */
void set_contacts(int64_t k, double *plant, const double angle[]);
/* Contacts and saved paths of a plant on a route. */
void put_on_route(
    int64_t k, const double edge[], double *plant, int64_t p, const double length[], const double angle[],
    int64_t m, const double bends[][3], double *pieces, double *work);

/* The plant of one member of an ensemble: that of the middle, and straight lines over what is followed, `width`
   apart; docs/model.md (201). */
void set_plant(
    int64_t k, int64_t d, const double *middle, const double *slope, int64_t width, const double shift[],
    double *own);
/* The cones of its contacts, exact over friction. */
void set_cones_of(int64_t k, double *own);

/* Bring the chain into equilibrium; returns the solves spent, and the residual [N]. */
int64_t equilibrium(bar_chain *chain, int hanging, int64_t from_before, int64_t from_guess, double *residual);
/* Set slip and tight as they would be on a fixed route; exact there, for force and for position. */
void guess_fixed_route(bar_chain *chain, int hanging);
/* Proximal tensions between which a dead weight stays where it is [N]; docs/model.md (47). */
void range_of_drive(
    int64_t k, double weight, const double low[], const double high[], const double force[], double range[2]);

creep_shares creep_after(double time_constants);
/* The same of each element of a tendon; nothing where none creeps. */
void set_shares(const bar_laws *laws, double span, creep_shares shares[]);
/* Stretch that each bar would have if no contact moved [m]. */
void set_given(
    const bar_laws *laws, const bar_memory *memory, double warmth, const creep_shares shares[], double target,
    const double rest[], double given[]);
/* Write what a step did into the memory; returns whether it is finite. */
int
keep(const bar_laws *laws, bar_memory *memory, const bar_chain *c, const creep_shares shares[], double span);

/* Start the cone of a room from the laws. */
void begin_room(const bar_laws *laws, step_room *room);
/* Balance a room behind a memory at a new drive; returns how much the last pass changed any tension [N]. */
double balance_room(
    const bar_laws *laws, const bar_memory *memory, step_room *room, const creep_shares shares[], int by_force,
    double target, double weight, double warmth, double span, const double rest[], int64_t *solves);
/* The same, written into the memory. */
double balance(
    const bar_laws *laws, bar_memory *memory, step_room *room, int by_force, double target, double weight,
    double warmth, double span, const double rest[], int64_t *solves);
/* The same in one sweep on a fixed route; returns how far the drive is off [m]. */
double
sweep(const bar_laws *laws, bar_memory *memory, step_room *room, int by_force, double target, double span);

/* Take one sample in as many steps as it has; returns whether there is an equilibrium. */
int take_sample(
    bar_laws *laws, bar_memory *memory, step_room *room, int by_force, double duration, double drive,
    double warmth, int64_t parts);
/* Read T_in, T_out [N], x_in, x_out [m], slip of the first and last contact; returns whether all are finite. */
int record(const bar_laws *laws, const bar_memory *memory, int by_force, double out[6]);
/* Go from one kind of drive to the other: the tendon's end and the drive stay where they are; (59). */
void switch_drive(const bar_memory *memory, double position, int by_force);
