"""A plugin of pytest that has trimesh take raybrook for both of its ray tracers, before any test is loaded."""

import sys
import types
from importlib.util import find_spec

import raybrook.trimesh

if find_spec("embreex") is None:
    # One test asks for its version only, to tell whether there is anything to test.
    sys.modules["embreex"] = types.ModuleType("embreex")
    sys.modules["embreex"].__version__ = "4.4.0"

sys.modules["trimesh.ray.ray_pyembree"] = types.ModuleType("trimesh.ray.ray_pyembree")
sys.modules["trimesh.ray.ray_pyembree"].RayMeshIntersector = raybrook.trimesh.RayMeshIntersector

import trimesh.ray  # noqa: E402

trimesh.ray.ray_triangle.RayMeshIntersector = raybrook.trimesh.RayMeshIntersector
assert trimesh.ray.has_embree
assert isinstance(trimesh.creation.box().ray, raybrook.trimesh.RayMeshIntersector)
