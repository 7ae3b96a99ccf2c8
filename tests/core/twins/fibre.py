"""Slow twin of fibre.c: every partition of a few gratings in turn, each piece a dense Gaussian density."""

import itertools
import math

import numpy as np


def covariance(a, b, variance, decay):
    """Of a component between arc lengths: Matérn of the order 7/2, constant where nothing decays."""
    x = decay * np.abs(a[:, None] - b[None, :])
    return variance * np.exp(-x) * (1.0 + x + 0.4 * x**2 + x**3 / 15.0)


def log_density(s, bend, precision, variance, decay):
    """Of the components of one piece, less the constant of the noise's own density."""
    read = precision > 0.0
    noise = np.diag(1.0 / precision[read])
    total = covariance(s[read], s[read], variance, decay) + noise
    square = sum(z @ np.linalg.solve(total, z) for z in bend[read].T)
    return -0.5 * square - np.linalg.slogdet(total)[1] - float(np.sum(np.log(precision[read])))


def goes_on(rate, x):
    """Probability that a piece is longer than x."""
    return 1.0 / (1.0 + rate * x)


def partitions(s, bend, precision, variance, decay, share, rate):
    """Every partition: ln of its weight, the first site of each piece, and its kind."""
    n, out = len(s), []
    piece = {
        (i, j, k): math.log(share[k]) + log_density(s[i:j], bend[i:j], precision[i:j], variance[k], decay[k])
        for i in range(n)
        for j in range(i + 1, n + 1)
        for k in range(len(share))
    }
    for cut in itertools.product((False, True), repeat=n - 1):
        starts = [0, *(i + 1 for i in range(n - 1) if cut[i])]
        spans = list(zip(starts, [*starts[1:], n], strict=True))
        end = sum(
            math.log(goes_on(rate, s[j - 1] - s[i]) - (goes_on(rate, s[j] - s[i]) if j < n else 0.0))
            for i, j in spans
        )
        for kinds in itertools.product(range(len(share)), repeat=len(spans)):
            log_weight = end + sum(piece[i, j, k] for (i, j), k in zip(spans, kinds, strict=True))
            out.append((log_weight, starts, kinds))
    return out


def log_evidence(every):
    """Return ln of the sum of all weights."""
    log_weight = np.array([each[0] for each in every])
    return float(log_weight.max() + math.log(np.sum(np.exp(log_weight - log_weight.max()))))


def posterior(s, bend, precision, variance, decay, share, rate):
    """Posterior mean of the components at the sites [n, 2], and of the square of each [n, 2]."""
    every = partitions(s, bend, precision, variance, decay, share, rate)
    total, first, second = log_evidence(every), np.zeros((len(s), 2)), np.zeros((len(s), 2))
    for log_weight, starts, kinds in every:
        for i, j, k in zip(starts, [*starts[1:], len(s)], kinds, strict=True):
            read = np.flatnonzero(precision[i:j] > 0.0)
            prior = covariance(s[i:j], s[i:j], variance[k], decay[k])
            gain = prior[:, read] @ np.linalg.inv(
                prior[np.ix_(read, read)] + np.diag(1.0 / precision[i:j][read])
            )
            mean = gain @ bend[i:j][read]
            own = np.diag(prior - gain @ prior[read])[:, None]
            first[i:j] += math.exp(log_weight - total) * mean
            second[i:j] += math.exp(log_weight - total) * (mean**2 + own)
    return first, second
