"""Rates of ray tracers for Python, from NumPy arrays to NumPy arrays: python benches/python/rates.py [MODEL]

Wall clock, in millions of rays or points a second: the median of some rounds, in which all take turns. Without a model
a knot of 192,000 triangles is made. Nothing else should run meanwhile. Needs numpy and an installed raybrook; embreex
and open3d are left out where they are not installed. embreex has no counts, no lists and no closest points.
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


def batches(vertices, faces, count):
    """Rays by name: from an eye through the pixels of a picture, the same shuffled, from all around to anywhere on the
    model, and aimed at edges and vertices. And a quarter as many points: anywhere in the model's box, and near it."""
    side = int(count**0.5)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    eye = ((low + high) / 2 + [0, 0, 1.5 * np.linalg.norm(high - low)]).astype(np.float32)
    primary = raybrook.open3d.RaycastingScene.create_rays_pinhole(
        fov_deg=40, center=(low + high) / 2, eye=eye, up=[0, 1, 0], width_px=side, height_px=side
    )
    primary = primary.numpy().reshape(-1, 6)
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
        "random": np.concatenate([start, targets.astype(np.float32) - start], axis=1),
        "edges": hard[(kinds == 1) | (kinds > 2)],
        "vertices": hard[(kinds == 0) | (kinds == 2)],
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
    parser.add_argument("model", nargs="?")
    parser.add_argument("--rays", type=int, default=1 << 20)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    if arguments.model:
        corners = raybrook.Scene.load(arguments.model)._get().corners().reshape(-1, 3)
        vertices, faces = np.unique(corners, axis=0, return_inverse=True)
        faces = faces.reshape(-1, 3)
    else:
        vertices, faces = on_a_grid(knot(1200, 80))
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
