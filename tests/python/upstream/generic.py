"""What trimesh's ray tests take from their module of this name, which its source distribution does not have."""

import logging
import os
import time  # noqa: F401

import numpy as np
import trimesh

log = logging.getLogger("trimesh")
_models = os.environ["TRIMESH_MODELS"]
_random = np.random.default_rng(0)


def random(shape):
    return _random.random(shape)


def get_mesh(file_name, **kwargs):
    use_embree = kwargs.pop("use_embree", True)
    mesh = trimesh.load_mesh(os.path.join(_models, file_name), **kwargs)
    mesh.source.file_path = os.path.join(_models, file_name)  # by which a test knows it
    if not use_embree:
        mesh.ray = trimesh.ray.ray_triangle.RayMeshIntersector(mesh)
    return mesh


def _rays(name):
    """Rays through a grid over the mesh, and beside it."""
    low, high = get_mesh(name).bounds
    margin = (high - low) / 8
    grid = trimesh.util.grid_linspace(np.array([low - margin, high + margin])[:, :2], 24)
    origins = np.column_stack((grid, np.full(len(grid), low[2] - 10)))
    return {"ray_origins": origins, "ray_directions": np.tile([0.0, 0.0, 1.0], (len(grid), 1))}


_names = ["ballA.off", "cylinder.stl", "angle_block.STL", "unit_cube.STL"]
data = {
    "ray_data": {
        "load_kwargs": [{"file_name": name, "use_embree": use} for name in _names for use in (True, False)],
        "rays": {name: _rays(name) for name in _names},
    }
}
