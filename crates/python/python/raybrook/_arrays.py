"""Arrays as the module in Rust takes them: float32 and contiguous. Everything that is rounded is rounded here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, Optional

import numpy as np

from . import _raybrook
from ._errors import RoundingWarning, warn

_DLPACK_CPU = (1, 3)  # kDLCPU and kDLCUDAHost: memory that the processor reads


def as_array(name: str, value: Any) -> np.ndarray:
    """``value`` as an array, without a copy where its memory is the processor's: NumPy, DLPack, buffers, lists."""
    if not isinstance(value, np.ndarray) and hasattr(value, "__dlpack__") and hasattr(value, "__dlpack_device__"):
        if value.__dlpack_device__()[0] not in _DLPACK_CPU:
            raise TypeError(f"{name}: the array is not in the processor's memory; copy it there, as by .cpu()")
        if getattr(value, "requires_grad", False):
            value = value.detach()
        return np.from_dlpack(value)
    return np.asarray(value)


NO_ORIGIN = (0.0, 0.0, 0.0)


def plain(array: np.ndarray, dtype: Any) -> np.ndarray:
    """``array`` in rows without gaps, at an address that the processor likes: not all are that other libraries sent."""
    return np.require(array, dtype, ("C_CONTIGUOUS", "ALIGNED"))


def float32(name: str, *values: Any, origins: Sequence[Sequence[float]] = ()) -> list[np.ndarray]:
    """``values`` as contiguous float32 numbers. What is rounded is told by one `RoundingWarning`.

    Of a value that has one of ``origins`` which is not 0 the first three of the last dimension count from there."""
    arrays, total, changed, largest = [], 0, 0, 0.0
    for value, origin in zip_longest(values, origins[: len(values)], fillvalue=NO_ORIGIN):
        array = as_array(name, value)
        if array.dtype.kind not in "fiub":
            raise TypeError(f"{name}: numbers are needed, not {array.dtype}")
        total += array.size
        if _is_exact(array.dtype) and not any(origin):
            arrays.append(plain(array, np.float32))
            continue
        flat = plain(array, np.float64).reshape(-1)
        width = max(array.shape[-1], 1) if any(origin) else 3
        rounded, of_array, by = _raybrook.round_to_float32(flat, width, origin)
        arrays.append(rounded.reshape(array.shape))
        changed, largest = changed + of_array, max(largest, by)
    if changed:
        text = f"{name}: {changed} of {total} numbers are no float32 numbers and were rounded, by at most {largest:.3g}"
        warn(text, RoundingWarning)
    return arrays


def _is_exact(dtype: np.dtype[Any]) -> bool:
    """Whether all numbers of a type are float32 numbers."""
    return dtype.itemsize <= (4 if dtype.kind == "f" else 2)


def with_last(name: str, array: np.ndarray, last: tuple[int, ...]) -> np.ndarray:
    """``array``, if its last dimension is one of ``last``."""
    if array.ndim == 0 or array.shape[-1] not in last:
        needed = " or ".join(map(str, last))
        raise ValueError(f"{name}: the last dimension must be {needed}, but the shape is {array.shape}")
    return array


def rows(array: np.ndarray) -> np.ndarray:
    """``array`` with its leading dimensions made one."""
    return array.reshape(math.prod(array.shape[:-1]), array.shape[-1])


def points(name: str, value: Any, origin: Sequence[float]) -> tuple[np.ndarray, tuple[int, ...]]:
    """Points as rows, from ``origin`` on, and their leading shape."""
    [array] = float32(name, with_last(name, as_array(name, value), (3,)), origins=[origin])
    return rows(array), array.shape[:-1]


GivenRays = tuple[np.ndarray, Optional[np.ndarray], tuple[float, float]]


def is_pair(value: Any) -> bool:
    """Whether rays are given as origins and directions."""
    return isinstance(value, tuple) and len(value) == 2 and np.shape(value[1])[-1:] == (3,)


def rays(value: Any, t_min: float, t_max: float, origin: Sequence[float]) -> tuple[GivenRays, tuple[int, ...]]:
    """Rays as the module in Rust takes them, from ``origin`` on, and their leading shape."""
    limits = (float(t_min), float(t_max))
    if is_pair(value):
        starts = with_last("origins", as_array("origins", value[0]), (3,))
        origins, directions = float32("rays", starts, value[1], origins=[origin])
        try:
            origins, directions = np.broadcast_arrays(origins, directions)
        except ValueError:
            text = (
                f"rays: origins of shape {origins.shape} and directions of shape {directions.shape} do not go together"
            )
            raise ValueError(text) from None
        given = (rows(plain(origins, np.float32)), rows(plain(directions, np.float32)), limits)
        return given, origins.shape[:-1]
    [array] = float32("rays", with_last("rays", as_array("rays", value), (6, 8)), origins=[origin])
    if array.shape[-1] == 8 and limits != (0.0, math.inf):
        raise ValueError("rays: t_min and t_max are given twice, by the rays' last two numbers and by name")
    return (rows(array), None, limits), array.shape[:-1]


def indices(name: str, value: Any) -> np.ndarray:
    """``value`` as contiguous uint32 numbers [n, 3]."""
    array = as_array(name, value)
    if array.size == 0:
        return np.zeros((0, 3), np.uint32)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name}: integers are needed, not {array.dtype}")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: the shape must be (n, 3), but is {array.shape}")
    if array.dtype.kind == "i" and array.min() < 0 or array.dtype.itemsize > 4 and array.max() > 0xFFFF_FFFF:
        raise ValueError(f"{name}: the numbers of vertices must be from 0 to {0xFFFF_FFFF}")
    return plain(array, np.uint32)
