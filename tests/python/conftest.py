"""What several tests use."""

import os
from pathlib import Path

import numpy as np
import pytest

import raybrook

ROOT = Path(__file__).parents[2]

# Two squares of two triangles each, one behind the other.
SQUARE = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], np.float32)
SQUARES = np.concatenate([SQUARE, SQUARE + np.float32([0, 0, 1])])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
SQUARES_FACES = np.concatenate([SQUARE_FACES, SQUARE_FACES + 4])

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
    + [[1, 5, 7], [1, 7, 3]],
    np.uint32,
)


def shared(path):
    """A path under the shared models, which lie in RAYBROOK_SHARED or else beside the project. Skips the test where
    they are not, or fails it where RAYBROOK_REQUIRE_SHARED is set."""
    path = Path(os.environ.get("RAYBROOK_SHARED", ROOT / ".." / "shared")).resolve() / path
    if not path.exists():
        assert "RAYBROOK_REQUIRE_SHARED" not in os.environ, f"there is no {path}"
        pytest.skip(f"there is no {path}")
    return path


def has_device():
    return any(device.unusable is None for device in raybrook.devices())


if os.environ.get("RAYBROOK_REQUIRE_DEVICE") == "1":
    assert has_device(), "there is no OpenCL device"


@pytest.fixture(params=["reference", "device"])
def device(request):
    """The scalar reference, and the device that is the fastest."""
    if request.param == "reference":
        return "reference"
    if not has_device():
        pytest.skip("there is no OpenCL device")
    return None


@pytest.fixture
def squares(device):
    return raybrook.Scene(SQUARES, SQUARES_FACES, device=device)


@pytest.fixture
def cube(device):
    return raybrook.Scene(CUBE, CUBE_FACES, device=device)


def down(x, y, z=3):
    """A ray down from a place."""
    return [x, y, z, 0, 0, -1]
