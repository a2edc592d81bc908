"""Ray casting with the interface of Open3D's: a drop-in for ``open3d.t.geometry.RaycastingScene``.

>>> scene = raybrook.open3d.RaycastingScene()
>>> scene.add_triangles(vertices, triangles)
0
>>> scene.cast_rays(rays)["t_hit"].numpy()

Names, arguments, keys, shapes and dtypes are those of Open3D 0.20. Arguments are NumPy arrays, lists or Open3D's
tensors. Results are tensors if an argument is one, else arrays that know ``.numpy()`` and ``.cpu()``, too. What differs
is that answers are exact. Open3D need not be installed.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from . import _arrays
from ._errors import InputError
from ._hits import NO_HIT
from ._scene import Scene

__all__ = ["RaycastingScene"]


class Array(np.ndarray):
    """An array with the methods of a tensor that programs for Open3D call on results."""

    def numpy(self) -> np.ndarray:
        """The plain array, which shares its memory."""
        return self.view(np.ndarray)

    def cpu(self) -> Array:
        """Itself: it is in the processor's memory."""
        return self


def _is_tensor(value: Any) -> bool:
    """Whether ``value`` is one of Open3D's tensors; without loading Open3D."""
    return type(value).__module__.startswith("open3d.") and type(value).__name__ == "Tensor"


def _plain(value: Any) -> Any:
    return value.numpy() if _is_tensor(value) else value


def _like(given: Any, array: np.ndarray) -> Any:
    """``array`` as a tensor, if ``given`` is one."""
    if _is_tensor(given):
        import open3d  # type: ignore[import-not-found, unused-ignore]

        return open3d.core.Tensor.from_numpy(np.ascontiguousarray(array))
    return array.view(Array)


