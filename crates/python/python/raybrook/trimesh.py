"""Ray queries with the interface of trimesh's: a drop-in for ``trimesh.ray.ray_pyembree.RayMeshIntersector``.

>>> mesh = trimesh.load("bunny.stl")
>>> mesh.ray = raybrook.trimesh.RayMeshIntersector(mesh)
>>> mesh.ray.intersects_first(origins, directions)

Names, arguments, shapes and dtypes are those of trimesh 5. What differs is that answers are exact: no ray slips between
two triangles, none is hit twice by an edge, and points in or out of a closed mesh are told without a choice of
direction. trimesh need not be installed: any object with ``vertices`` and ``faces`` will do.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from . import _arrays, _raybrook
from ._errors import InputError
from ._scene import Scene

__all__ = ["RayMeshIntersector"]

# Where a mesh is not closed, crossings are counted along these: any directions that few edges lie along.
_DIRECTIONS = ((0.4375, 0.625, 0.65625), (-0.53125, 0.28125, 0.796875), (0.71875, -0.65625, 0.21875))


class RayMeshIntersector:
    """Ray queries for one mesh.

    Args:
        geometry: a ``trimesh.Trimesh``, or any object with ``vertices`` and ``faces``. Changes of a Trimesh are
            noticed.
        scale_to_box: where vertices are no float32 numbers, count from a place among them, as ``raybrook.Scene`` does
            with ``origin="auto"``: less is lost of a mesh that is far from 0. Nothing is scaled: there is no need.
        choices: device, method, precision, memory_limit, cache and fall_back, as of `raybrook.Scene`.
    """

    def __init__(self, geometry: Any, scale_to_box: bool = True, **choices: Any) -> None:
        self.mesh = geometry
        self._scale_to_box = scale_to_box
        self._choices = choices
        self._scene: Scene | None = None
        self._hash: int | None = None
        self._is_closed = True

    def _get(self) -> Scene:
        """The scene of the mesh as it is now."""
        current = _state(self.mesh)
        if self._scene is None or current != self._hash:
            scene = Scene(**self._choices, origin="auto" if self._scale_to_box else None)
            # Vertices that are not finite belong to triangles that are never hit, as in trimesh.
            scene._is_strict = False
            scene._add(np.asarray(self.mesh.vertices), np.asarray(self.mesh.faces), None)
            self._scene, self._hash, self._is_closed = scene, current, True
        return self._scene

    def intersects_id(
        self,
        ray_origins: Any,
        ray_directions: Any,
        multiple_hits: bool = True,
        max_hits: int = 100,
        return_locations: bool = False,
    ) -> tuple[np.ndarray, ...]:
        """The triangles that rays hit, ray after ray, those of a ray from the closest on.

        Args:
            ray_origins: ``(n, 3)``.
            ray_directions: ``(n, 3)``, of any length.
            multiple_hits: every hit of a ray, or the closest only. Where several triangles are hit in one point, as at
                an edge, the first one counts.
            max_hits: no more than so many of a ray.
            return_locations: whether to tell where the hits are.

        Returns:
            index_tri: int64 ``(m,)``, rows of ``mesh.faces``.
            index_ray: int64 ``(m,)``.
            locations: float64 ``(m, 3)``, if they were asked for.
        """
        scene = self._get()
        rays = _rays(ray_origins, ray_directions)
        if multiple_hits:
            hits = scene.list_hits(rays, most=max_hits, merge=True)
            index_ray, triangle, uv = hits.ray, hits.triangle, hits.uv
        else:
            closest = scene.closest_hits(rays)
            index_ray = np.flatnonzero(closest.hit)
            triangle, uv = closest.triangle[index_ray], closest.uv[index_ray]
        index_tri, index_ray = triangle.astype(np.int64), index_ray.astype(np.int64)
        if not return_locations:
            return index_tri, index_ray
        return index_tri, index_ray, self._locations(index_tri, uv)

    def _locations(self, index_tri: np.ndarray, uv: np.ndarray) -> np.ndarray:
        """Points of the mesh's own triangles, in float64."""
        vertices, faces = np.asarray(self.mesh.vertices, np.float64), np.asarray(self.mesh.faces)[index_tri]
        p0, p1, p2 = (vertices[faces[:, corner]] for corner in range(3))
        u, v = uv[:, :1].astype(np.float64), uv[:, 1:].astype(np.float64)
        locations: np.ndarray = p0 + u * (p1 - p0) + v * (p2 - p0)
        return locations

    def intersects_location(
        self, ray_origins: Any, ray_directions: Any, multiple_hits: bool = True, **kwargs: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where rays hit the mesh; arguments as of `intersects_id`.

        Returns:
            locations: float64 ``(m, 3)``.
            index_ray: int64 ``(m,)``.
            index_tri: int64 ``(m,)``.
        """
        index_tri, index_ray, locations = self.intersects_id(
            ray_origins, ray_directions, multiple_hits=multiple_hits, return_locations=True, **kwargs
        )
        return locations, index_ray, index_tri

    def intersects_first(self, ray_origins: Any, ray_directions: Any) -> np.ndarray:
        """The first triangle that each ray hits: int64 ``(n,)``, -1 for a miss."""
        hits = self._get().closest_hits(_rays(ray_origins, ray_directions))
        return np.where(hits.hit, hits.triangle.astype(np.int64), -1)

    def intersects_any(self, ray_origins: Any, ray_directions: Any) -> np.ndarray:
        """Whether each ray hits the mesh: bool ``(n,)``."""
        return self._get().any_hit(_rays(ray_origins, ray_directions))

    def contains_points(self, points: Any) -> np.ndarray:
        """Whether each of the points ``(n, 3)`` is inside of the mesh: bool ``(n,)``.

        Exact for a closed mesh, on whose surface a point counts as inside. Of another mesh a point is inside where rays
        both ways along a direction leave through an odd number of surfaces; where they disagree another direction is
        tried, and a point that can be left without crossing anything is outside.
        """
        if np.ndim(points) != 2 or np.shape(points)[1] != 3:
            raise ValueError("points must be (n,3)")
        scene = self._get()
        given, _ = _arrays.points("points", points, scene._from)
        core = scene._opened()
        if self._is_closed:
            try:
                return core.contains(given, None)
            except InputError:
                self._is_closed = False
        return _contained_by_vote(core, given)

    def __getstate__(self) -> dict[str, Any]:
        # The hash of another process's mesh says nothing here.
        return {**self.__dict__, "_scene": None, "_hash": None}

    def __copy__(self, *_: Any) -> RayMeshIntersector:
        return RayMeshIntersector(self.mesh, self._scale_to_box, **self._choices)

    def __deepcopy__(self, *_: Any) -> RayMeshIntersector:
        return self.__copy__()


def _state(mesh: Any) -> int:
    """What changes with a mesh: trimesh's hash tells its contents. Changes of other objects are not noticed."""
    try:
        return hash(mesh)
    except TypeError:
        return id(mesh)


def _rays(ray_origins: Any, ray_directions: Any) -> tuple[Any, Any]:
    """Rays as a scene takes them, if they are any."""
    if np.shape(ray_origins) != np.shape(ray_directions):
        raise ValueError("Ray origin and direction don't match!")
    if np.size(ray_origins) == 0:
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    if np.ndim(ray_origins) != 2 or np.shape(ray_origins)[1] != 3:
        raise ValueError(f"ray_origins: the shape must be (n, 3), but is {np.shape(ray_origins)}")
    return ray_origins, ray_directions


def _contained_by_vote(core: _raybrook.Core, points: np.ndarray) -> np.ndarray:
    inside = np.zeros(len(points), dtype=bool)
    left = np.arange(len(points))
    for direction in np.array(_DIRECTIONS, np.float32):
        ways = (np.tile(way, (len(left), 1)) for way in (direction, -direction))
        there, back = (core.count_crossings((points[left], way, (0.0, math.inf)), None) for way in ways)
        agree = there % 2 == back % 2
        inside[left[agree]] = there[agree] % 2 == 1
        left = left[~agree & (there > 0) & (back > 0)]
    return inside
