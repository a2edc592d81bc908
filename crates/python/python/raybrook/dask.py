"""Rays, points and pictures on many machines, by Dask: answers are lazy arrays of Dask, with the bits of one machine.

>>> import raybrook, raybrook.dask
>>> scene = raybrook.Scene.load("vase.obj")
>>> hits = raybrook.dask.trace(scene, rays)                  # nothing is computed yet
>>> t, triangle = dask.compute(hits.t, hits.triangle)        # on threads, processes or a cluster, as Dask is set up
>>> picture = raybrook.dask.render(scene, 8192, 6144, error=0.5).compute()

Each process opens the device and builds the structure of a scene once, however many tasks and calls it takes part in;
it keeps the last two scenes. A scene of arrays is sent as they are, a scene of a file by the file's path: it must be
there on every machine, and be the same. Scenes are taken as they are when a function is called: what is added or moved
later changes no answer.

Needs Dask: ``pip install 'raybrook[dask]'``.
"""

from __future__ import annotations

import hashlib
import math
import threading
from collections import OrderedDict
from copy import copy
from importlib import import_module
from typing import Any

import numpy as np

from . import _arrays
from ._errors import InputError
from ._hits import ClosestPoints, Hits
from ._raybrook import __version__
from ._scene import Scene
from ._view import View, view_of

__all__ = ["query", "render", "trace"]

try:
    # Its types say little, and it need not be installed where ours are checked.
    da: Any = import_module("dask.array")
    delayed: Any = import_module("dask").delayed
except ImportError as failure:
    raise ImportError("raybrook.dask needs Dask's arrays: pip install 'raybrook[dask]'") from failure

# Rays or points of a task where Dask has not cut them: enough to fill a device, and a second or two of a processor's.
_ROWS_PER_TASK = 1 << 20
# Scenes that a process keeps after their tasks are done.
_KEPT_SCENES = 2

_HIT = np.dtype([("t", "f4"), ("triangle", "u4"), ("mesh", "u4"), ("uv", "f4", (2,))])
_NUMBERS_OF_RAYS = {"any_hit": np.dtype(bool), "count": np.dtype("u4"), "count_crossings": np.dtype("u4")}
_NUMBERS_OF_POINTS = {
    "contains": np.dtype(bool),
    "distance": np.dtype("f4"),
    "signed_distance": np.dtype("f4"),
    "winding_number": np.dtype("f8"),
}


class _SharedScene:
    """A scene that tasks use; in another process the one that this process has kept."""

    def __init__(self, scene: Scene, key: str, digest: str, version: str) -> None:
        self.scene, self.key, self.digest, self.version = scene, key, digest, version
        self._is_checked = False
        self._lock = threading.Lock()

    def get(self) -> Scene:
        """The scene, if it is what was sent."""
        with self._lock:
            if not self._is_checked:
                self._check()
                self._is_checked = True
        return self.scene

    def _check(self) -> None:
        if self.version != __version__:
            text = (
                f"this worker has raybrook {__version__}, and the scene comes from {self.version}: install one version"
            )
            raise InputError(text)
        if self.scene._path is not None and self.scene._get().digest() != self.digest:
            text = (
                f"{self.scene._path}: this worker's file differs from the one that the scene was loaded from; copy it"
            )
            raise InputError(text)

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (self.scene, self.key, self.digest, self.version)

    def __dask_tokenize__(self) -> str:
        return self.key


_kept: OrderedDict[str, _SharedScene] = OrderedDict()
_kept_lock = threading.Lock()


def _received(scene: Scene, key: str, digest: str, version: str) -> _SharedScene:
    """The scene of this process with that key."""
    with _kept_lock:
        kept = _kept.setdefault(key, _SharedScene(scene, key, digest, version))
        _kept.move_to_end(key)
        while len(_kept) > _KEPT_SCENES:
            _kept.popitem(last=False)
    return kept


def _shared(scene: Scene) -> Any:
    """A scene as it is now, as a node of graphs: tasks refer to it, and do not hold it."""
    if not isinstance(scene, Scene):
        raise TypeError(f"scene: a raybrook.Scene is needed, not {type(scene).__name__}")
    with scene._lock:
        core, now = scene._get(), copy(scene)
    # With what traces it, which stays as it is when the scene moves on.
    now._core = core
    faces = [len(faces) for _, faces in now._meshes]
    named = (core.digest(), faces, now._choices, now._origin, now._is_strict, now._path)
    key = hashlib.sha256(repr(named).encode()).hexdigest()[:32]
    shared = _received(now, key, core.digest(), __version__)
    return delayed(shared, name=f"raybrook-scene-{key}", traverse=False)


