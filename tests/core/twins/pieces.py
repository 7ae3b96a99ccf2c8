"""Pieces of constant curvature in plain Python, as oracle of the core."""

from __future__ import annotations

import numpy as np

from tssgeom.core.constants_route import STAIRCASE


def _cut(
    s: np.ndarray,
    tangent: np.ndarray,
    bend: np.ndarray,
    covariance: np.ndarray,
    nodes: np.ndarray,
    freedom: float,
    penalty: float,
) -> np.ndarray:
    """Nodes among `nodes` at which runs of constant curvature vector meet; docs/model.md (27)."""
    parts = parallel_components(tangent, bend)
    cells = len(nodes) - 1
    mean, variance = np.zeros((cells, 2)), np.zeros(cells)
    sharpest = 0.0
    for i in range(len(s)):
        sharpest = max(sharpest, parts[i, 0] ** 2 + parts[i, 1] ** 2)
    for j in range(cells):
        length = s[nodes[j + 1]] - s[nodes[j]]
        for i in range(nodes[j], nodes[j + 1]):
            half = 0.5 * (s[i + 1] - s[i])
            mean[j, 0] += half * (parts[i, 0] + parts[i + 1, 0]) / length
            mean[j, 1] += half * (parts[i, 1] + parts[i + 1, 1]) / length
            variance[j] += half * (covariance[i, 7] + covariance[i + 1, 7])
        variance[j] += STAIRCASE.least_step**2 * sharpest * length
        # the errors are correlated: the whole route is worth as many values as the fit has parameters
        variance[j] = freedom * length * length / (s[-1] * max(variance[j], 1e-300))
    return nodes[best_partition(mean, variance, penalty)]


def normals(tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors normal to a unit tangent and to each other, right-handed with it."""
    first = np.zeros(3)
    first[np.argmin(np.abs(tangent))] = 1.0
    first -= np.dot(first, tangent) * tangent
    first /= np.linalg.norm(first)
    second = np.empty(3)
    for c in range(3):
        d, e = (c + 1) % 3, (c + 2) % 3
        second[c] = tangent[d] * first[e] - tangent[e] * first[d]
    return first, second


def parallel_components(tangent: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Components of a normal vector field in a frame carried along the tangents without twist, [n, 2]."""
    first, second = normals(tangent[0])
    out = np.empty((len(tangent), 2))
    for i in range(len(tangent)):
        here = tangent[i]
        if i > 0:
            before = tangent[i - 1]
            stripped = 1.0 + before[0] * here[0] + before[1] * here[1] + before[2] * here[2] + 1e-12
            turned = (first[0] * here[0] + first[1] * here[1] + first[2] * here[2]) / stripped
            other = (second[0] * here[0] + second[1] * here[1] + second[2] * here[2]) / stripped
            for c in range(3):
                middle = before[c] + here[c]
                first[c] -= turned * middle
                second[c] -= other * middle
        v = vector[i]
        out[i, 0] = v[0] * first[0] + v[1] * first[1] + v[2] * first[2]
        out[i, 1] = v[0] * second[0] + v[1] * second[1] + v[2] * second[2]
    return out


def best_partition(value: np.ndarray, weight: np.ndarray, penalty: float) -> np.ndarray:
    """Cut a sequence into runs of constant value, exactly least in squared error plus `penalty` a run.

    Parameters
    ----------
    value, weight
        Sequence of vectors [n, 2] and their precisions [n].
    penalty
        Cost of each run.

    Returns
    -------
    joints
        Indices at which runs begin, and n at the end.
    """
    n = len(value)
    mass, first, square = np.zeros(n + 1), np.zeros((n + 1, 2)), np.zeros(n + 1)
    for i in range(n):
        mass[i + 1] = mass[i] + weight[i]
        for c in range(2):
            first[i + 1, c] = first[i, c] + weight[i] * value[i, c]
        square[i + 1] = square[i] + weight[i] * (value[i, 0] ** 2 + value[i, 1] ** 2)
    cost, begin = np.zeros(n + 1), np.zeros(n + 1, dtype=np.int64)
    cost[0] = -penalty
    alive, left = np.zeros(n + 1, dtype=np.int64), 1  # where a last run may still begin
    so_far = np.empty(n + 1)
    for j in range(1, n + 1):
        cost[j] = np.inf
        for k in range(left):
            i = alive[k]
            a, b = first[j, 0] - first[i, 0], first[j, 1] - first[i, 1]
            within = square[j] - square[i] - (a * a + b * b) / (mass[j] - mass[i])
            so_far[k] = cost[i] + max(within, 0.0)
            if so_far[k] + penalty < cost[j]:
                cost[j], begin[j] = so_far[k] + penalty, i
        # a begin that is now behind a cut at j stays behind it for good
        kept = 0
        for k in range(left):
            if so_far[k] <= cost[j]:
                alive[kept] = alive[k]
                kept += 1
        alive[kept], left = j, kept + 1
    runs, j = 0, n
    while j > 0:
        runs, j = runs + 1, begin[j]
    joints = np.empty(runs + 1, dtype=np.int64)
    joints[runs] = n
    for k in range(runs, 0, -1):
        joints[k - 1] = begin[joints[k]]
    return joints


def angles(s: np.ndarray, phi: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Angles of the pieces between nodes whose φ(s) is nearest to that on the nodes; docs/model.md (340)."""
    hats = np.array([np.interp(s, s[joints], row) for row in np.eye(len(joints))])
    h = np.diff(s)
    mass = (
        np.diag(np.append(h, 0.0) / 3.0 + np.append(0.0, h) / 3.0)
        + np.diag(h / 6.0, 1)
        + np.diag(h / 6.0, -1)
    )
    ends = phi[joints] * np.isin(np.arange(len(joints)), (0, len(joints) - 1))
    inner = hats[1:-1]
    ends[1:-1] = np.linalg.solve(inner @ mass @ inner.T, inner @ mass @ (phi - ends @ hats))
    return np.diff(np.minimum(np.maximum.accumulate(ends), ends[-1]))
