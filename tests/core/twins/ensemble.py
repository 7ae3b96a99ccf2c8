"""Slow twins of the entries of an ensemble: deviations of members, and readings beside what they expect."""

import numpy as np

DEPENDENT = 1e-9  # of a column that is left; below it depends on the others


def deviations(random, known):
    """Return columns of `random` without what they have in common with 1, `known` and each other."""
    columns = []
    for one in [np.ones(len(random)), *known.T, *random.T]:
        rest = np.array(one)
        for other in [*columns, *columns]:
            rest = rest - np.dot(other, rest) * other
        length = np.linalg.norm(rest)
        columns.append(rest / length if length > DEPENDENT * np.linalg.norm(one) else np.zeros(len(one)))
    return np.sqrt(len(random) - 1.0) * np.column_stack(columns[len(columns) - random.shape[1] :])


def compare_readings(n, predicted, others, given, noise, drive, felt, bent):
    """Do as `tss_compare_readings`, for all channels at once."""
    pairs, way = (len(drive), 2, -1), drive[:, 2]
    probes = predicted[n:].reshape(pairs) - predicted[0]
    moved, bend = 0.5 * (probes[:, 0] - probes[:, 1]), 0.5 * np.abs(probes.sum(axis=1)).max(axis=0)
    farthest = np.abs(probes).max(axis=1)
    mean, spread = predicted[:n].mean(axis=0), predicted[:n].var(axis=0, ddof=1)
    besides = given - mean - drive[:, 0] @ moved
    variance = noise + (moved**2).sum(axis=0)
    z = besides / np.sqrt(variance + spread)
    lowest = []
    for i in range(len(drive)):
        shows = (np.abs(moved[i]) > felt * np.sqrt(noise)) & np.isfinite(z)
        signed = (way[i] * np.sign(moved[i]) * z)[shows]
        lowest.append(signed.min() if len(signed) else np.nan)
    both = 0.5 * np.diff(others[n:].reshape(pairs), axis=1)[:, 0]
    return (
        np.where(bend > bent * np.sqrt(noise), np.nan, mean + besides),
        variance,
        given - mean,
        noise + spread + (farthest**2).sum(axis=0),
        farthest,
        np.array(lowest),
        np.linalg.norm(drive[:, 1:2] * moved, axis=0),
        np.linalg.norm(drive[:, 1:2] * both, axis=0),
    )


def compare_drifts(values, variances, span, stated, share, first, setting, chance, mean, spread, last):
    """Do as `tss_compare_drifts` for members with these values and variances."""
    changes, least, most = setting
    before = last[:, 1]
    used = variances < before
    lost = np.where(used, before - variances, 1.0)
    noise, reading = before * variances / lost, last[:, 0] + (values - last[:, 0]) * before / lost
    expected, off = spread + noise[:, None], reading[:, None] - mean
    log = -0.5 * (np.minimum(off**2 / expected, 36.0) + np.log(expected))
    weights = chance * np.exp(log - log.max(axis=1, keepdims=True))
    read = chance, mean, spread
    gain = spread / expected
    new = weights / weights.sum(axis=1, keepdims=True), mean + gain * off, spread * (1.0 - gain)
    chance, mean, spread = (np.where(used[:, None], b, a) for a, b in zip(read, new, strict=True))
    comes = np.minimum(changes * span, 1.0)[:, None] * first
    stays = (1.0 - np.minimum(changes * span, 1.0))[:, None] * chance
    middle = (chance * mean).sum(axis=1, keepdims=True)
    between = (chance * (mean - middle) ** 2).sum(axis=1)
    whole = (chance * spread).sum(axis=1, keepdims=True) + between[:, None]
    chance = stays + comes
    mixed = (stays * mean + comes * middle) / chance
    spread = stays * (spread + (mean - mixed) ** 2) + comes * (whole + (middle - mixed) ** 2)
    mean, spread = mixed, spread / chance
    rate = np.clip(chance @ share, least, most)
    added = rate * stated * span
    last = np.column_stack((values, variances + added, between, rate))
    return np.sqrt(added), chance, mean, spread + np.outer(stated * span, share), last


def known_numbers(values, covariance, last, beyond):
    """Do as `tss_known_numbers`."""
    unit = np.sqrt(last[:, 1])
    more = beyond[:, :-1] / np.outer(unit, unit)
    spread = np.linalg.inv(np.linalg.inv(covariance) + more)
    return values + spread @ (beyond[:, -1] / unit - more @ (values - last[:, 0])), spread
