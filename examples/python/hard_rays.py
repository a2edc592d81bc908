"""Closed meshes, and rays that are hard to trace: aimed at edges and vertices, where float32 arithmetic goes wrong."""

import numpy as np


def sphere(divisions=4):
    """A ball of 20 * 4^divisions triangles: an icosahedron, each triangle of it divided into four, again and again."""
    golden = (1 + 5**0.5) / 2
    corners = [(s, t * golden, 0) for s in (-1, 1) for t in (-1, 1)]
    vertices = np.array([np.roll(corner, turn) for turn in range(3) for corner in corners])
    distances = np.linalg.norm(vertices[:, None] - vertices[None], axis=-1)
    near = np.isclose(distances, 2)
    faces = [
        (a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[a, c]
    ]
    faces = np.array(faces)
    for _ in range(divisions):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middles = len(vertices) + inverse.reshape(-1, 3)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c = faces.T
        ab, bc, ca = middles.T
        faces = np.concatenate(
            [np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return (vertices / np.linalg.norm(vertices, axis=1, keepdims=True)).astype(np.float32), faces


def knot(around=240, across=12):
    """A tube along a trefoil knot, of 2 * around * across triangles."""
    s = np.linspace(0, 2 * np.pi, around, endpoint=False)

    def line(s):
        radius = 2 + np.cos(3 * s)
        return np.stack([radius * np.cos(2 * s), radius * np.sin(2 * s), np.sin(3 * s)], axis=-1)

    tangents = line(s + 1e-4) - line(s - 1e-4)
    sides = np.cross(tangents, [0.0, 0.0, 1.0])
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    ups = np.cross(sides, tangents)
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    turn = np.linspace(0, 2 * np.pi, across, endpoint=False)[None, :, None]
    vertices = line(s)[:, None] + 0.4 * (np.cos(turn) * sides[:, None] + np.sin(turn) * ups[:, None])
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    corner = [((i + di) % around * across + (j + dj) % across).ravel() for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))]
    faces = np.concatenate(
        [np.stack([corner[0], corner[1], corner[2]], 1), np.stack([corner[0], corner[2], corner[3]], 1)]
    )
    return vertices.reshape(-1, 3).astype(np.float32), faces


def crumpled(divisions=4):
    """A ball whose vertices are moved at random, far from the origin, so that all numbers have many digits."""
    vertices, faces = sphere(divisions)
    bumps = 1 + 0.4 * np.random.default_rng(3).random((len(vertices), 1))
    return (vertices * bumps + [10, 20, 30]).astype(np.float32), faces


def on_a_grid(mesh):
    """A mesh whose numbers are multiples of 2^-16, so that rays can be aimed at its vertices exactly."""
    vertices, faces = mesh
    return np.round(vertices * _STEPS).astype(np.float32) / np.float32(_STEPS), faces


_STEPS = 2**16
MESHES = {
    name: lambda make=make: on_a_grid(make())
    for name, make in dict(sphere=sphere, knot=knot, crumpled=crumpled).items()
}


def aimed_rays(vertices, faces, count, seed=1):
    """Rays [count, 6] from around a mesh. Of each six, one goes through a vertex and one through the middle of an edge,
    exactly if the mesh is on a grid; and one is aimed at a vertex and three at points of edges, as well as float32 can.
    """
    random = np.random.default_rng(seed)
    faces = faces[random.integers(len(faces), size=count)]
    turn = random.integers(3, size=count)
    ends = [vertices[faces[np.arange(count), (turn + k) % 3]].astype(np.float64) for k in range(2)]
    kind = np.arange(count)[:, None] % 6
    along = np.select([(kind == 0) | (kind == 2), kind == 1], [0.0, 0.5], random.random((count, 1)))
    targets = ends[0] + along * (ends[1] - ends[0])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    away = random.normal(size=(count, 3))
    away *= np.linalg.norm(high - low) / np.linalg.norm(away, axis=1, keepdims=True)
    # Half of the way, on the grid: the whole way is on it, too.
    half = np.round((targets - (low + high) / 2 - away) / 2 * _STEPS) / _STEPS
    origins = np.where(kind < 2, targets - 2 * half, (low + high) / 2 + away).astype(np.float32)
    return np.concatenate([origins, np.where(kind < 2, half, targets - origins).astype(np.float32)], axis=1)
