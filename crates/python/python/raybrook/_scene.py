"""Scenes: meshes with what traces them."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from . import _arrays, _raybrook
from ._errors import NoteWarning, warn
from ._hits import NO_HIT, ClosestPoints, HitList, Hits
from ._picture import Picture
from ._view import vector, view_of

Progress = Callable[[float], object]

_DEVICE_VARIABLE = "RAYBROOK_DEVICE"
_told: set[str] = set()


class Device(NamedTuple):
    """An OpenCL device of this computer."""

    name: str
    """Its name; a part of it is enough for ``Scene(device=...)``."""
    platform: str
    """The driver's name."""
    kind: str
    """gpu, cpu or another word of OpenCL's."""
    unusable: str | None
    """Why raybrook cannot use it; None for a device that it can use."""


def devices() -> list[Device]:
    """The OpenCL devices of this computer. The place of a device is its number for ``Scene(device=...)``."""
    _prepare()
    return [Device(*device) for device in _raybrook.devices()]


def _prepare() -> None:
    """Has PoCL keep each of its threads on a core of its own, as the command line does, unless the user has said how
    its threads are to run: Linux often wakes two of them on one core, which halves the speed of short calls."""
    if not any(name in os.environ for name in ("POCL_AFFINITY", "POCL_MAX_PTHREAD_COUNT")):
        os.environ["POCL_AFFINITY"] = "1"


def _tell_once(notes: list[str]) -> None:
    for note in notes:
        if note not in _told:
            _told.add(note)
            warn(note, NoteWarning)