class RaycastingScene:
    """Triangle meshes for rays and points.

    Args:
        nthreads: accepted and without effect: all cores are used, or as many as ``RAYON_NUM_THREADS`` says.
        device: an Open3D device of the processor, or what `raybrook.Scene` takes: gpu, cpu, reference, a number or part
            of a name.
        choices: method, precision, memory_limit, cache and fall_back, as of `raybrook.Scene`.
    """

    INVALID_ID = NO_HIT

    def __init__(self, nthreads: int | RaycastingScene = 0, device: Any = None, **choices: Any) -> None:
        if isinstance(nthreads, RaycastingScene):
            self._scene: Scene = copy.copy(nthreads._scene)
            return
        self._scene = Scene(device=_device(device), **choices)
        # Vertices that are not finite belong to triangles that are never hit, as in Open3D.
        self._scene._is_strict = False

    def add_triangles(self, vertex_positions: Any = None, triangle_indices: Any = None, *, mesh: Any = None) -> int:
        """Add a triangle mesh, and tell its geometry ID.

        Args:
            vertex_positions: ``{N, 3}`` float32; or the mesh.
            triangle_indices: ``{M, 3}`` uint32.
            mesh: an ``open3d.t.geometry.TriangleMesh``, instead of both.
        """
        if mesh is None and triangle_indices is None:
            mesh = vertex_positions
        if mesh is not None:
            vertex_positions, triangle_indices = mesh.vertex.positions, mesh.triangle.indices
        return self._scene._add(_plain(vertex_positions), _plain(triangle_indices), None)

    def cast_rays(self, rays: Any, nthreads: int = 0) -> dict[str, Any]:
        """The first intersection of each ray.

        Args:
            rays: ``{.., 6}`` float32: origin and direction.
            nthreads: without effect.

        Returns:
            ``t_hit`` ``{..}``, infinity for a miss; ``geometry_ids`` and ``primitive_ids`` ``{..}``, `INVALID_ID` for a
            miss; ``primitive_uvs`` ``{.., 2}``; ``primitive_normals`` ``{.., 3}``.
        """
        t, uv, triangle, mesh, normals = self._scene._closest(_rays(rays), 0.0, math.inf, True, None)
        found = {
            "t_hit": t,
            "geometry_ids": mesh,
            "primitive_ids": triangle,
            "primitive_uvs": uv,
            "primitive_normals": normals,
        }
        return {key: _like(rays, array) for key, array in found.items()}

    def test_occlusions(self, rays: Any, tnear: float = 0.0, tfar: float = math.inf, nthreads: int = 0) -> Any:
        """Whether each ray hits anything from ``tnear`` to ``tfar``: bool ``{..}``."""
        return _like(rays, self._scene.any_hit(_rays(rays), t_min=tnear, t_max=tfar))

    def count_intersections(self, rays: Any, nthreads: int = 0) -> Any:
        """How many intersections each ray has: int32 ``{..}``. One through an edge of a mesh counts once."""
        given, shape = _arrays.rays(_rays(rays), 0.0, math.inf, self._scene._from)
        counts = self._scene._opened().count(given, True, None).reshape(shape)
        return _like(rays, counts.astype(np.int32))

    def list_intersections(self, rays: Any, nthreads: int = 0) -> dict[str, Any]:
        """All intersections of the rays, those of a ray from the closest on, and one for an edge of a mesh.

        Returns:
            ``ray_splits`` ``{rays + 1}``: those of ray i are ``ray_splits[i]`` to ``ray_splits[i + 1]``; ``ray_ids``,
            ``t_hit``, ``geometry_ids``, ``primitive_ids`` ``{n}``; ``primitive_uvs`` ``{n, 2}``.
        """
        hits = self._scene.list_hits(_rays(rays), merge=True)
        found = {
            "ray_splits": hits.starts.astype(np.uint32),
            "ray_ids": hits.ray.astype(np.uint32),
            "t_hit": hits.t,
            "geometry_ids": hits.mesh,
            "primitive_ids": hits.triangle,
            "primitive_uvs": hits.uv,
        }
        return {key: _like(rays, array) for key, array in found.items()}

    def compute_closest_points(self, query_points: Any, nthreads: int = 0) -> dict[str, Any]:
        """The closest point of the surface to each point ``{.., 3}``.

        Returns:
            ``points`` ``{.., 3}``; ``geometry_ids`` and ``primitive_ids`` ``{..}``, `INVALID_ID` where there is none;
            ``primitive_uvs`` ``{.., 2}``; ``primitive_normals`` ``{.., 3}``.
        """
        closest, normals = self._scene._closest_point(_points(query_points), True, None)
        found = {
            "points": closest.point,
            "geometry_ids": closest.mesh,
            "primitive_ids": closest.triangle,
            "primitive_uvs": closest.uv,
            "primitive_normals": normals,
        }
        return {key: _like(query_points, array) for key, array in found.items()}

    def compute_distance(self, query_points: Any, nthreads: int = 0) -> Any:
        """The distance of each point ``{.., 3}`` from the surface: float32 ``{..}``."""
        return _like(query_points, self._scene.distance(_points(query_points)))

    def compute_signed_distance(self, query_points: Any, nthreads: int = 0, nsamples: int = 1) -> Any:
        """As `compute_distance`, but negative inside: float32 ``{..}``.

        Args:
            query_points: ``{.., 3}``.
            nthreads: without effect.
            nsamples: an odd number, without effect: one ray tells exactly what is inside.
        """
        _check_samples(nsamples)
        points = _points(query_points)
        try:
            distance = self._scene.signed_distance(points)
        except InputError:
            distance = self._scene.distance(points)
            distance = np.where(self._is_inside_of_open(points), -distance, distance)
        return _like(query_points, distance)

    def compute_occupancy(self, query_points: Any, nthreads: int = 0, nsamples: int = 1) -> Any:
        """1 inside of a closed surface and on it, 0 outside: float32 ``{..}``.

        Arguments are those of `compute_signed_distance`. Where the surface is not closed, that is inside from where a
        ray leaves through an odd number of surfaces.
        """
        _check_samples(nsamples)
        points = _points(query_points)
        try:
            inside = self._scene.contains(points)
        except InputError:
            inside = self._is_inside_of_open(points)
        return _like(query_points, inside.astype(np.float32))

    def _is_inside_of_open(self, points: np.ndarray) -> np.ndarray:
        """Whether an odd number of surfaces is crossed in the direction that Open3D takes for its first ray."""
        crossings = self._scene.count_crossings((points, np.array([1, 1, 1], np.float32)))
        is_odd: np.ndarray = crossings % 2 == 1
        return is_odd

    @staticmethod
    def create_rays_pinhole(*args: Any, **kwargs: Any) -> Any:
        """Rays of a pinhole camera: float32 ``{height_px, width_px, 6}``.

        Either ``(intrinsic_matrix, extrinsic_matrix, width_px, height_px)``: the upper triangular ``{3, 3}`` matrix and
        the ``{4, 4}`` one from world to camera; or ``(fov_deg, center, eye, up, width_px, height_px)``: the horizontal
        field of view in degrees, where the camera looks, where it is, and what is up.
        """
        is_by_matrices = len(args) + len(kwargs) == 4
        rays = _by_matrices(*args, **kwargs) if is_by_matrices else _by_angle(*args, **kwargs)
        tensor = next((value for value in (*args, *kwargs.values()) if _is_tensor(value)), None)
        return _like(tensor, rays)

    def __copy__(self) -> RaycastingScene:
        return RaycastingScene(self)

    def __deepcopy__(self, memo: dict[int, Any]) -> RaycastingScene:
        return RaycastingScene(self)


