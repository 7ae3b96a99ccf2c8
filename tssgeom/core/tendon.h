/* Tension and elongation of the tendon: corner lists on a fixed route, bars elsewhere and with effects.

   A route is p pieces of constant curvature: length [m], angle [rad], covariance of all lengths followed by
   all angles. A tendon of bars has k contacts with the sheath and k + 1 bars: bar 0 drives the proximal end,
   the last one is what the distal end pulls against; `edge` [k] is where the others are cut, as fractions of
   the length from 0 to 1. A `plant` is the rows of LAW, the numbers of PLANT and the tables of CURVE, a `memory`
   the rows of MEMORY followed by the numbers of HELD (constants_tendon_rows.py); each row is k + 1 long. */
#pragma once
#include "core.h"

/* What a step returns where it does not return a status. */
enum { STEPPED = 0, RUNS_AWAY = 3, STUCK_FAST = 4 };

/** Return whether two sensed routes differ by no more than their errors; docs/model.md (80). */
ENTRY int64_t tss_is_unmoved(
    int64_t p, const double length[p], const double angle[p], const double covariance[2 * p][2 * p],
    int64_t q, const double length_now[q], const double angle_now[q],
    const double covariance_now[2 * q][2 * q]);

/** Return what a route makes of bars and contacts; docs/model.md (41).

`bars` [2, k - 1] is the length [m] of each bar in the sheath and the mean φ over it [rad]; `contacts` [2, k]
is the curve angle of each contact [rad] and the length of sheath that belongs to it [m]. */
ENTRY void tss_discretise(
    int64_t k, const double edge[k], int64_t p, const double length[p], const double angle[p],
    OUT double bars[2][k - 1], OUT double contacts[2][k]);

/** Return the number of pieces of a route with hidden bends added, and the pieces; docs/model.md (60).

`bends` [m, 3] holds middle [m], angle [rad] and width [m] of each; `pieces` is lengths, then angles. */
ENTRY int64_t tss_add_bends(
    int64_t p, const double length[p], const double angle[p], int64_t m, const double bends[m][3],
    OUT double pieces[2][p + 2 * m], WORK double work[2][p + 2 * m]);

/** Return the corner list after a step to the tension exp(`drive`), a play operator; docs/model.md (3), (4).

The list `angle` [rad], `log_tension` [ln N] becomes max(u, ln T − μφ) on a pull and min(u, ln T + μφ) on a
release. Returns how many of `corners` (φ, ln T) there are, below 0 on a release, 0 where nothing moves. */
ENTRY int64_t tss_step_corners(
    int64_t c, const double angle[c], const double log_tension[c], double drive, double friction,
    OUT double corners[2][c + 1]);

/** Return what a corner list [c] means on a route; docs/model.md (5)-(14).

`way` is the direction index ζ. Returns `ends`: T_out and its standard error [N], elongation and its standard
error [m], width of the dead zone [N], curve angle of the slip front [rad], d ln T_out over any angle [1/rad];
and the derivatives of the elongation by each length, then by each angle [1], [m/rad]. */
ENTRY void tss_transmit_corners(
    int64_t c, const double angle[c], const double log_tension[c], int64_t p, const double length[p],
    const double piece_angle[p], const double covariance[2 * p][2 * p], double compliance, double pretension,
    double friction, int64_t way, OUT double ends[7], OUT double gradient[2 * p], WORK double means[3][p]);

/** Return what bars without effects mean on a route, as `transmit_corners`; docs/model.md (49). */
ENTRY void tss_transmit_bars(
    int64_t k, const double edge[k], const double memory[9 * (k + 1) + 7], int64_t p, const double length[p],
    const double piece_angle[p], const double covariance[2 * p][2 * p], double compliance, double pretension,
    double friction, int64_t way, OUT double ends[7], WORK double means[5][p], WORK double work[8][k + 1]);

/** Return how many corners (φ, ln T) go through the means of the bars and both ends, and the corners. */
ENTRY int64_t tss_corners_of_bars(
    int64_t k, const double edge[k], const double tension[k + 1], int64_t p, const double length[p],
    const double piece_angle[p], OUT double corners[2][k + 1], WORK double work[6][k + 1]);

/** Return the means of exp(−xτ) and of τ·exp(−xτ) over 0 ≤ τ ≤ 1 [1]; docs/model.md (8), (12). */
ENTRY void tss_mean_decays(double x, OUT double means[2]);

