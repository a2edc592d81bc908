"""An exact and fast ray tracer for triangle meshes, on any OpenCL device.

>>> import raybrook
>>> scene = raybrook.Scene([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], [[0, 1, 2], [0, 2, 3]])
>>> hits = scene.closest_hits([[1, 2, 5, 0, 0, -2], [9, 2, 5, 0, 0, -2]])
>>> hits.t.tolist(), hits.hit.tolist(), int(hits.triangle[0])
([2.5, inf], [True, False], 1)

`raybrook.trimesh` and `raybrook.open3d` have the interfaces of those libraries, which need not be installed.
"""

from ._errors import (
    DeviceError,
    Error,
    InputError,
    NoteWarning,
    OptionError,
    OutOfMemoryError,
    OutputError,
    RoundingWarning,
)
from ._hits import NO_HIT, ClosestPoints, HitList, Hits
from ._picture import Picture
from ._raybrook import __version__
from ._scene import Device, Scene, devices

__all__ = [
    "NO_HIT",
    "ClosestPoints",
    "Device",
    "DeviceError",
    "Error",
    "HitList",
    "Hits",
    "InputError",
    "NoteWarning",
    "OptionError",
    "OutOfMemoryError",
    "OutputError",
    "Picture",
    "RoundingWarning",
    "Scene",
    "__version__",
    "devices",
]