def _blocked(name: str, value: Any, last: tuple[int, ...]) -> Any:
    """``value`` as an array of Dask whose chunks have whole rows."""
    if isinstance(value, da.Array):
        _arrays.with_last(name, value, last)
        return value.rechunk({-1: -1})
    array = _arrays.with_last(name, _arrays.as_array(name, value), last)
    limit = _ROWS_PER_TASK * array.shape[-1] * array.itemsize
    wanted = ("auto",) * (array.ndim - 1) + (-1,)
    return da.from_array(array, chunks=da.core.normalize_chunks(wanted, array.shape, limit=limit, dtype=array.dtype))


def _rays(value: Any) -> Any:
    if not _arrays.is_pair(value):
        return _blocked("rays", value, (6, 8))
    both = [_blocked(name, part, (3,)) for name, part in zip(("origins", "directions"), value)]
    return da.concatenate(da.broadcast_arrays(*both), axis=-1).rechunk({-1: -1})


def _asked(answer: Any, scene: Scene, rows: Any, dtype: np.dtype[Any], question: str, **limits: float) -> Any:
    """What ``answer`` tells of each row."""
    return da.map_blocks(
        answer,
        rows,
        shared=_shared(scene),
        question=question,
        **limits,
        token=f"raybrook-{question}",
        drop_axis=rows.ndim - 1,
        dtype=dtype,
        meta=np.empty((0,) * (rows.ndim - 1), dtype),
    )


def _numbers(rows: np.ndarray, shared: _SharedScene, question: str, **limits: float) -> np.ndarray:
    """A task: one number for each ray or point."""
    numbers: np.ndarray = getattr(shared.get(), question)(rows, **limits)
    return numbers


def _places(rows: np.ndarray, shared: _SharedScene, question: str, **limits: float) -> np.ndarray:
    """A task: several numbers for each ray or point, as one array of structures."""
    found = getattr(shared.get(), question)(rows, **limits)
    dtype = np.dtype([(name, array.dtype, array.shape[rows.ndim - 1 :]) for name, array in vars(found).items()])
    packed = np.empty(rows.shape[:-1], dtype)
    for name, array in vars(found).items():
        packed[name] = array
    return packed


def _refuse(question: str, possible: list[str]) -> ValueError:
    return ValueError(f"question: '{question}' is none of {', '.join(possible)}")


def trace(
    scene: Scene, rays: Any, question: str = "closest_hits", *, t_min: float = 0.0, t_max: float = math.inf
) -> Any:
    """What rays hit, as a method of `raybrook.Scene` tells it, lazily.

    Each chunk of the rays is a task. Numbers that are no float32 numbers are rounded by the tasks, which warn where
    they run.

    Args:
        scene: the scene.
        rays: as the method takes them. Arrays of Dask keep their chunks, apart from the last dimension, which becomes
            one; others are cut into chunks of about a million rays.
        question: ``closest_hits``, ``any_hit``, ``count`` or ``count_crossings``.
        t_min, t_max: as of the method.

    Returns:
        `raybrook.Hits` of arrays of Dask, or one array. Arrays that are computed by one call of ``dask.compute`` are
        traced once.

    Raises:
        What the method raises comes when the answer is computed, from the worker.
    """
    if question not in ("closest_hits", *_NUMBERS_OF_RAYS):
        raise _refuse(question, ["closest_hits", *_NUMBERS_OF_RAYS])
    rows, limits = _rays(rays), {"t_min": float(t_min), "t_max": float(t_max)}
    if question in _NUMBERS_OF_RAYS:
        return _asked(_numbers, scene, rows, _NUMBERS_OF_RAYS[question], question, **limits)
    found = _asked(_places, scene, rows, _HIT, question, **limits)
    return Hits(**{name: found[name] for name in _HIT.names or ()})


