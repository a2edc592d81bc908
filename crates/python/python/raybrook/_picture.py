"""Rendered pictures."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from . import _arrays, _raybrook


class Picture:
    """A rendered picture. A notebook shows it."""

    def __init__(self, picture: _raybrook.Picture) -> None:
        self._picture = picture

    @classmethod
    def from_pixels(cls, pixels: Any) -> Picture:
        """A picture of linear radiance, float32 ``[height, width, 3]``, as `pixels` has it: such as one that was
        rendered on many machines. It has no layers, and nobody counted its rays."""
        [array] = _arrays.float32("pixels", _arrays.with_last("pixels", _arrays.as_array("pixels", pixels), (3,)))
        if array.ndim != 3:
            raise ValueError(f"pixels: the shape must be (height, width, 3), but is {array.shape}")
        height, width, _ = array.shape
        return cls(_raybrook.Picture(width, height, array.reshape(-1)))

    @property
    def width(self) -> int:
        """Pixels a row."""
        return self._picture.width

    @property
    def height(self) -> int:
        """Rows."""
        return self._picture.height

    @property
    def pixels(self) -> np.ndarray:
        """Linear RGB radiance, float32 ``[height, width, 3]``, top row first. A value may be above 1."""
        return self._picture.pixels().reshape(self.height, self.width, 3)

    @property
    def layers(self) -> dict[str, np.ndarray]:
        """The layers that were asked for, by their names: ``[height, width]``, or ``[height, width, channels]`` of
        position (3), normals (3), albedo (3) and uv (2).

        Numbers of primitives (counted through all meshes), objects (the meshes), instances and materials, and samples,
        are uint32, with 2 ** 32 - 1 for what is not there; all else is float32, with infinity for a depth and 0 for
        everything else where nothing is hit. They are of the first hit on the ray through the middle of a pixel, and
        have the same bits on every device.
        """

        def array(planes: list[np.ndarray]) -> np.ndarray:
            shaped = [plane.reshape(self.height, self.width) for plane in planes]
            return shaped[0] if len(shaped) == 1 else np.stack(shaped, axis=-1)

        return {name: array(planes) for name, planes in self._picture.layers()}

    def to_srgb8(self) -> np.ndarray:
        """8-bit sRGB, uint8 ``[height, width, 3]``. There is no tone mapping: what is above 1 becomes 255."""
        return self._picture.srgb8().reshape(self.height, self.width, 3)

    def exposed(self, stops: float) -> Picture:
        """The picture made lighter, or darker by a negative number: all light multiplied by ``2 ** stops``.

        Raises:
            OptionError: unless ``stops`` lies between -100 and 100.
        """
        return Picture(self._picture.exposed(stops))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture, in the format that the ending names: ``.png``, ``.exr`` or ``.pfm``. An ``.exr`` has
        the layers in it, too.

        Raises:
            OptionError: for another ending.
            OutputError: when the file cannot be written.
        """
        self._picture.save(path)

    @property
    def camera_rays(self) -> int:
        """How many rays came from the camera."""
        return self._picture.camera_rays

    @property
    def all_rays(self) -> int:
        """How many rays were cast all together: from the camera, towards lights, off mirrors and through glass."""
        return self._picture.all_rays

    def _repr_png_(self) -> bytes:
        return bytes(self._picture.png())

    def __repr__(self) -> str:
        return f"<raybrook.Picture {self.width}x{self.height}>"