/** Return the equilibrium of bars between contacts that may stick or slide; docs/model.md (40)-(47).

`trial` [N] and `stiffness` [N/m] of each bar; `cone` [6, k] is low, high [1], force [N] and drag [N/m] of
each contact, then what it resists before it slides [N/m], inf where it does not give, and its friction before
the step [N]; (279). `shift` [m] is the movement of a rigid proximal end; `slip` [k] a guess. `from_before`,
`from_guess` are Newton iterations. Returns the solves spent, the tensions [N], movement [m] and slip of each
contact, and the residual [N]. */
ENTRY int64_t tss_equilibrium(
    int64_t k, const double trial[k + 1], const double stiffness[k + 1], const double cone[6][k],
    int64_t rigid_in, int64_t rigid_out, double shift, int64_t hanging, const double slip[k],
    int64_t from_before, int64_t from_guess, OUT double tension[k + 1], OUT double contacts[2][k],
    OUT double residual[1], WORK double work[20][k + 1]);

/** Step bars of the base model on the route `now`, or `before` where `compare` and it has not moved.

`length_before` [m] is below 0 where a longer route does not stretch the tendon; the load has a `stiffness`
[N/m]. Returns STEPPED, NO_EQUILIBRIUM, RUNS_AWAY (of a dead weight) or
STUCK_FAST (friction beyond `most_friction` = μΦ), the new memory, and `ends`: position of drive and load,
elongation [m], solves, length of the route [m], whether it moved, slip of the first contact, and the range of
tensions that holds a dead weight [N] or else μΦ. `drive` is a tension [N] or, unless `by_force`, a position
[m]; `position` is where the drive was [m]. */
ENTRY int64_t tss_step_bars(
    int64_t k, const double edge[k], const double memory[9 * (k + 1) + 7], int64_t p,
    const double before_length[p], const double before_angle[p], const double before_covariance[2 * p][2 * p],
    int64_t q, const double now_length[q], const double now_angle[q],
    const double now_covariance[2 * q][2 * q], int64_t compare, double friction, double compliance,
    double pretension, double stiffness, double most_friction, double length_before,
    double drive, int64_t by_force, double position, OUT double after[9 * (k + 1) + 7], OUT double ends[9],
    WORK double plant[17 * (k + 1) + 430], WORK double work[48][k + 1]);

/** Return a plant with its contacts and saved paths as a route makes them; docs/model.md (52)-(60). */
ENTRY void tss_plant_on_route(
    int64_t k, const double edge[k], const double plant[17 * (k + 1) + 430], int64_t p, const double length[p],
    const double angle[p], int64_t m, const double bends[m][3], OUT double after[17 * (k + 1) + 430],
    WORK double pieces[5][p + 2 * m], WORK double work[4][k]);

/** Take the tendon through the samples of a run with every effect; docs/model.md (50)-(65).

`spans` [s] is the time since the sample before, `drive` [N] or [m], `warmth` [K] since the run began, `parts`
the steps of each sample. Returns the number of samples done, fewer where one failed; the memory after them;
`out`: T_in, T_out [N], x_in, x_out [m], what the first and the last contact did; and, where `rows` is s and
not 0, the tension of each bar [N]. */
ENTRY int64_t tss_march(
    int64_t k, const double plant[17 * (k + 1) + 430], const double memory[9 * (k + 1) + 7], int64_t by_force,
    int64_t s, const double spans[s], const double drive[s], const double warmth[s], const int64_t parts[s],
    int64_t rows, OUT double after[9 * (k + 1) + 7], OUT double out[6][s], OUT double profile[rows][k + 1],
    WORK double work[20][k + 1]);

/** Step a tendon with effects on the route `now`, or `before` where `compare` and it has not moved.

`was_by_force` and `position` [m] are those of the last step, `front` its result; `warmth` [K] is NaN where it
is as before. Returns the number of steps done, 0 where there is no equilibrium; the memory and plant after
it; and `ends`: T_in, T_out [N], x_in, x_out [m], slip of the first and last contact, drive before [N] or [m],
contacts that slid from the proximal end on, whether the route moved, and μΦ, beyond `most_friction` of which
nothing is stepped. */
ENTRY int64_t tss_step_with_effects(
    int64_t k, const double edge[k], const double plant[17 * (k + 1) + 430],
    const double memory[9 * (k + 1) + 7], int64_t p, const double before_length[p],
    const double before_angle[p], const double before_covariance[2 * p][2 * p], int64_t q,
    const double now_length[q], const double now_angle[q], const double now_covariance[2 * q][2 * q],
    int64_t m, const double bends[m][3], int64_t compare, double friction, double most_friction, double drive,
    int64_t by_force, int64_t was_by_force, double position, int64_t front, double span, double warmth,
    OUT double after[9 * (k + 1) + 7], OUT double plant_after[17 * (k + 1) + 430], OUT double ends[10],
    WORK double pieces[5][q + 2 * m], WORK double work[24][k + 1]);