def _device(device: Any) -> Any:
    """A device as `raybrook.Scene` takes it."""
    if device is None or isinstance(device, (str, int)) and not str(device).startswith("CPU:"):
        return device
    if str(device).startswith("CPU:"):
        return None
    raise ValueError(f"device: {device} is none of raybrook's; raybrook.devices() lists them")


def _rays(rays: Any) -> np.ndarray:
    return _rows("rays", rays, 6)


def _points(query_points: Any) -> np.ndarray:
    # Rounded once, and not by each question that an answer takes.
    return _arrays.float32("query_points", _rows("query_points", query_points, 3))[0]


def _rows(name: str, value: Any, last: int) -> np.ndarray:
    array = _arrays.with_last(name, _arrays.as_array(name, _plain(value)), (last,))
    if array.ndim < 2:
        raise ValueError(f"{name}: the shape must be {{.., {last}}} with two dimensions or more, but is {array.shape}")
    return array


def _check_samples(nsamples: int) -> None:
    if nsamples < 1 or nsamples % 2 == 0:
        raise ValueError(f"nsamples: {nsamples} is not an odd number from 1 on")


def _by_matrices(intrinsic_matrix: Any, extrinsic_matrix: Any, width_px: int, height_px: int) -> np.ndarray:
    intrinsic = np.asarray(_plain(intrinsic_matrix), dtype=np.float64)
    extrinsic = np.asarray(_plain(extrinsic_matrix), dtype=np.float64)
    for name, matrix, shape in (("intrinsic_matrix", intrinsic, (3, 3)), ("extrinsic_matrix", extrinsic, (4, 4))):
        if matrix.shape != shape:
            raise ValueError(f"{name}: the shape must be {shape}, but is {matrix.shape}")
    to_world = extrinsic[:3, :3].T
    # In float32 from here on, as Open3D.
    from_pixels = (to_world @ np.linalg.inv(intrinsic)).astype(np.float32)
    x = np.arange(width_px, dtype=np.float32) + np.float32(0.5)
    y = np.arange(height_px, dtype=np.float32)[:, None] + np.float32(0.5)
    rays = np.empty((height_px, width_px, 6), np.float32)
    rays[..., :3] = (-to_world @ extrinsic[:3, 3]).astype(np.float32)
    for axis, (of_x, of_y, constant) in enumerate(from_pixels):
        rays[..., 3 + axis] = of_x * x + of_y * y + constant
    return rays


def _by_angle(fov_deg: float, center: Any, eye: Any, up: Any, width_px: int, height_px: int) -> np.ndarray:
    places = (("center", center), ("eye", eye), ("up", up))
    vectors = {name: np.asarray(_plain(place), dtype=np.float64) for name, place in places}
    for name, vector in vectors.items():
        if vector.shape != (3,):
            raise ValueError(f"{name}: the shape must be (3,), but is {vector.shape}")
    focal_length = 0.5 * width_px / math.tan(0.5 * math.radians(fov_deg))
    intrinsic = np.array([[focal_length, 0, 0.5 * width_px], [0, focal_length, 0.5 * height_px], [0, 0, 1]])

    def unit(vector: np.ndarray) -> np.ndarray:
        of_length_1: np.ndarray = vector / np.linalg.norm(vector)
        return of_length_1

    forward = unit(vectors["center"] - vectors["eye"])
    right = unit(np.cross(unit(vectors["up"]), forward))
    rotation = np.stack([right, np.cross(forward, right), forward])
    extrinsic = np.eye(4)
    extrinsic[:3, :3] = rotation
    extrinsic[:3, 3] = -rotation @ vectors["eye"]
    return _by_matrices(intrinsic, extrinsic, width_px, height_px)
