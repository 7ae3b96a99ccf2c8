"""The noise of a fibre goes from frame to frame; nothing else of a frame does."""

from dataclasses import replace

import numpy as np
import pytest

from tssgeom.frame import Frame, fit_frame
from tssgeom.rig import Rig
from tssgeom.route.fibre import models
from tssgeom.route.fibre.models import LastNoise, Sensed, kinds_of, noises, partitions
from tssgeom.route.fibre.sensed import clean_fibre, fit_fibre

N, NOISE = 120, 0.15
S = np.linspace(0.0, 1.0, N)
STEP, BUMP = 8.0 * ((S > 0.2) & (S < 0.5)), 5.0 * np.exp(-0.5 * ((S - 0.75) / 0.06) ** 2)
BEND = np.column_stack((STEP, BUMP))


def frame(seed: int, noise: float = NOISE) -> np.ndarray:
    """Curvatures of a frame [1/m]."""
    return BEND + noise * np.random.default_rng([seed, 71]).standard_normal((N, 2))


def relative(fit) -> float:
    return fit.curvature_noise_se / fit.curvature_noise


def test_a_frame_that_starts_from_the_last_noise_gives_what_a_grid_gives():
    last = fit_fibre(clean_fibre(frame(0), S))
    assert last.start == LastNoise(last.curvature_noise, relative(last))
    for seed in range(1, 4):
        fibre = clean_fibre(frame(seed), S)
        anew, on = fit_fibre(fibre), fit_fibre(fibre, last=last.start)
        assert on.curvature_noise != anew.curvature_noise
        assert abs(np.log(on.curvature_noise / anew.curvature_noise)) < 0.6 * relative(anew)
        assert 0.6 < relative(on) / relative(anew) < 1.6
        off = on.fit.arcs.total_angle - anew.fit.arcs.total_angle
        assert abs(off) < 0.1 * anew.fit.arcs.total_angle_se
        assert on.fit.log_evidence == pytest.approx(anew.fit.log_evidence, abs=1.0)
        last = on


@pytest.mark.parametrize("factor", [0.3, 5.0])
def test_a_frame_of_another_noise_is_averaged_anew(factor):
    start = fit_fibre(clean_fibre(frame(0), S)).start
    fibre = clean_fibre(frame(1, factor * NOISE), S)
    assert fit_fibre(fibre, last=start).curvature_noise == fit_fibre(fibre).curvature_noise


def test_a_frame_takes_three_sums_over_partitions_for_its_noise(monkeypatch):
    counted = list[float]()

    def counting(sensed, kinds, noise):
        counted.append(noise)
        return partitions(sensed, kinds, noise)

    monkeypatch.setattr(models, "partitions", counting)
    start = fit_fibre(clean_fibre(frame(0), S)).start
    assert len(counted) > 10
    counted.clear()
    fit_fibre(clean_fibre(frame(1), S), last=start)
    assert len(counted) <= 4  # three, and the likeliest partition where no piece is smooth


def test_a_frame_whose_angle_is_lost_or_whose_noise_is_known_is_no_start():
    fitted = fit_fibre(clean_fibre(frame(0), S))
    arcs = fitted.fit.arcs.scaled(angle=7.0 / fitted.fit.arcs.total_angle_se)
    assert replace(fitted, fit=replace(fitted.fit, arcs=arcs)).start is None
    assert fit_fibre(clean_fibre(frame(0), S), NOISE).start is None


def test_a_stream_hands_the_noise_on():
    rig = Rig()
    nowhere = np.full((N, 3), np.nan)
    _, first = fit_frame(Frame(nowhere, curvatures=frame(0), stations=S), rig)
    assert first.fibre_noise is not None
    _, second = fit_frame(Frame(nowhere, curvatures=frame(1), stations=S), rig, first)
    expected = fit_fibre(clean_fibre(frame(1), S), last=first.fibre_noise)
    assert second.fibre_noise == expected.start


def test_the_typical_size_allows_the_noise_of_means():
    """Of four gratings merged, the mean has half of the noise; more of it hides nothing."""
    bend = np.full((20, 2), 0.1)
    one, four = (Sensed(S[:20], bend, np.full(20, count), 0.4) for count in (1.0, 4.0))
    assert one.typical == pytest.approx(0.4)
    assert four.typical == pytest.approx(0.2)


def test_the_order_of_the_kinds_changes_no_sum():
    fibre = clean_fibre(frame(2), S)
    sensed = Sensed(S, fibre.curvatures, np.ones(N), NOISE)
    kinds = kinds_of(sensed)
    turned = models.Kinds(*(one[::-1].copy() for one in kinds))
    evidence = [partitions(sensed, one, NOISE).log_evidence for one in (kinds, turned)]
    assert evidence[0] == pytest.approx(evidence[1], abs=1e-11)
    assert noises(sensed, kinds).level.tolist() == [NOISE]
