"""Break the core in small ways, one at a time, and list those that the tests named beside each do not detect.

    python -m tests.mutants            # all; a table, the share that is caught, exit status 1 below 95 %
    python -m tests.mutants gradient   # those whose file, text or tests hold one of the words

Here are the mutants; `tests/mutation.py` runs them.
"""

import sys
from dataclasses import dataclass

STATE = "tests/tendon/test_state.py"
PROFILE = "tests/tendon/test_capstan.py"
CLOSED = "tests/tendon/test_transmission.py"
REMEDY = "tests/tendon/test_design.py"
WITH_EFFECTS = "tests/effects/test_with_effects.py"
INVERSE = "tests/tendon/test_command.py -k fixed_route"
COMMANDS = "tests/effects/test_commands.py -k displacement_of_the_load"
ARCS = "tests/route/test_arcs.py -k 'partition or parallel or given'"
DIRECTIONS = "tests/route/test_directions.py -k 'refused or flipped'"
TABLES = "tests/io/test_tables_of_points.py"
FIBRE = "tests/core/test_fibre.py"
CORE_ARCS = "tests/core/test_arcs.py"
DRIVE = "tests/identify/test_parts.py -k"
LEVELS = "tests/identify/test_turn_levels.py"


@dataclass(frozen=True, slots=True)
class Mutant:
    """One small fault, and the tests that are to detect it."""

    file: str
    old: str
    new: str
    tests: str

    @property
    def text(self) -> str:
        """The change in one line."""
        return f"{self.file.removeprefix('tssgeom/')}: {self.old.strip()} → {self.new.strip()}"


