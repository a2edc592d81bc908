"""Rates of ray tracers for Python, from NumPy arrays to NumPy arrays: python benches/python/rates.py [MODEL]

Wall clock, in millions of rays or points a second: the median of some rounds, in which all take turns. MODEL is a file,
or one that is made: `knot` of 192,000 triangles (the default), `landscape` of 498,002, a grid of heights, or `voxels`,
of 256,820 between full and empty cubes. Nothing else should run meanwhile. Needs numpy and an installed raybrook;
embreex and open3d are left out where they are not installed. embreex has no counts, no lists and no closest points.
"""

import argparse
import statistics
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "python"))

from hard_rays import aimed_rays, knot, on_a_grid  # noqa: E402

import raybrook.open3d  # noqa: E402


def landscape(side=500):
    """Heights over a grid: hills, and steps of chance."""
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    hills = 20 * np.sin(x / 37) * np.cos(y / 53) + 6 * np.sin((x + y) / 11)
    heights = hills + np.random.default_rng(5).random((side, side))
    corner = (x * side + y)[:-1, :-1].ravel()
    across = corner + side + 1
    faces = [np.stack([corner, corner + side, across], 1), np.stack([corner, across, corner + 1], 1)]
    return np.stack([x, y, heights], axis=-1).reshape(-1, 3), np.concatenate(faces)


def voxels(side=64):
    """The faces between the full and the empty cubes of a grid, two triangles each."""
    at = 2 * np.pi * np.indices((side,) * 3) / side
    full = sum(np.sin(3 * at[axis]) * np.cos(3 * at[axis - 1]) for axis in range(3)) > 0
    full &= np.random.default_rng(6).random(full.shape) < 0.9
    full = np.pad(full, 1)
    squares = []
    for axis in range(3):
        ahead = np.roll(full, -1, axis)  # nothing of the last layer is full
        for is_face, is_flipped in ((full & ~ahead, False), (~full & ahead, True)):
            first = np.argwhere(is_face)
            first[:, axis] += 1
            steps = np.zeros((4, 3), dtype=int)
            steps[1:3, axis - 2] = steps[2:4, axis - 1] = 1
            squares.append(first[:, None] + (steps[::-1] if is_flipped else steps))
    corners = np.concatenate(squares)
    vertices, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, numbers.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


MADE = {"knot": lambda: knot(1200, 80), "landscape": landscape, "voxels": voxels}


def structured_rays(vertices, faces, count, random):
    """Rays that have to do with a model's own vertices and edges: from them, along them, and parallel to an axis."""
    corners = vertices[faces[random.integers(len(faces), size=count)]]
    first, second, other = corners[:, 0], corners[:, 1], vertices[random.integers(len(vertices), size=count)]
    other = np.where((other == first).all(axis=1, keepdims=True), second, other)
    low, high = vertices.min(axis=0) - 1, vertices.max(axis=0) + 1
    rays = {
        "from vertices": (first, random.normal(size=first.shape)),
        "from vertex to vertex": (first, other - first),
        "along edges": (first, second - first),
    }
    for name, axis, start, way in (("down", 2, high[2], -1), ("sideways", 0, low[0], 1)):
        direction = np.zeros_like(first)
        direction[:, axis] = way
        for kind, targets in (("vertices", first), ("middles of edges", (first + second) / 2)):
            origins = targets.copy()
            origins[:, axis] = start
            rays[f"{name} at {kind}"] = (origins, direction)
    return {name: np.concatenate(parts, axis=1).astype(np.float32) for name, parts in rays.items()}


