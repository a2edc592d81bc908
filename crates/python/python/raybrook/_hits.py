"""What rays hit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NO_HIT = 0xFFFF_FFFF
"""Marks a ray that hits nothing, in `Hits.triangle` and `Hits.mesh`. As an index it is an error and not a triangle."""


@dataclass(frozen=True, eq=False)
class Hits:
    """The closest hit of each ray. All arrays begin with the rays' leading shape."""

    t: np.ndarray
    """float32: distance in lengths of the direction; infinity for a miss."""
    triangle: np.ndarray
    """uint32: number of the triangle in its mesh; `NO_HIT` for a miss."""
    mesh: np.ndarray
    """uint32: number of the mesh; `NO_HIT` for a miss."""
    uv: np.ndarray
    """float32 ``[..., 2]``: weights of the triangle's second and third vertex; 0 for a miss."""

    @property
    def hit(self) -> np.ndarray:
        """bool: whether the ray hits anything."""
        is_hit: np.ndarray = self.triangle != NO_HIT
        return is_hit


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """The closest point of the scene to each point. All arrays begin with the points' leading shape."""

    point: np.ndarray
    """float32 ``[..., 3]``: where it is; NaN where there is none. float64 of a scene with an origin."""
    distance: np.ndarray
    """float32: how far away it is; NaN where there is none."""
    triangle: np.ndarray
    """uint32: number of the triangle in its mesh; `NO_HIT` where there is none."""
    mesh: np.ndarray
    """uint32: number of the mesh; `NO_HIT` where there is none."""
    uv: np.ndarray
    """float32 ``[..., 2]``: weights of the triangle's second and third vertex; 0 where there is none."""


@dataclass(frozen=True, eq=False)
class HitList:
    """All hits of rays, ray after ray; those of a ray by their t, the closest first, and at the same t by mesh and
    triangle."""

    starts: np.ndarray
    """int64 ``[rays + 1]``: the hits of ray i are ``starts[i]`` to ``starts[i + 1]``."""
    t: np.ndarray
    """float32 ``[hits]``: distance in lengths of the direction."""
    triangle: np.ndarray
    """uint32 ``[hits]``: number of the triangle in its mesh."""
    mesh: np.ndarray
    """uint32 ``[hits]``: number of the mesh."""
    uv: np.ndarray
    """float32 ``[hits, 2]``: weights of the triangle's second and third vertex."""

    @property
    def ray(self) -> np.ndarray:
        """int64 ``[hits]``: number of the ray, counted over all leading dimensions."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    def __len__(self) -> int:
        return len(self.t)