class Scene:
    """Triangle meshes, ready for rays, points and pictures.

    With float32 numbers every answer is exact: which triangles a ray hits, and which of them is the closest, is what
    exact arithmetic says, and t, u and v are the exact values, rounded once. Other numbers are rounded to float32
    first; a `RoundingWarning` tells how many and by how much.

    The device is opened and the structure built by the first question. A scene may be used by several threads, which
    take turns, and it may be pickled.

    Args:
        vertices: ``[n, 3]``, world units. None: a scene without a mesh, for `add_mesh`.
        faces: integers ``[m, 3]``; row i is triangle i.
        transform: ``[4, 4]`` or ``[3, 4]``, from the mesh to the world, applied in float64.
        origin: a place, float64, from which the scene's float32 numbers count, or ``auto``: a round place among the
            vertices of the first mesh. For coordinates far from 0, as surveys have them, of which float32 would lose
            much. Vertices, rays, points and answers are in the caller's coordinates as ever, but places in answers are
            float64.
        device: ``gpu``, ``cpu``, ``reference`` (scalar code on all cores, without OpenCL), a number of `devices` or a
            part of a name. Several, as in ``0,2``, ``gpu+cpu`` or ``all``, share large batches and pictures. None:
            ``$RAYBROOK_DEVICE``, else the fastest.
        method: structure and more, as ``--method`` of the command line, such as ``bvh8``. None: the fastest.
        precision: ``exact``, which is the default, or ``fast``, which loses some hits at edges.
        memory_limit: the most bytes that the process may take. None: nine tenths of what is left.
        cache: whether compiled kernels are kept on disk.
        fall_back: whether the reference goes on where the device fails in the middle of the work, with the same
            answers, many times as slowly; a `NoteWarning` tells of it. False: `DeviceError`.

    Raises:
        InputError: a vertex is not finite, or a face names a vertex that is not there.
        OptionError, DeviceError: by the first question, when a choice cannot be used.
    """

    def __init__(
        self,
        vertices: Any = None,
        faces: Any = None,
        *,
        transform: Any = None,
        origin: Any = None,
        device: str | int | None = None,
        method: str | None = None,
        precision: str | None = None,
        memory_limit: int | None = None,
        cache: bool = True,
        fall_back: bool = False,
    ) -> None:
        self._choices = dict(
            device=device,
            method=method,
            precision=precision,
            memory_limit=memory_limit,
            cache=cache,
            fall_back=fall_back,
        )
        self._meshes: list[tuple[np.ndarray, np.ndarray]] = []
        is_place = origin is not None and not isinstance(origin, str)
        self._origin: tuple[float, float, float] | str | None = vector("origin", origin) if is_place else origin
        if isinstance(self._origin, str) and self._origin != "auto":
            raise ValueError(f"origin: '{origin}' is neither a place nor 'auto'")
        self._is_strict = True
        self._path: str | None = None
        self._core: _raybrook.Core | None = None
        self._corners: np.ndarray | None = None
        self._is_open = False
        self._lock = threading.RLock()
        if vertices is not None or faces is not None:
            self._add(vertices, faces, transform)
            self._get()  # what is wrong with the mesh is told here

    @classmethod
    def load(cls, path: str | os.PathLike[str], **choices: Any) -> Scene:
        """The scene of a file: ``.obj``, ``.ply``, ``.stl``, ``.gltf``, ``.glb``, ``.off``, ``.3mf``,
        ``.nff`` or a ``.toml`` scene file, as one mesh.

        Args:
            path: where it is.
            choices: device, method, precision, memory_limit, cache and fall_back, as of `Scene`.

        Raises:
            InputError: the file is missing, or cannot be used; the message names file and line.
        """
        scene = cls(**choices)
        if scene._origin is not None:
            raise TypeError("a scene from a file counts from 0: it takes no origin")
        scene._path = os.path.abspath(os.fspath(path))
        faults = scene._get().warnings
        more = f" (and {len(faults) - 1} more: Scene.warnings)" if len(faults) > 1 else ""
        if faults:
            warn(faults[0] + more, NoteWarning)
        return scene

    def add_mesh(self, vertices: Any, faces: Any, transform: Any = None) -> int:
        """Add a mesh, and tell its number. The same arrays may be added many times, by different transforms.

        Args:
            vertices, faces, transform: as of `Scene`.
        """
        return self._add(vertices, faces, transform)

    def _add(self, vertices: Any, faces: Any, transform: Any) -> int:
        if self._path is not None:
            raise TypeError("a scene from a file takes no more meshes")
        if vertices is None or faces is None:
            raise TypeError("a mesh needs vertices and faces")
        with self._lock:
            # What is added later does not change what the caller's arrays say now.
            self._meshes.append((self._positions(vertices, transform), _arrays.indices("faces", faces).copy()))
            self._core = self._corners = None
            self._is_open = False
            return len(self._meshes) - 1

    def update_vertices(self, vertices: Any, mesh: int = 0, transform: Any = None) -> None:
        """Move the vertices of a mesh; its faces stay. Answers are those of a new scene, to the bit, in less time:
        device and kernels stay, and the structure is refitted while that is faster than building it.

        Args:
            vertices: ``[n, 3]``, as many as the mesh has.
            mesh: its number.
            transform: as of `Scene`.

        Raises:
            InputError: a vertex is not finite; the scene stays as it was.
        """
        if self._path is not None:
            raise TypeError("the vertices of a scene from a file stay where they are")
        with self._lock:
            if not 0 <= mesh < len(self._meshes):
                raise ValueError(f"mesh: there is no mesh {mesh}: the scene has {len(self._meshes)}")
            positions, meshes = self._positions(vertices, transform), list(self._meshes)
            before, faces = meshes[mesh]
            if len(positions) != len(before):
                raise ValueError(f"vertices: the mesh has {len(before)}, and {len(positions)} are given")
            meshes[mesh] = (positions, faces)
            if self._core is not None:
                self._core = self._core.moved(meshes, self._is_strict)
            self._meshes, self._corners = meshes, None

    def _positions(self, vertices: Any, transform: Any) -> np.ndarray:
        """A copy of vertices in the world, from the scene's origin on."""
        given = _arrays.as_array("vertices", vertices)
        if transform is not None:
            given = _moved(given, np.asarray(transform, dtype=np.float64))
        if given.size == 0:
            return np.zeros((0, 3), np.float32)
        if given.ndim != 2 or given.shape[1] != 3:
            raise ValueError(f"vertices: the shape must be (n, 3), but is {given.shape}")
        if self._origin == "auto":
            x, y, z = _raybrook.origin_around(_arrays.plain(given, np.float64))
            self._origin = (x, y, z)
        [positions] = _arrays.float32("vertices", given, origins=[self._from])
        return positions.copy()

    @property
    def origin(self) -> np.ndarray:
        """Where the scene's float32 numbers count from, float64 ``[3]``."""
        return np.array(self._from)

    @property
    def _from(self) -> tuple[float, float, float]:
        return _arrays.NO_ORIGIN if self._origin is None or isinstance(self._origin, str) else self._origin

    def _in_world(self, places: np.ndarray) -> np.ndarray:
        """Places of the scene in the caller's coordinates."""
        return places if self._origin is None else places + np.array(self._from)

    def _get(self) -> _raybrook.Core:
        with self._lock:
            if self._core is None:
                choices = self._given_choices()
                if self._path is not None:
                    self._core = _raybrook.Core.load(self._path, choices)
                else:
                    self._core = _raybrook.Core(self._meshes, self._is_strict, choices)
            return self._core

    def _given_choices(self) -> tuple[Any, ...]:
        choices = self._choices
        device = choices["device"]
        if device is None:
            device = os.environ.get(_DEVICE_VARIABLE) or None
        else:
            device = str(device)
        others = ("method", "precision", "memory_limit", "cache", "fall_back")
        return (device, *(choices[name] for name in others))

    def _opened(self) -> _raybrook.Core:
        """What answers questions; notes on its device are given once."""
        core = self._get()
        if not self._is_open:
            _prepare()
            notes = core.open()[2]
            self._is_open = True
            _tell_once(notes)
        return core

    def closest_hits(
        self, rays: Any, *, t_min: float = 0.0, t_max: float = math.inf, progress: Progress | None = None
    ) -> Hits:
        """The closest hit of each ray.

        Triangles are hit from both sides, and edges and vertices belong to them; of two at the same t the one of the
        lower mesh, or the lower number, is the hit. A ray with a number that is NaN or infinite, or without a
        direction, hits nothing.

        Args:
            rays: ``[..., 6]``: origin and direction; or ``[..., 8]``: t_min and t_max, too; or a pair
                ``(origins, directions)`` of ``[..., 3]`` each, which are broadcast.
            t_min, t_max: what is nearer or farther does not count; in lengths of the direction, both included.
            progress: called from time to time with the part that is done, 0 to 1. What it raises stops the call.
        """
        t, uv, triangle, mesh, _ = self._closest(rays, t_min, t_max, False, progress)
        return Hits(t, triangle, mesh, uv)

    def _closest(
        self, rays: Any, t_min: float, t_max: float, normals: bool, progress: Progress | None
    ) -> tuple[np.ndarray, ...]:
        given, shape = _arrays.rays(rays, t_min, t_max, self._from)
        t, uv, triangle, mesh, normal = self._opened().closest_hits(given, normals, progress)
        of_shape = (array.reshape(shape) for array in (triangle, mesh))
        normal = normal.reshape(*shape, 3) if normals else normal
        return t.reshape(shape), uv.reshape(*shape, 2), *of_shape, normal

    def any_hit(
        self, rays: Any, *, t_min: float = 0.0, t_max: float = math.inf, progress: Progress | None = None
    ) -> np.ndarray:
        """Whether each ray hits anything, bool: faster than `closest_hits`, whose arguments it has."""
        given, shape = _arrays.rays(rays, t_min, t_max, self._from)
        return self._opened().any_hit(given, progress).reshape(shape)

    def count(
        self, rays: Any, *, t_min: float = 0.0, t_max: float = math.inf, progress: Progress | None = None
    ) -> np.ndarray:
        """How many triangles each ray hits, uint32; an edge or a vertex belongs to all triangles around it.

        Arguments: those of `closest_hits`.
        """
        given, shape = _arrays.rays(rays, t_min, t_max, self._from)
        return self._opened().count(given, False, progress).reshape(shape)

    def count_crossings(
        self, rays: Any, *, t_min: float = 0.0, t_max: float = math.inf, progress: Progress | None = None
    ) -> np.ndarray:
        """How often each ray crosses a surface, uint32: through an edge or a vertex once, and not at all where it only
        touches one.

        Arguments: those of `closest_hits`.
        """
        given, shape = _arrays.rays(rays, t_min, t_max, self._from)
        return self._opened().count_crossings(given, progress).reshape(shape)

    def list_hits(
        self,
        rays: Any,
        *,
        most: int | None = None,
        merge: bool = False,
        t_min: float = 0.0,
        t_max: float = math.inf,
        progress: Progress | None = None,
    ) -> HitList:
        """All hits of each ray, the closest first.

        Args:
            most: no more than so many of each ray, the closest.
            merge: where several triangles of a mesh are hit at exactly the same t, as at an edge, list the first one
                only.

        Further arguments: those of `closest_hits`.
        """
        if most is not None and most < 0:
            raise ValueError(f"most: {most} is below 0")
        given, _ = _arrays.rays(rays, t_min, t_max, self._from)
        starts, t, uv, triangle, mesh = self._opened().list_hits(given, most, merge, progress)
        return HitList(starts, t, triangle, mesh, uv.reshape(-1, 2))

    def contains(self, points: Any, *, progress: Progress | None = None) -> np.ndarray:
        """Whether each point is inside of the scene or exactly on its surface, bool.

        Where closed meshes overlap, what is inside of two of them is outside.

        Args:
            points: ``[..., 3]``.
            progress: as of `closest_hits`.

        Raises:
            InputError: the scene is not closed: an edge is in an odd number of triangles.
        """
        given, shape = _arrays.points("points", points, self._from)
        return self._opened().contains(given, progress).reshape(shape)

    def closest_point(self, points: Any, *, progress: Progress | None = None) -> ClosestPoints:
        """The closest point of the scene to each point: exact, each number rounded once.

        Of several triangles that are as near the one of the lower mesh, or the lower number, is told. There is no
        closest point to one with a number that is NaN or infinite, and none in a scene without triangles.

        Args:
            points: ``[..., 3]``.
            progress: as of `closest_hits`.
        """
        return self._closest_point(points, False, progress)[0]

    def _closest_point(self, points: Any, normals: bool, progress: Progress | None) -> tuple[ClosestPoints, np.ndarray]:
        given, shape = _arrays.points("points", points, self._from)
        point, distance, triangle, mesh, uv, normal = self._opened().closest_points(given, normals, progress)
        distance, triangle, mesh = (array.reshape(shape) for array in (distance, triangle, mesh))
        place = self._in_world(point.reshape(*shape, 3))
        found = ClosestPoints(place, distance, triangle, mesh, uv.reshape(*shape, 2))
        return found, normal.reshape(*shape, 3) if normals else normal

    def distance(self, points: Any, *, progress: Progress | None = None) -> np.ndarray:
        """The distance of the scene from each point, float32: the exact one, rounded once.

        NaN for a point with a number that is NaN or infinite; infinity in a scene without triangles.

        Arguments: those of `closest_point`.
        """
        given, shape = _arrays.points("points", points, self._from)
        return self._opened().distances(given, progress).reshape(shape)

    def signed_distance(self, points: Any, *, progress: Progress | None = None) -> np.ndarray:
        """As `distance`, but negative inside of the scene. Number and sign are exact; 0 exactly on the surface.

        Arguments: those of `closest_point`.

        Raises:
            InputError: the scene is not closed: an edge is in an odd number of triangles.
        """
        given, shape = _arrays.points("points", points, self._from)
        return self._opened().signed_distances(given, progress).reshape(shape)

    def winding_number(self, points: Any, *, progress: Progress | None = None) -> np.ndarray:
        """How often the scene winds around each point, float64: 1 inside of a closed mesh whose triangles are turned
        outwards, 0 outside, and between them near the holes of an open one. So 0.5 tells inside from outside where
        `contains` refuses to.

        The exact number up to float64's rounding. NaN for a point with a number that is NaN or infinite.

        Arguments: those of `closest_point`.
        """
        given, shape = _arrays.points("points", points, self._from)
        return self._opened().winding_numbers(given, progress).reshape(shape)

    def points(self, hits: Hits | HitList | ClosestPoints) -> np.ndarray:
        """Where hits of this scene are: float64 ``[..., 3]``, from u, v and the triangles' vertices, which is more
        exact than from t. NaN for misses."""
        core = self._get()
        with self._lock:
            if self._corners is None:
                self._corners = core.corners().reshape(-1, 3, 3)
            corners = self._corners
        is_hit = hits.triangle != NO_HIT
        corners = corners[(self._first_triangles()[hits.mesh[is_hit]] + hits.triangle[is_hit])].astype(np.float64)
        v = hits.uv[is_hit].astype(np.float64)
        found = corners[:, 0] + v[:, :1] * (corners[:, 1] - corners[:, 0]) + v[:, 1:] * (corners[:, 2] - corners[:, 0])
        points = np.full((*hits.triangle.shape, 3), math.nan)
        points[is_hit] = found
        return self._in_world(points)

    def _first_triangles(self) -> np.ndarray:
        counts = [len(faces) for _, faces in self._meshes[:-1]]
        return np.cumsum([0, *counts], dtype=np.int64)

    def render(
        self,
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
        layers: Sequence[str] = (),
        progress: Progress | None = None,
    ) -> Picture:
        """A picture: Whitted shading with shadows, mirrors, glass and textures.

        A scene without lights is lit as in a studio, from above the left shoulder of the camera.

        Args:
            width, height: pixels. None: what the scene's file says, else 1024 x 768.
            eye, target, up, fov: where the camera is, where it looks, what is up (``"y"``, ``"-z"`` or a direction),
                and its vertical angle in degrees. None: as the file's camera has it, else one that shows the whole
                scene, or a room from inside, with z upwards in .stl and .3mf files, and in others where the program
                that wrote the file, or the model's shape, says so for sure; else y.
            view: a camera that shows everything from ``"front"``, ``"back"``, ``"left"``, ``"right"``, ``"top"``,
                ``"bottom"`` or ``"iso"``; or one in the middle of the scene: ``"inside"``. Not together with ``eye``
                and ``target``.
            samples: rays through each pixel, instead of ``error``.
            error: the root of the mean square error that the picture may have, in steps of 8-bit sRGB.
            depth: the longest chain of reflected and refracted rays, the camera's ray counted.
            crop: ``(x, y, width, height)``, pixels from the upper left: only this part of the picture, with the bits
                of the whole one. With ``samples`` nothing else is rendered.
            layers: what else to tell of the pixels, as `Picture.layers`: any of ``"depth"``, ``"position"`` (as
                float32, from the scene's origin), ``"normal"``, ``"geometric-normal"``, ``"albedo"``, ``"uv"``,
                ``"primitive"``, ``"object"``, ``"instance"``, ``"material"``, ``"samples"`` and, of pictures by their
                error, ``"error"``.
            progress: as of `closest_hits`.
        """
        given = view_of(
            self._from,
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
            layers=layers,
        )
        return Picture(self._opened().render(given, progress))

    def preview(self) -> Picture:
        """A small and quick picture."""
        return self.render(320, 240, error=4.0)

    def _repr_png_(self) -> bytes:
        return self.preview()._repr_png_()

    @property
    def triangle_count(self) -> int:
        """How many triangles all meshes have."""
        return self._get().triangle_count

    @property
    def mesh_count(self) -> int:
        """How many meshes there are; a scene of a file is one."""
        return len(self._meshes) if self._path is None else 1

    @property
    def bounds(self) -> np.ndarray | None:
        """The smallest box around all triangles that can be hit, float32 ``[2, 3]``, float64 if the scene has an
        origin; None where there is none."""
        bounds = self._get().bounds()
        return None if bounds is None else self._in_world(np.array(bounds, dtype=np.float32))

    @property
    def warnings(self) -> list[str]:
        """What was repaired, ignored or left out of the file, a sentence each."""
        return self._get().warnings

    @property
    def device(self) -> str:
        """The name of the device that answers, of several all names; ``reference`` without OpenCL."""
        return self._opened().open()[0]

    @property
    def choices(self) -> list[str]:
        """What was chosen and why, a line each."""
        return self._opened().open()[1]

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._path, self._meshes, self._is_strict, self._choices, self._origin)

    def __repr__(self) -> str:
        return f"<raybrook.Scene of {self.mesh_count} meshes, {self.triangle_count} triangles>"