def query(scene: Scene, points: Any, question: str = "closest_point") -> Any:
    """How far away points are, or whether they are inside, as a method of `raybrook.Scene` tells it, lazily.

    Args:
        scene: the scene.
        points: ``[..., 3]``; chunks as those of the rays of `trace`.
        question: ``closest_point``, ``distance``, ``signed_distance``, ``winding_number`` or ``contains``.

    Returns:
        `raybrook.ClosestPoints` of arrays of Dask, or one array.
    """
    if question not in ("closest_point", *_NUMBERS_OF_POINTS):
        raise _refuse(question, ["closest_point", *_NUMBERS_OF_POINTS])
    rows = _blocked("points", points, (3,))
    if question in _NUMBERS_OF_POINTS:
        return _asked(_numbers, scene, rows, _NUMBERS_OF_POINTS[question], question)
    place = "f4" if scene._origin is None else "f8"
    others = [("distance", "f4"), ("triangle", "u4"), ("mesh", "u4"), ("uv", "f4", (2,))]
    dtype = np.dtype([("point", place, (3,)), *others])
    found = _asked(_places, scene, rows, dtype, question)
    return ClosestPoints(**{name: found[name] for name in dtype.names or ()})


def render(
    scene: Scene,
    width: int | None = None,
    height: int | None = None,
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
    tasks: int = 64,
) -> Any:
    """The pixels of a picture, lazily: float32 ``[height, width, 3]``, linear light, with the bits of
    ``scene.render(...).pixels``. `raybrook.Picture.from_pixels` makes a picture of them when they are computed.

    The picture is cut into blocks of about 131,072 pixels, or of fewer that have many samples. With ``samples`` they
    are bands of rows, and so are the chunks of the array. With an error a chunk is an area of about 2048 x 2048 pixels,
    whose blocks are strewn over all of it: one task renders them where there are enough areas, else several do and one
    puts them together.

    Args:
        scene: the scene.
        tasks: about how many tasks are to render it: some for each worker, so that all end together. A picture of few
            blocks has fewer.

    Further arguments: those of `raybrook.Scene.render`.
    """
    if tasks < 1:
        raise ValueError(f"tasks: {tasks} is below 1")
    given = view_of(
        scene._from,
        width,
        height,
        eye=eye,
        target=target,
        up=up,
        fov=fov,
        view=view,
        samples=samples,
        error=error,
        depth=depth,
        crop=crop,
    )
    shared = _shared(scene)
    regions = scene._get().regions(given)
    if all(place[0] == 0 for place, _ in regions):
        regions = _joined(regions, max(len(regions) // tasks, 1))
    per_region = max(math.ceil(tasks / len(regions)), 1)
    chunks = [_chunk(shared, given, place, numbers, per_region) for place, numbers in regions]
    across = sum(place[1] == 0 for place, _ in regions)
    rows = (chunks[first : first + across] for first in range(0, len(chunks), across))
    return da.block([[[chunk] for chunk in row] for row in rows])


_Region = tuple[tuple[int, int, int, int], list[int]]


def _joined(regions: list[_Region], count: int) -> list[_Region]:
    """Regions below each other, so many as one."""

    def one(some: list[_Region]) -> _Region:
        (x, y, width, _), _ = some[0]
        height = sum(place[3] for place, _ in some)
        return (x, y, width, height), [number for _, numbers in some for number in numbers]

    return [one(regions[first : first + count]) for first in range(0, len(regions), count)]


def _chunk(shared: Any, view: View, place: tuple[int, int, int, int], numbers: list[int], parts: int) -> Any:
    """A region of a picture as an array of one chunk, rendered in so many parts, if it has as many blocks."""
    size = math.ceil(len(numbers) / min(parts, len(numbers)))
    pieces = [numbers[first : first + size] for first in range(0, len(numbers), size)]
    blocks = [delayed(_render_blocks, pure=True)(shared, view, piece) for piece in pieces]
    pixels = delayed(_put_together, pure=True)(place, *blocks)
    return da.from_delayed(pixels, (place[3], place[2], 3), dtype=np.float32)


_Blocks = tuple[np.ndarray, np.ndarray]


def _render_blocks(shared: _SharedScene, view: View, numbers: list[int]) -> _Blocks:
    """A task: the pixels of blocks, and their places."""
    return shared.get()._opened().render_blocks(view, numbers, None)


def _put_together(place: tuple[int, int, int, int], *blocks: _Blocks) -> np.ndarray:
    """A task: the pixels of a region."""
    left, top, width, height = place
    region = np.empty((height, width, 3), np.float32)
    for pixels, places in blocks:
        first = 0
        for x, y, columns, rows in places.reshape(-1, 4).tolist():
            end = first + 3 * columns * rows
            part = pixels[first:end].reshape(rows, columns, 3)
            region[y - top : y - top + rows, x - left : x - left + columns] = part
            first = end
    return region