/** Return both ends of a tendon with effects; docs/model.md (121)-(123).

`way` is the direction index ζ, `front` the contacts that slid last. Returns standard error of the elongation
[m] and of T_out [N], width of the dead zone [N], whether the load responded, angle of the slip front [rad]. */
ENTRY void tss_transmit_with_effects(
    int64_t k, const double edge[k], const double plant[17 * (k + 1) + 430],
    const double memory[9 * (k + 1) + 7], int64_t p, const double length[p], const double angle[p],
    const double covariance[2 * p][2 * p], int64_t way, int64_t front, OUT double ends[5],
    WORK double gradient[3][p], WORK double work[4][k]);

/** Return the proximal tension from which on a slow pull (+1) or release (−1) moves the load [N].

`tension_out` is the distal tension then [N]; docs/model.md (122). */
ENTRY double tss_answering(
    int64_t k, const double plant[17 * (k + 1) + 430], const double memory[9 * (k + 1) + 7],
    double tension_out, int64_t way);

/** Return the table of a curve through n ≤ 12 points; docs/model.md (185).

Its slopes are weighted harmonic means of those beside, so that it does not overshoot: Fritsch and Butland, A
method for constructing local monotone piecewise cubic interpolants, SIAM J. Sci. Stat. Comput. 5 (1984). */
ENTRY status tss_table_of(int64_t n, const double x[n], const double y[n], OUT double table[37]);

/** Return the values of a table of CURVE, constant beyond its ends; docs/model.md (185). */
ENTRY void tss_tabulated(int64_t s, const double table[37], const double x[s], OUT double values[s]);

/** Pass samples, straight between, through a lag [s] that stands at `given`, `read`; docs/model.md (62). */
ENTRY void tss_lagged(
    int64_t s, const double values[s], const double spans[s], double lag, double given, double read,
    OUT double out[s]);

/** Take n tendons on one mechanism of m ≤ 4 coordinates through the samples of a run; docs/model.md (171)-(175).

`proximal`, `distal` [n, m] are how far the drive and the load of each tendon move with each coordinate, for 1
of it [m]; `stiffness` [m], `holds` [m, 40] (greatest force, angle where the coordinate is 0, force
over its cube, and a table of force over it), `friction` [m] (of one coordinate alone) and `at_rest` [m] are the forces that hold the coordinates;
`start` [m] is where they are. `drive` [s, n] is where each drive is besides [m], or `by_force` its tension [N],
`end` [s, n] where each load is besides [m], `load` [s, m] what acts against each coordinate. A memory's row `rest` is added to that of its plant. Returns the number of samples
done, the memories after them, the coordinates, T_in, T_out [N], x_in, x_out [m] of each tendon, and, where
`rows` is s and not 0, the tension of each bar of each tendon [N]. */
ENTRY int64_t tss_march_machine(
    int64_t n, int64_t k, const double plant[n][17 * (k + 1) + 430], const double memory[n][9 * (k + 1) + 7],
    int64_t m, const double proximal[n][m], const double distal[n][m], const double stiffness[m],
    const double holds[m][40], const double friction[m], const double at_rest[m], const double start[m],
    int64_t by_force, int64_t s,
    const double spans[s], const double drive[s][n], const double end[s][n], const double load[s][m],
    const double warmth[s], int64_t rows, OUT double after[n][9 * (k + 1) + 7], OUT double coordinate[s][m],
    OUT double ends[s][4 * n], OUT double profile[rows][n * (k + 1)], WORK double trial[n][9 * (k + 1) + 7], WORK double work[21 + n][k + 1]);

/** Take a machine through the samples of a run, and c − 1 others beside it that differ little; docs/model.md (298).

The first is marched as by `march_machine`, and the contacts of the others do what its contacts do: what they add to it
is exact to first order in their differences, as derivatives need. All else is as there, with a row for each machine.
Returns the number of samples done by the first; the memories; the coordinates; and T_in, T_out [N], x_in, x_out [m]
of each tendon. */
ENTRY int64_t tss_march_beside(
    int64_t c, int64_t n, int64_t k, const double plant[c][n * (17 * (k + 1) + 430)],
    const double memory[c][n * (9 * (k + 1) + 7)], int64_t m, const double proximal[c][n * m],
    const double distal[c][n * m], const double stiffness[c][m], const double holds[c][40 * m],
    const double friction[c], const double at_rest[c][m], const double start[c][m], int64_t by_force, int64_t s,
    const double spans[s], const double drive[c][s * n], const double end[c][s * n],
    const double load[c][s * m], const double warmth[s], OUT double after[c][n * (9 * (k + 1) + 7)],
    OUT double coordinate[c][s * m], OUT double ends[c][s * 4 * n], WORK double trial[n][9 * (k + 1) + 7],
    WORK double room[c * n][96], WORK double lines[n][17 * (k + 1)], WORK double change[2 * n][k + 1],
    WORK double work[24 + n][k + 1]);

