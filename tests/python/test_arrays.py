"""Arrays that come in: dtypes, shapes, memory; what is rounded is told."""

import warnings

import numpy as np
import pytest
from conftest import SQUARES, SQUARES_FACES, down

from raybrook import RoundingWarning, Scene


@pytest.fixture(scope="module")
def scene():
    return Scene(SQUARES, SQUARES_FACES, device="reference")


RAYS = np.array([down(3, 1), down(1, 3), down(9, 1)])
EXPECTED = [2, 2, np.inf]


@pytest.mark.parametrize("dtype", ["f2", "f4", ">f4", "f8", ">f8", "i1", "i2", "i4", "i8", ">i4", "g"])
def test_float32_numbers_of_any_dtype_are_taken_silently(scene, dtype):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert scene.closest_hits(RAYS.astype(dtype)).t.tolist() == EXPECTED
        assert Scene(SQUARES.astype(dtype), SQUARES_FACES, device="reference").any_hit(RAYS).any()


def test_rounding_is_told_once(scene):
    rays = RAYS.astype(float)
    rays[0, 0], rays[1, 1] = 3.1, 2**24 + 1
    text = r"rays: 2 of 18 numbers are no float32 numbers and were rounded, by at most 1$"
    with pytest.warns(RoundingWarning, match=text) as told:
        scene.closest_hits(rays)
    assert len(told) == 1
    assert told[0].filename == __file__
    with pytest.warns(RoundingWarning, match="rays: 2 of 18") as told:
        scene.any_hit((rays[:, :3], rays[:, 3:]))
    assert len(told) == 1
    with pytest.warns(RoundingWarning, match="points: 1 of 3 .* 1.19e-08"):
        Scene(device="reference").contains([[0.7, 0, 0]])
    with pytest.warns(RoundingWarning, match="vertices: 24 of 24"):
        Scene(SQUARES + np.full(SQUARES.shape, 0.1), SQUARES_FACES)
    assert issubclass(RoundingWarning, UserWarning)


def test_nan_and_infinity_are_no_rounding(scene):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not scene.any_hit(np.array([[np.nan, np.inf, -np.inf, 0, 0, 1]])).any()
    with pytest.warns(RoundingWarning, match="by at most inf"):
        assert not scene.any_hit([[1e39, 0, 0, 0, 0, 1]]).any()


def test_arrays_that_are_not_contiguous(scene):
    wide = np.zeros((3, 12), np.float32)
    wide[:, ::2] = RAYS
    for rays in (wide[:, ::2], np.asfortranarray(RAYS.astype("f4")), RAYS.astype("f4")[::-1][::-1]):
        assert scene.closest_hits(rays).t.tolist() == EXPECTED
    backwards = Scene(SQUARES[::-1][::-1], SQUARES_FACES[:, ::-1][:, ::-1], device="reference")
    assert backwards.closest_hits(RAYS).t.tolist() == EXPECTED


def test_arrays_at_odd_addresses(scene):
    def moved(array):
        room = np.zeros(array.nbytes + 1, np.uint8)
        room[1:] = np.frombuffer(array.tobytes(), np.uint8)
        odd = np.frombuffer(room.data, array.dtype, offset=1).reshape(array.shape)
        assert not odd.flags.aligned
        return odd

    for rays in (RAYS.astype("f4"), RAYS.astype("f8")):
        assert scene.closest_hits(moved(rays)).t.tolist() == EXPECTED
        assert scene.closest_hits((moved(rays[:, :3]), moved(rays[:, 3:]))).t.tolist() == EXPECTED
    again = Scene(moved(SQUARES), moved(SQUARES_FACES), device="reference")
    assert again.closest_hits(RAYS).t.tolist() == EXPECTED


def test_read_only_arrays(scene):
    rays = RAYS.astype("f4")
    rays.flags.writeable = False
    assert scene.closest_hits(rays).t.tolist() == EXPECTED


class OfAnotherLibrary:
    """An array that other libraries know by DLPack alone."""

    def __init__(self, array, device=1):
        self.array, self.device = array, device

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return (self.device, 0)


def test_dlpack(scene):
    rays = RAYS.astype("f4")
    assert scene.closest_hits(OfAnotherLibrary(rays)).t.tolist() == EXPECTED
    with pytest.raises(TypeError, match="processor's memory"):
        scene.closest_hits(OfAnotherLibrary(rays, device=2))
    assert np.from_dlpack(scene.closest_hits(rays).t).tolist() == EXPECTED


@pytest.mark.parametrize(
    ("rays", "error", "text"),
    [
        (np.zeros((4, 5)), ValueError, r"rays: the last dimension must be 6 or 8, but the shape is \(4, 5\)"),
        (np.zeros(()), ValueError, "rays: the last dimension"),
        ([], ValueError, "rays: the last dimension"),
        (np.zeros((4, 6), complex), TypeError, "rays: numbers are needed, not complex128"),
        ([["a"] * 6], TypeError, "rays: numbers are needed"),
        (np.zeros((4, 6), object), TypeError, "rays: numbers are needed"),
        ((np.zeros((4, 2)), np.zeros((4, 3))), ValueError, "origins"),
        ((np.zeros((4, 3)), np.zeros((5, 3))), ValueError, "rays: origins of shape"),
    ],
)
def test_rays_that_are_none(scene, rays, error, text):
    for ask in (scene.closest_hits, scene.any_hit, scene.count, scene.count_crossings, scene.list_hits):
        with pytest.raises(error, match=text):
            ask(rays)


@pytest.mark.parametrize(
    ("vertices", "faces", "error", "text"),
    [
        (SQUARES[:, :2], SQUARES_FACES, ValueError, r"vertices: the shape must be \(n, 3\), but is \(8, 2\)"),
        (SQUARES, SQUARES_FACES[:, :2], ValueError, r"faces: the shape must be \(n, 3\), but is \(4, 2\)"),
        (SQUARES, SQUARES_FACES.astype(float), TypeError, "faces: integers are needed, not float64"),
        (SQUARES, SQUARES_FACES.astype(int) - 1, ValueError, "faces: the numbers of vertices"),
        (SQUARES, SQUARES_FACES.astype(int) + 2**32, ValueError, "faces: the numbers of vertices"),
        (SQUARES, None, TypeError, "needs vertices and faces"),
        (SQUARES.astype(str), SQUARES_FACES, TypeError, "vertices: numbers are needed"),
    ],
)
def test_meshes_that_are_none(vertices, faces, error, text):
    with pytest.raises(error, match=text):
        Scene(vertices, faces)


def test_points_that_are_none(scene):
    with pytest.raises(ValueError, match="points: the last dimension must be 3"):
        scene.contains(np.zeros((4, 2)))