def batches(vertices, faces, count):
    """Rays by name: from an eye through the pixels of a picture, the same shuffled, from eyes inside that look along an
    axis, from all around to anywhere on the model, and aimed at edges and vertices; and those of structured_rays().
    And a quarter as many points: anywhere in the model's box, and near it."""
    side = int(count**0.5)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    eye = ((low + high) / 2 + [0, 0, 1.5 * np.linalg.norm(high - low)]).astype(np.float32)
    primary = raybrook.open3d.RaycastingScene.create_rays_pinhole(
        fov_deg=40, center=(low + high) / 2, eye=eye, up=[0, 1, 0], width_px=side, height_px=side
    )
    primary = primary.numpy().reshape(-1, 6)
    ahead, aside = np.ones((side, side)), np.linspace(-0.62, 0.62, side)
    along = np.stack([ahead, *np.meshgrid(aside, aside)], axis=-1).reshape(-1, 3)
    # Near the middle of one axis, where a coordinate has bits far below the others': walls were slow from there.
    eyes = (low + high) / 2 + (high - low) * np.random.default_rng(7).uniform(-0.3, 0.3, (16, 3)) * [1, 1, 0.01]
    inside = np.repeat(eyes, len(along) // 16 + 1, axis=0)[: len(along)]
    random = np.random.default_rng(4)
    away = random.normal(size=(len(primary), 3))
    away *= 0.75 * np.linalg.norm(high - low) / np.linalg.norm(away, axis=1, keepdims=True)
    corners = vertices[faces[random.integers(len(faces), size=len(primary))]].astype(float)
    targets = np.einsum("nij,ni->nj", corners, random.dirichlet((1, 1, 1), size=len(primary)))
    start = ((low + high) / 2 + away).astype(np.float32)
    points = random.uniform(low, high, (len(primary) // 4, 3))
    near = targets[: len(points)] + random.normal(size=points.shape) * 1e-3 * np.linalg.norm(high - low)
    hard = aimed_rays(vertices, faces, 6 * len(primary) // 4).reshape(-1, 6)
    kinds = np.arange(len(hard)) % 6
    return {
        "primary": primary,
        "shuffled": primary[np.random.default_rng(2).permutation(len(primary))],
        "along an axis": np.concatenate([inside, along], axis=1).astype(np.float32),
        "random": np.concatenate([start, targets.astype(np.float32) - start], axis=1),
        "edges": hard[(kinds == 1) | (kinds > 2)],
        "vertices": hard[(kinds == 0) | (kinds == 2)],
        **structured_rays(vertices, faces, len(primary), random),
        "points in the box": points.astype(np.float32),
        "points near it": near.astype(np.float32),
    }


def of_raybrook(vertices, faces, device):
    scene = raybrook.Scene(vertices, faces, device=device)
    print(f"raybrook {raybrook.__version__} on {scene.device}: {scene.choices[0]}")
    of_rays = {"closest": scene.closest_hits, "any": scene.any_hit, "count": scene.count, "list": scene.list_hits}
    return {**of_rays, "closest point": scene.closest_point}


def of_open3d(vertices, faces, _):
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.core.Tensor(vertices), open3d.core.Tensor(faces.astype(np.uint32)))

    def asked(ask):
        def answer(rays):
            found = ask(open3d.core.Tensor.from_numpy(rays))
            return {key: tensor.numpy() for key, tensor in found.items()} if isinstance(found, dict) else found.numpy()

        return answer

    of_rays = (scene.cast_rays, scene.test_occlusions, scene.count_intersections, scene.list_intersections)
    return dict(zip((*OF_RAYS, "closest point"), map(asked, (*of_rays, scene.compute_closest_points))))


def of_embreex(vertices, faces, _):
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene=scene, vertices=vertices, indices=faces.astype(np.int32))

    def ask(query, **options):
        def answer(rays):
            origins, directions = (np.ascontiguousarray(rays[:, part]) for part in (slice(3), slice(3, 6)))
            return scene.run(origins, directions, query=query, **options)

        return answer

    # With `output` it tells t, u and v, too, as the others do.
    return {"closest": ask("INTERSECT", output=True), "any": ask("OCCLUDED")}


OF_RAYS = ("closest", "any", "count", "list")
TRACERS = {"raybrook": of_raybrook, "Open3D": of_open3d, "embreex": of_embreex}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", default="knot", help=f"a file, or one of: {', '.join(MADE)}")
    parser.add_argument("--rays", type=int, default=1 << 20)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    if arguments.model in MADE:
        vertices, faces = on_a_grid(MADE[arguments.model]())
    else:
        corners = raybrook.Scene.load(arguments.model)._get().corners().reshape(-1, 3)
        vertices, faces = np.unique(corners, axis=0, return_inverse=True)
        faces = faces.reshape(-1, 3)
    tracers = {}
    for name, make in TRACERS.items():
        try:
            tracers[name] = make(vertices, faces, arguments.device)
        except ImportError as missing:
            print(f"{name} is left out: {missing}")
    print(f"{len(faces):,} triangles, medians of {arguments.rounds} rounds, millions of rays or points a second\n")
    print("| rays or points | question | " + " | ".join(tracers) + " |\n|---|---|" + "--:|" * len(tracers))
    for batch, rays in batches(vertices, faces, arguments.rays).items():
        rays = np.ascontiguousarray(rays)
        for question in OF_RAYS if rays.shape[1] > 3 else ("closest point",):
            times = {name: [] for name in tracers if question in tracers[name]}
            for round_number in range(arguments.rounds + 1):
                for name, taken in times.items():
                    start = time.perf_counter()
                    tracers[name][question](rays)
                    if round_number > 0:  # the first one compiles and fills caches
                        taken.append(time.perf_counter() - start)
            rates = [
                f"{len(rays) / statistics.median(times[name]) / 1e6:.2f}" if name in times else "" for name in tracers
            ]
            print(f"| {batch} | {question} | " + " | ".join(rates) + " |", flush=True)


if __name__ == "__main__":
    main()