def _restored(path: str | None, meshes: list[Any], is_strict: bool, choices: dict[str, Any], origin: Any) -> Scene:
    """A scene that was pickled: by its arrays, or by the path of its file."""
    scene = Scene(**choices, origin=origin)
    scene._path, scene._is_strict = path, is_strict
    scene._meshes = [(_arrays.plain(v, np.float32), _arrays.plain(f, np.uint32)) for v, f in meshes]
    return scene


def _moved(vertices: np.ndarray, transform: np.ndarray) -> np.ndarray:
    if transform.shape not in ((4, 4), (3, 4)):
        raise ValueError(f"transform: the shape must be (4, 4) or (3, 4), but is {transform.shape}")
    if transform.shape[0] == 4 and not np.array_equal(transform[3], (0.0, 0.0, 0.0, 1.0)):
        raise ValueError("transform: the last row must be 0, 0, 0, 1")
    if not np.isfinite(transform).all():
        raise ValueError("transform: a number is not finite")
    # Written out: which products are fused, and in what order they are added, does not depend on a BLAS.
    x, y, z = np.moveaxis(_arrays.with_last("vertices", vertices, (3,)).astype(np.float64), -1, 0)
    return np.stack([row[0] * x + row[1] * y + row[2] * z + row[3] for row in transform[:3]], axis=-1)
