"""How many wrong answers ray tracers for Python give: python wrong_answers.py [--rays N] [MODEL...]

Rays are aimed at edges and vertices of closed meshes, and every answer is compared with the exact one. Without models
three meshes are made. Needs numpy; embreex, open3d and trimesh (with rtree) are left out where they are not installed.
"""

import argparse
import warnings

import numpy as np
from exact_judge import nearest
from hard_rays import MESHES, aimed_rays

import raybrook


def by_raybrook(vertices, faces, rays):
    hits = raybrook.Scene(vertices, faces).closest_hits(rays)
    return np.where(hits.hit, hits.triangle.astype(int), -1)


def by_open3d(vertices, faces, rays):
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.core.Tensor(vertices), open3d.core.Tensor(faces.astype(np.uint32)))
    found = scene.cast_rays(open3d.core.Tensor(rays))["primitive_ids"].numpy()
    return np.where(found == scene.INVALID_ID, -1, found.astype(int))


def by_embreex(vertices, faces, rays):
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene=scene, vertices=vertices, indices=faces.astype(np.int32))
    return scene.run(np.ascontiguousarray(rays[:, :3]), np.ascontiguousarray(rays[:, 3:])).astype(int)


def by_trimesh(vertices, faces, rays):
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False, use_embree=False)
    parts = np.array_split(rays.astype(float), len(rays) // 1000 + 1)  # it takes much memory for each ray
    return np.concatenate([mesh.ray.intersects_first(part[:, :3], part[:, 3:]) for part in parts])


TRACERS = {"Open3D": by_open3d, "embreex": by_embreex, "trimesh's own": by_trimesh, "raybrook": by_raybrook}


def load(path):
    """The corners of a model's triangles as a mesh whose vertices are shared."""
    corners = raybrook.Scene.load(path)._get().corners().reshape(-1, 3)
    vertices, indices = np.unique(corners, axis=0, return_inverse=True)
    return vertices, indices.reshape(-1, 3)


def count(found, right):
    """How many answers are wrong: rays that slip through, false hits, triangles that are not the nearest."""
    holes = sum(answer < 0 for answer, triangles in zip(found, right) if triangles)
    false_hits = sum(answer >= 0 for answer, triangles in zip(found, right) if not triangles)
    others = sum(answer >= 0 and answer not in triangles for answer, triangles in zip(found, right) if triangles)
    return holes, false_hits, others


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*")
    parser.add_argument("--rays", type=int, default=100_000)
    arguments = parser.parse_args()
    meshes = {path: load(path) for path in arguments.models} or {name: make() for name, make in MESHES.items()}
    warnings.simplefilter("ignore", raybrook.NoteWarning)
    for name, (vertices, faces) in meshes.items():
        rays = aimed_rays(vertices, faces, arguments.rays)
        right = nearest(vertices[faces], rays)
        hits = sum(map(bool, right))
        print(f"\n{name}: {len(faces):,} triangles, {len(rays):,} rays, of which {hits:,} hit\n")
        print("| | wrong answers | holes | false hits | another triangle |\n|---|--:|--:|--:|--:|")
        for tracer, trace in TRACERS.items():
            try:
                wrong = count(trace(vertices, faces, rays), right)
            except ImportError as missing:
                print(f"| {tracer} | left out: {missing} | | | |")
                continue
            print(f"| {tracer} | {sum(wrong):,} | " + " | ".join(f"{number:,}" for number in wrong) + " |", flush=True)


if __name__ == "__main__":
    main()
