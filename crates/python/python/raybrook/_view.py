"""What pictures show, as the module in Rust takes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from . import _arrays

View = dict[str, Any]


def view_of(
    origin: tuple[float, float, float],
    width: int | None,
    height: int | None,
    *,
    eye: Any = None,
    target: Any = None,
    up: Any = None,
    fov: float | None = None,
    view: str | None = None,
    samples: int | None = None,
    error: float | None = None,
    depth: int | None = None,
    crop: tuple[int, int, int, int] | None = None,
    layers: Sequence[str] = (),
) -> View:
    """The arguments of `Scene.render`, whose places count from ``origin``."""
    if view is not None and (eye is not None or target is not None):
        raise TypeError("view does not go together with eye and target")
    if samples is not None and error is not None:
        raise TypeError("samples and error do not go together")
    if (width is None) != (height is None):
        raise TypeError("width and height go together")
    return {
        "size": None if width is None else (width, height),
        "eye": None if eye is None else vector("eye", eye, origin),
        "target": None if target is None else vector("target", target, origin),
        "up": None if up is None else _direction("up", up),
        "fov": None if fov is None else float(fov),
        "view": view,
        "samples": samples,
        "error": error,
        "depth": depth,
        "crop": crop,
        "layers": list(layers),
    }


_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _direction(name: str, value: Any) -> tuple[float, float, float]:
    """A vector, or the name of an axis with or without a minus."""
    if not isinstance(value, str):
        return vector(name, value)
    axis = _AXES.get(value.removeprefix("-"))
    if axis is None:
        raise ValueError(f"{name}: '{value}' is no axis; possible: x, y, z, -x, -y, -z, or three numbers")
    return vector(name, [-x for x in axis] if value.startswith("-") else axis)


def vector(name: str, value: Any, origin: tuple[float, float, float] = _arrays.NO_ORIGIN) -> tuple[float, float, float]:
    """Three numbers, from ``origin`` on."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,):
        raise ValueError(f"{name}: the shape must be (3,), but is {array.shape}")
    x, y, z = array - np.array(origin)
    return float(x), float(y), float(z)