MUTANTS = (
    # the capstan law along the tendon
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "drive - way * friction * meeting",
        "drive + way * friction * meeting",
        PROFILE,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "change > 0.0 ? 1.0 : -1.0",
        "change > 0.0 ? -1.0 : 1.0",
        PROFILE,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "* before / (before - here)",
        "* before / (before + here)",
        PROFILE,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "angle[c - 1] + before / friction",
        "angle[c - 1] + before",
        PROFILE,
    ),
    Mutant("tssgeom/tendon/capstan.py", "np.exp(np.interp(phi,", "np.exp(-np.interp(phi,", PROFILE),
    # closed forms and their standard errors
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "(mean_decay(x) - exp(-x)) / x",
        "(mean_decay(x) + exp(-x)) / x",
        CLOSED,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "later += length[i] * means[p + i]",
        "later += length[i] * means[2 * p + i]",
        CLOSED,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "gradient[i] = compliance * (means[i] - pretension)",
        "gradient[i] = compliance * means[i]",
        CLOSED,
    ),
    Mutant(
        "tssgeom/core/tendon_route.c",
        "a[i] * row_dot(n, matrix + i * width, a)",
        "row_dot(n, matrix + i * width, a)",
        CLOSED,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "sqrt(most(0.0, angle_variance))",
        "most(0.0, angle_variance)",
        CLOSED,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "covariance + (p + i) * 2 * p + p",
        "covariance + i * 2 * p",
        CLOSED,
    ),
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "log_tension_out + way * (friction * turned)",
        "log_tension_out - way * (friction * turned)",
        CLOSED,
    ),
    Mutant(
        "tssgeom/tendon/capstan.py",
        "(tension_out - rig.tendon.pretension_N) / stiffness",
        "tension_out / stiffness",
        "tests/tendon/test_load.py",
    ),
    # histories, the remedy of Theorem 3, calibration, inverse
    Mutant(
        "tssgeom/core/tendon_corners.c",
        "compliance * length[i] * (means[i] - pretension)",
        "compliance * length[i] * means[i]",
        CLOSED,
    ),
    Mutant(
        "tssgeom/tendon/history.py",
        "len(length) + np.arange(at, at + k)",
        "k + np.arange(at, at + k)",
        "tests/tendon/test_history.py",
    ),
    Mutant(
        "tssgeom/tendon/design.py",
        "release_reaches_below=out / grown",
        "release_reaches_below=out * grown",
        REMEDY,
    ),
    Mutant(
        "tssgeom/tendon/design.py",
        "rig.tendon.pretension_N * grown",
        "rig.tendon.pretension_N / grown",
        REMEDY,
    ),
    Mutant(
        "tssgeom/tendon/design.py",
        "Cycle(cycle.tension_in * grown,",
        "Cycle(cycle.tension_in / grown,",
        REMEDY,
    ),
    Mutant("tssgeom/tendon/design.py", "self.angle / self.kappa", "self.angle * self.kappa", REMEDY),
    Mutant(
        "tssgeom/tendon/command.py",
        "sign = 1 if error < 0.0 else -1",
        "sign = -1 if error < 0.0 else 1",
        INVERSE,
    ),
    Mutant(
        "tssgeom/tendon/command.py",
        "rest_tension(rig) + stiffness * (displacement_out or 0.0)",
        "stiffness * (displacement_out or 0.0)",
        COMMANDS,
    ),
    # a tendon of bars
    Mutant(
        "tssgeom/tendon/bars/bar_state.py",
        "displacement_in=elongation + moved",
        "displacement_in=elongation - moved",
        STATE,
    ),
    Mutant(
        "tssgeom/core/tendon_equilibrium.c",
        "right = -c->slip[i] * c->force[i]",
        "right = c->slip[i] * c->force[i]",
        "tests/tendon/test_bars_ends.py -k each_number_of_the_cone",
    ),
    # effects and sensors
    Mutant(
        "tssgeom/core/tendon_effects.c",
        "base * (1.0 - asymmetry)",
        "base * (1.0 + asymmetry)",
        "tests/effects/test_against_lumped.py -k 'asymmetric and tension_in_N'",
    ),
    Mutant(
        "tssgeom/core/tendon_effects.c",
        "exp(-pulling - fitting)",
        "exp(pulling - fitting)",
        "tests/effects/test_run_model.py -k the_base_is",
    ),
    Mutant(
        "tssgeom/tendon/bars/sensors.py",
        "(true - setup.tension_in_offset_N) / setup.tension_in_gain",
        "(true + setup.tension_in_offset_N) / setup.tension_in_gain",
        f"{WITH_EFFECTS} tests/effects/test_ties.py -k 'errs or G1 or gain'",
    ),
    Mutant(
        "tssgeom/tendon/bars/sensors.py",
        '"elongation_m": out[2] - out[3]',
        '"elongation_m": out[2] + out[3]',
        "tests/effects/test_run_model.py -k the_base_is",
    ),
    Mutant(
        "tssgeom/tendon/sensor_errors.py",
        "(reading - setup.tension_in_offset_N) / setup.tension_in_gain",
        "(reading + setup.tension_in_offset_N) / setup.tension_in_gain",
        f"{WITH_EFFECTS} -k 'simulated and tension_in_offset'",
    ),
    # the route
    Mutant("tssgeom/core/pieces.c", "first[c] -= turned * middle", "first[c] += turned * middle", ARCS),
    Mutant("tssgeom/core/pieces.c", "if (so_far[k] + penalty < best)", "if (so_far[k] < best)", ARCS),
    Mutant(
        "tssgeom/route/pieces.py",
        "self.covariance[k:, k:].sum()",
        "self.covariance[:k, :k].sum()",
        f"tests/tendon/test_history.py {CLOSED} {STATE}",
    ),
    Mutant(
        "tssgeom/route/directions.py",
        "cosine[sensed].mean() < 0.0",
        "cosine[sensed].mean() > 0.0",
        DIRECTIONS,
    ),
    Mutant(
        "tssgeom/rig.py",
        "return None if self.noise_mm is None else 1e-3 * self.noise_mm",
        "return self.noise_mm",
        "tests/test_rig.py",
    ),
    # the chain of arcs
    Mutant(
        "tssgeom/core/arcs_equations.c",
        "theta[i] = d0 * frame[j][2][i] - d1 * frame[j][1][i]",
        "theta[i] = d0 * frame[j][2][i] + d1 * frame[j][1][i]",
        CORE_ARCS,
    ),
    Mutant("tssgeom/core/arcs_moments.c", "sign = part == 2 ? 1.0 : -1.0", "sign = 1.0", CORE_ARCS),
    Mutant("tssgeom/core/arcs.h", "f.b = (1 - cosine) / q", "f.b = (1 + cosine) / q", CORE_ARCS),
    Mutant("tssgeom/core/arcs_dense.c", "value -= lower[a * m + c] * x[c]", "value -= 0.0", CORE_ARCS),
    Mutant(
        "tssgeom/core/arcs_fit.c", "(unit[c] * along - axis[c])", "(unit[c] * along + axis[c])", CORE_ARCS
    ),
    Mutant(
        "tssgeom/core/arcs_equations.c",
        "slide[a] = -dot3(tangent, moved)",
        "slide[a] = dot3(tangent, moved)",
        CORE_ARCS,
    ),
    Mutant(
        "tssgeom/core/arcs_summary.c", "hidden[j] * squared(length[j])", "hidden[j] * length[j]", CORE_ARCS
    ),
    Mutant("tssgeom/core/fibre.c", "on - goes_on(of, start, j + 1)", "on", FIBRE),
    Mutant("tssgeom/core/fibre.c", "sum = load(step->added[a]);", "sum = all(0.0);", FIBRE),
    Mutant(
        "tssgeom/core/fibre.c",
        "at->mean[e][b] += gain[b][a] * off[a]",
        "at->mean[e][b] -= gain[b][a] * off[a]",
        FIBRE,
    ),
    Mutant("tssgeom/core/fibre.c", "value = next, at = node[a]", "value = next", FIBRE),
    # what drives, and what is read
    Mutant(
        "tssgeom/statistics.py",
        "return robust_sd(off)",
        "return float(np.median(off))",
        f"{DRIVE} sine",
    ),
    Mutant("tssgeom/statistics.py", "_THROUGH = (3, 5, 7)", "_THROUGH = (3,)", DRIVE),
    Mutant(
        "tssgeom/identify/turn_levels.py",
        "coefficients[:, 1] * coefficients[:, 2] >= 0.0",
        "coefficients[:, 1] * coefficients[:, 2] <= 0.0",
        LEVELS,
    ),
    Mutant(
        "tssgeom/identify/drive.py",
        "fitted = fitted_turn(when, drive, int(turn), between, noise)",
        "fitted = None",
        f"{DRIVE} sine",
    ),
    Mutant(
        "tssgeom/identify/readings.py",
        "over = np.abs(out) >= sensor.full_scale",
        "over = np.abs(out) > 2.0 * sensor.full_scale",
        f"{DRIVE} round_turn",
    ),
    # units and order at the boundary
    Mutant("tssgeom/io/formats/recording.py", '"mm": 1000.0', '"mm": 100.0', TABLES),
    Mutant(
        "tssgeom/io/formats/columns.py",
        '"elongation_mm": ("elongation", 1000.0)',
        '"elongation_mm": ("elongation", 1.0)',
        f"{TABLES} tests/io/test_npz.py tests/io/test_runs.py",
    ),
    Mutant(
        "tssgeom/io/formats/slicer.py",
        '"RAS": (-1.0, -1.0, 1.0)',
        '"RAS": (-1.0, 1.0, 1.0)',
        "tests/io/test_slicer.py",
    ),
    Mutant(
        "tssgeom/io/formats/recording.py",
        "latest < item.time < math.inf",
        "latest <= item.time < math.inf",
        f"{TABLES} tests/io/test_json_lines.py",
    ),
    Mutant(
        "tssgeom/io/formats/longform.py", "float(known[0]) / per_unit", "float(known[0]) * per_unit", TABLES
    ),
)


if __name__ == "__main__":
    from tests.mutation import main

    sys.exit(main())
