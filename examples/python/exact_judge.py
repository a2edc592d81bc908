"""The right answers to rays, by fractions of integers: nothing is rounded. Slow, and short enough to check."""

from fractions import Fraction

import numpy as np

_LEAF = 4  # triangles
_PADDING = 1e-6  # far more than float64 errors of the test below: it only has to lose no triangle


def _spheres(corners):
    """A tree of spheres around triangles: (centre, radius, triangles) or (centre, radius, child, child)."""

    def node(triangles):
        points = corners[triangles].reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        centre = (low + high) / 2
        radius = np.linalg.norm(points - centre, axis=1).max()
        if len(triangles) <= _LEAF:
            return centre, radius, triangles
        order = np.argsort(corners[triangles].mean(axis=1)[:, np.argmax(high - low)])
        half = len(triangles) // 2
        return centre, radius, node(triangles[order[:half]]), node(triangles[order[half:]])

    return node(np.arange(len(corners)))


def _candidates(corners, rays):
    """Pairs of ray and triangle that may meet; others surely do not."""
    origins, directions = rays[:, :3].astype(np.float64), rays[:, 3:].astype(np.float64)
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    pairs = []
    open_nodes = [(_spheres(corners.astype(np.float64)), np.arange(len(rays)))]
    while open_nodes:
        (centre, radius, *rest), some = open_nodes.pop()
        from_line = np.cross(centre - origins[some], units[some])
        size = radius + np.abs(centre).max() + np.abs(origins[some]).max(axis=1, initial=0)
        some = some[np.linalg.norm(from_line, axis=1) <= radius + _PADDING * size]
        if len(some) == 0:
            continue
        if len(rest) == 2:
            open_nodes += [(child, some) for child in rest]
        else:
            pairs += [np.stack([some, np.full(len(some), triangle)], axis=1) for triangle in rest[0]]
    return np.concatenate(pairs) if pairs else np.zeros((0, 2), int)


def _whole(numbers, bits):
    """float32 numbers times 2^bits, as Python's integers."""
    mantissas, exponents = np.frexp(numbers.astype(np.float64))
    mantissas = (mantissas * 2**24).astype(np.int64).astype(object)
    shifts = exponents.astype(int) - 24 + bits
    assert shifts[numbers != 0].min(initial=0) >= 0
    return mantissas * np.array(2, dtype=object) ** np.maximum(shifts, 0).astype(object)


def _dot(a, b):
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _cross(a, b):
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def nearest(corners, rays):
    """Of each ray the triangles that it hits first, all at the same t, as a set; an empty one for a miss.

    corners: float32 [n, 3, 3]; rays: float32 [m, 6]. Edges and vertices belong to their triangles, and t is from 0 on.
    """
    used = np.concatenate([corners.ravel(), rays.ravel()])
    bits = int(24 - np.frexp(used[used != 0].astype(np.float64))[1].min())
    triangles, lines = _whole(corners, bits), _whole(rays, bits)
    pairs = _candidates(corners, rays)
    best: list[tuple[Fraction, set[int]] | None] = [None] * len(rays)
    for part in np.array_split(pairs, len(pairs) // 100_000 + 1):
        direction = lines[part[:, 0], 3:]
        a, b, c = (triangles[part[:, 1], k] - lines[part[:, 0], :3] for k in range(3))
        # Weights of the three vertices, times the determinant: volumes between the ray and each edge.
        weights = np.stack([_dot(direction, _cross(p, q)) for p, q in ((c, b), (a, c), (b, a))])
        determinant = weights.sum(axis=0)
        distance = _dot(a, _cross(c, b))
        sign = np.where(determinant < 0, -1, 1).astype(object)
        is_hit = (determinant != 0) & ((weights * sign) >= 0).all(axis=0) & (distance * sign >= 0)
        for i in np.flatnonzero(is_hit.astype(bool)):
            ray, triangle = (int(number) for number in part[i])
            t, known = Fraction(distance[i], determinant[i]), best[ray]
            if known is None or t < known[0]:
                best[ray] = (t, {triangle})
            elif t == known[0]:
                known[1].add(triangle)
    return [set() if found is None else found[1] for found in best]