/** Step n tendons whose plants are straight lines over d numbers; docs/model.md (201), (202).

`slope` [d] is what 1 of each number adds to `plant`, `sensor_slope` [d] what it adds to gain and zero of T_in and of
T_out and to the crosstalk, which are `sensors`; `shift` [w, d] how far the numbers of each of w tendons are from those of
the plant. Tendon j begins as tendon `row[j]` of the w. Where the route has `moved` from that of the plant it is `length`,
`angle` of its pieces times `gain` [w] of each. `position` [w] is where each drive was [m], `drive` [n] where it goes, [N]
or [m]; `warmth` [K]. Returns how many were stepped, fewer where one finds no equilibrium; the memories; T_in, T_out [N],
x_in, x_out [m] of each; and what is read of T_in and T_out [N], and of the elongation [m]. */
ENTRY int64_t tss_step_ensemble(
    int64_t w, int64_t n, int64_t k, const double edge[k], int64_t d, const double plant[17 * (k + 1) + 430],
    const double slope[d][17 * (k + 1) + 430], const double sensors[5], const double sensor_slope[d][5],
    const double shift[w][d], const double memory[w][9 * (k + 1) + 7], const int64_t row[n], int64_t p,
    const double length[p], const double angle[p], const double gain[w], int64_t m, const double bends[m][3],
    int64_t moved, int64_t by_force, int64_t was_by_force, const double position[w], const double drive[n],
    double span, double warmth, OUT double after[n][9 * (k + 1) + 7], OUT double ends[n][4],
    OUT double read[n][3], WORK double own[17 * (k + 1) + 430], WORK double pieces[6][p + 2 * m],
    WORK double work[24][k + 1]);

/** Step c machines of n tendons, whose plants are straight lines over d numbers; docs/model.md (201), (175).

`slope` [d] is what 1 of each number adds to the plants of all tendons, `shift` [c, d] how far the numbers of each
machine are from those of the plants. Machine j begins with the memory in `row[j]` of w. All else is as for `march_machine`, for one sample and with a row for each
machine. Returns how many were stepped, fewer where one finds no equilibrium; the memories of the tendons; the
coordinates; and T_in, T_out [N], x_in, x_out [m] of each tendon. */
ENTRY int64_t tss_step_machines(
    int64_t w, int64_t c, int64_t n, int64_t k, int64_t d, const double plant[n][17 * (k + 1) + 430],
    const double slope[d][n * (17 * (k + 1) + 430)], const double shift[c][d],
    const double memory[w][n * (9 * (k + 1) + 7)], const int64_t row[c], int64_t m, const double proximal[c][n * m],
    const double distal[c][n * m], const double stiffness[c][m], const double holds[c][40 * m],
    const double friction[c], const double at_rest[c][m], const double start[c][m], int64_t by_force,
    const double drive[c][n], const double end[c][n], const double load[c][m], double span, double warmth,
    OUT double after[c][n * (9 * (k + 1) + 7)], OUT double coordinate[c][m], OUT double ends[c][4 * n],
    WORK double own[n][17 * (k + 1) + 430], WORK double work[21 + n][k + 1]);

/** Shift n members by c readings, one after the other, as an ensemble square-root filter; docs/model.md (203).

`numbers` [n, d], the memories `kept` and `now` [n] of t tendons, `predicted` [n, c] and `others` [n, e] of each member are
changed, and the numbers then held within their bounds. A reading of NaN is none, and one further off than `most_off`
standard deviations is an outlier. Returns how many were used; the innovation of each and its variance; mean and
covariance of the numbers; and mean and variance of what is expected of each channel, and of the others. */
ENTRY int64_t tss_assimilate(
    int64_t n, int64_t t, int64_t k, int64_t d, int64_t c, int64_t e, INOUT double numbers[n][d],
    INOUT double kept[n][t * (9 * (k + 1) + 7)], INOUT double now[n][t * (9 * (k + 1) + 7)],
    INOUT double predicted[n][c], INOUT double others[n][e], const double reading[c], const double variance[c],
    double most_off, const double lower[d], const double upper[d], OUT double innovation[c][2],
    OUT double values[d], OUT double covariance[d][d], OUT double expected[c][2], OUT double moments[e][2],
    WORK double work[2 * t * (9 * (k + 1) + 7) + d + c + e]);
