"""What every effect has to keep: no change at zero, else in its channels, smoothness, and whole chunks."""

import msgspec
import numpy as np
import pytest

from tests.effects.rig import ARCS, FORCE, POSITION, RIG, RUNS, modelled
from tssgeom.effects import KINDS, Library, with_size
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.tendon.bars.model import CHANNELS, begin, carry_on, predict, prepare

KIND = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
DRIVE = pytest.mark.parametrize("drive", [FORCE, POSITION])
OBSERVED = {"N": 1e-3, "m": 1e-7}  # a tenth of what a good cell or encoder resolves
UNOBSERVED = {"N": 1e-8, "m": 1e-11}  # what an equilibrium leaves over: 1e-10 of 15 N, and that over 1e3 N/m


def signature(drive, effect):
    observed, base = modelled(drive, effect), modelled(drive)
    return {c: np.abs(observed[c] - base[c]).max() for c in CHANNELS if c != drive}


@DRIVE
@KIND
def test_an_effect_of_no_size_leaves_every_digit(kind, drive):
    base, silent = modelled(drive), modelled(drive, with_size(kind, 0.0))
    for channel in CHANNELS:
        assert np.array_equal(base[channel], silent[channel])


@DRIVE
@KIND
def test_an_effect_shows_in_its_channels_and_in_no_other(kind, drive):
    reported = kind.by_force if drive == FORCE else kind.by_position
    sizes = signature(drive, with_size(kind))
    assert any(sizes[c] > OBSERVED[c[-1]] for c in reported)
    for channel, size in sizes.items():
        if channel not in reported:
            assert size < UNOBSERVED[channel[-1]]


@KIND
def test_the_derivative_by_an_effect_does_not_depend_on_the_step(kind):
    # Steps of 2 % and 0.5 % of the typical size. The noise of the solver would give 1e-6; what differs is a
    # sample or two in which a front reaches the far end or a turn with the one step and not with the other.
    def slope(step):
        up, down = (modelled(FORCE, with_size(kind, 1.0 + sign * step)) for sign in (1, -1))
        return {c: (up[c] - down[c]) / (2.0 * step) for c in CHANNELS}

    coarse, fine = slope(0.02), slope(0.005)
    for channel in kind.by_force:
        size = np.sqrt(np.mean(fine[channel] ** 2))
        if size > 10.0 * UNOBSERVED[channel[-1]]:
            assert np.sqrt(np.mean((coarse[channel] - fine[channel]) ** 2)) < 0.05 * size


@DRIVE
@KIND
def test_a_run_in_chunks_gives_the_digits_of_the_whole(kind, drive):
    run = RUNS[drive]
    model = prepare(run, ARCS, RIG, [with_size(kind)])
    whole = carry_on(model, begin(model), run)[0].channels
    state, parts = begin(model), []
    for start, stop in ((0, 40), (40, 41), (41, 42), (42, 121)):
        trace, state = carry_on(model, state, {key: column[start:stop] for key, column in run.items()})
        parts.append(trace.channels)
    for channel in CHANNELS:
        assert np.array_equal(np.concatenate([part[channel] for part in parts]), whole[channel])


@KIND
def test_an_effect_states_what_its_detection_needs(kind):
    assert kind.__doc__
    assert "docs/model.md (" in kind.__doc__
    assert "Source: " in kind.__doc__
    assert any(reported.switch for reported in kind.parameters.values())
    for key, reported in kind.parameters.items():
        assert reported.lower <= reported.typical <= reported.upper
        assert reported.prior_sd > 0.0
        assert key in kind.__struct_fields__
        assert not reported.switch or reported.lower <= 0.0 <= reported.upper
    for tie in kind.ties:
        assert tie.gauge
        assert tie.where
        assert tie.breaks
        for partner in tie.partners:
            assert partner in KINDS or partner.startswith(("rig.", "zero of"))


@KIND
def test_a_value_out_of_bounds_is_refused_with_effect_and_unit(kind):
    for key, reported in kind.parameters.items():
        for value in (reported.upper * 2.0 + 1.0, float("nan")):
            with pytest.raises(SettingsError, match=rf"effects\..*{key} is .*: give "):
                msgspec.structs.replace(with_size(kind), **{key: value})


def test_what_the_rig_names_acts_as_what_is_handed_over():
    effects = tuple(with_size(kind) for kind in KINDS.values())
    rig = msgspec.structs.replace(RIG, effects=effects)
    named, handed = predict(RUNS[FORCE], ARCS, rig), modelled(FORCE, *effects)
    for channel in CHANNELS:
        assert np.array_equal(named[channel], handed[channel])


def test_all_effects_come_back_from_what_a_file_holds():
    rig = Rig(effects=tuple(with_size(kind) for kind in KINDS.values()))
    assert msgspec.convert(msgspec.to_builtins(rig), type=Rig) == rig
    assert {type(e) for e in rig.effects} == set(Library.__args__)


def test_an_effect_given_twice_is_refused():
    with pytest.raises(SettingsError, match=r"creep is given twice; keep one"):
        modelled(FORCE, with_size(KINDS["creep"]), with_size(KINDS["creep"]))
