"""Closest points and distances, and Open3D's methods for them."""

import math
import warnings
from fractions import Fraction

import numpy as np
import pytest
from conftest import CUBE, CUBE_FACES, SQUARE, SQUARE_FACES

import raybrook
from raybrook import NO_HIT, Scene
from raybrook.open3d import RaycastingScene

INVALID_ID = RaycastingScene.INVALID_ID
POINTS = np.float32([[3, 1, 5], [8, -3, 0], [1, 3, 0]])


def test_closest_points(device):
    scene = Scene(SQUARE, SQUARE_FACES, device=device)
    scene.add_mesh(SQUARE + np.float32([100, 0, 0]), SQUARE_FACES)
    closest = scene.closest_point(POINTS)
    assert closest.point.tolist() == [[3, 1, 0], [4, 0, 0], [1, 3, 0]]
    assert closest.distance.tolist() == [5, 5, 0]
    assert closest.triangle.tolist() == [0, 0, 1]
    assert closest.mesh.tolist() == [0, 0, 0]
    assert closest.uv.tolist() == [[0.5, 0.25], [1, 0], [0.25, 0.5]]
    dtypes = [array.dtype for array in (closest.point, closest.distance, closest.triangle, closest.mesh, closest.uv)]
    assert dtypes == ["f4", "f4", "u4", "u4", "f4"]
    assert scene.distance(POINTS).tolist() == [5, 5, 0]
    assert scene.closest_point(POINTS[:1] + np.float32([100, 0, 0])).mesh.tolist() == [1]
    np.testing.assert_array_equal(scene.points(closest), closest.point)


def test_shapes_of_points(device):
    scene = Scene(CUBE, CUBE_FACES, device=device)
    for shape in ((2, 3, 4), (), (0,), (2, 0)):
        points = np.zeros((*shape, 3), np.float32)
        closest = scene.closest_point(points)
        assert closest.point.shape == (*shape, 3)
        assert closest.uv.shape == (*shape, 2)
        assert closest.distance.shape == closest.triangle.shape == closest.mesh.shape == shape
        assert scene.distance(points).shape == scene.signed_distance(points).shape == shape


def test_signed_distances(device):
    scene = Scene(CUBE, CUBE_FACES, device=device)
    points = np.float32([[0.5, 0.5, 0.5], [0.5, 0.5, 2], [0, 0.5, 0.5], [0.5, 0.75, 0.5]])
    assert scene.signed_distance(points).tolist() == [-0.5, 1, 0, -0.25]
    with pytest.raises(raybrook.InputError, match="not closed"):
        Scene(SQUARE, SQUARE_FACES, device=device).signed_distance(points)


def test_winding_numbers(device):
    points = np.float32([[0.5, 0.5, 0.5], [0.5, 0.5, 2]])
    outwards = Scene(CUBE, CUBE_FACES, device=device).winding_number(points)
    assert outwards.dtype == np.float64
    np.testing.assert_allclose(np.abs(outwards), [1, 0], atol=1e-12)
    inwards = Scene(CUBE, CUBE_FACES[:, ::-1], device=device).winding_number(points)
    np.testing.assert_allclose(inwards, -outwards, atol=1e-12)
    assert Scene(SQUARE, SQUARE_FACES, device=device).winding_number(np.zeros((2, 0, 3))).shape == (2, 0)


def test_points_without_a_closest_one(device):
    nothing = np.float32([[np.nan, 0, 0], [np.inf, 0, 0]])
    closest = Scene(SQUARE, SQUARE_FACES, device=device).closest_point(nothing)
    assert closest.triangle.tolist() == closest.mesh.tolist() == [NO_HIT, NO_HIT]
    assert np.isnan(closest.point).all() and np.isnan(closest.distance).all()
    assert not closest.uv.any()
    empty = Scene(device=device)
    assert empty.closest_point(POINTS).triangle.tolist() == [NO_HIT] * 3
    assert empty.distance(POINTS).tolist() == [np.inf] * 3


def test_the_device_finds_what_the_reference_does(device):
    random = np.random.default_rng(4)
    vertices, faces = random.random((600, 3), np.float32), np.arange(600).reshape(-1, 3)
    points = (random.random((3000, 3), np.float32) - np.float32(0.25)) * 2
    expected = Scene(vertices, faces, device="reference").closest_point(points)
    found = Scene(vertices, faces, device=device).closest_point(points)
    for name in ("point", "distance", "triangle", "uv"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name


def test_many_points_tell_their_progress(device):
    scene = Scene(CUBE, CUBE_FACES, device=device)
    points = np.random.default_rng(5).random((50_000, 3), np.float32)
    for ask in (scene.closest_point, scene.distance, scene.signed_distance, scene.winding_number):
        told = []
        ask(points, progress=told.append)
        assert told[-1] == 1


# Open3D's.


def cube_of_open3d(device):
    scene = RaycastingScene(device=device)
    scene.add_triangles(CUBE, CUBE_FACES)
    return scene


def test_compute_closest_points(device):
    scene = RaycastingScene(device=device)
    scene.add_triangles(SQUARE, SQUARE_FACES)
    scene.add_triangles(SQUARE + np.float32([0, 0, -50]), SQUARE_FACES)
    found = scene.compute_closest_points(np.float32([[3, 1, 5], [3, 1, -49], [np.nan, 0, 0]]))
    assert set(found) == {"points", "geometry_ids", "primitive_ids", "primitive_uvs", "primitive_normals"}
    assert found["points"][:2].tolist() == [[3, 1, 0], [3, 1, -50]]
    assert found["geometry_ids"].tolist() == [0, 1, INVALID_ID]
    assert found["primitive_ids"].tolist() == [0, 0, INVALID_ID]
    assert found["primitive_uvs"].tolist() == [[0.5, 0.25], [0.5, 0.25], [0, 0]]
    assert found["primitive_normals"].tolist() == [[0, 0, 1], [0, 0, 1], [0, 0, 0]]
    assert {key: array.dtype.str[1:] for key, array in found.items()} == {
        "points": "f4",
        "geometry_ids": "u4",
        "primitive_ids": "u4",
        "primitive_uvs": "f4",
        "primitive_normals": "f4",
    }


def test_compute_distances_and_occupancy(device):
    scene = cube_of_open3d(device)
    points = np.float32([[0.5, 0.5, 0.5], [-0.5, -0.5, -0.5], [0, 0, 0]])
    distance, signed = scene.compute_distance(points), scene.compute_signed_distance(points, nsamples=3)
    np.testing.assert_allclose(distance.numpy(), [0.5, np.sqrt(0.75), 0])
    np.testing.assert_allclose(signed.numpy(), [-0.5, np.sqrt(0.75), 0])
    occupancy = scene.compute_occupancy(points[:2])
    assert occupancy.numpy().tolist() == [1, 0]
    assert distance.dtype == signed.dtype == occupancy.dtype == np.float32
    for ask in (scene.compute_distance, scene.compute_signed_distance, scene.compute_occupancy):
        for shape in ((4, 3, 2), (0,), (2, 0)):
            assert ask(np.zeros((*shape, 3), np.float32)).shape == shape
        with pytest.raises(ValueError, match="query_points"):
            ask(points[0])
    for ask in (scene.compute_signed_distance, scene.compute_occupancy):
        with pytest.raises(ValueError, match="nsamples"):
            ask(points, nsamples=2)


def test_open_surfaces_have_signs_by_one_ray(device):
    scene = RaycastingScene(device=device)
    scene.add_triangles(SQUARE, SQUARE_FACES)
    points = np.float32([[1, 0, -1], [1, 0, 1]])  # below, from where the ray crosses the square, and above
    assert scene.compute_signed_distance(points).tolist() == [-1, 1]
    assert scene.compute_occupancy(points).tolist() == [1, 0]


def test_rounding_is_told_once():
    scene = cube_of_open3d("reference")
    for ask in (scene.compute_signed_distance, scene.compute_occupancy, scene.compute_closest_points):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            ask([[0.1, 0.5, 0.5]])
        assert [str(one.message)[:28] for one in told] == ["query_points: 1 of 3 numbers"]


def test_beside_open3d():
    o3d = pytest.importorskip("open3d", reason="Open3D is not installed")
    theirs, ours = o3d.t.geometry.RaycastingScene(), RaycastingScene()
    for scene in (theirs, ours):
        scene.add_triangles(o3d.core.Tensor(CUBE), o3d.core.Tensor(CUBE_FACES))
    points = o3d.core.Tensor(np.random.default_rng(8).random((9, 7, 3), np.float32) * 2 - np.float32(0.5))
    expected, found = theirs.compute_closest_points(points), ours.compute_closest_points(points)
    assert set(expected) == set(found)
    for key in expected:
        assert (expected[key].shape, expected[key].dtype) == (found[key].shape, found[key].dtype), key
    np.testing.assert_allclose(found["points"].numpy(), expected["points"].numpy(), atol=1e-6)
    for name in ("compute_distance", "compute_signed_distance", "compute_occupancy"):
        expected, found = getattr(theirs, name)(points), getattr(ours, name)(points)
        assert (expected.shape, expected.dtype) == (found.shape, found.dtype)
        np.testing.assert_allclose(found.numpy(), expected.numpy(), atol=1e-6)


# Instances.

HEAP = """
[[object]]
solid = "box"
size = [6, 0.5, 6]

[[object]]
file = "solid.obj"
instances = [
    { scale = [1, 0.3, 2], rotate = [20, 30, 0], translate = [2, 1, 0] },
    { scale = [-0.7, 0.7, 0.7], translate = [-2, 1, 1] },
    { scale = [-1, -2, -0.5], rotate = [0, 45, 90], translate = [0, 2, -2] },
    { scale = -0.001, translate = [0, 4, 0] },
    { translate = [1, 3, 1] },
    { translate = [1, 3, 1] },
]
"""


def exact_square(triangle, point):
    """The square of the distance between a triangle with area and a point, whole or in fractions, as a fraction."""

    def dot(a, b):
        return sum(x * y for x, y in zip(a, b))

    def minus(a, b):
        return [x - y for x, y in zip(a, b)]

    def cross(a, b):
        return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]

    corners, point = [[Fraction(float(x)) for x in corner] for corner in triangle], [Fraction(float(x)) for x in point]
    squares = [dot(to, to) for to in (minus(corner, point) for corner in corners)]
    for i in range(3):
        edge, to = minus(corners[i - 1], corners[i]), minus(point, corners[i])
        along = dot(edge, to)
        if 0 < along < dot(edge, edge):
            squares.append(dot(to, to) - along * along / dot(edge, edge))
    normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    to = [minus(corner, point) for corner in corners]
    if all(dot(normal, cross(to[i - 2], to[i - 1])) >= 0 for i in range(3)):
        squares.append(dot(normal, to[0]) ** 2 / dot(normal, normal))
    return min(squares)


def test_instances_have_the_distances_of_their_triangles(tmp_path, device):
    solid = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE) + "".join(f"f {a} {b} {c}\n" for a, b, c in CUBE_FACES + 1)
    (tmp_path / "solid.obj").write_text(solid)
    (tmp_path / "heap.toml").write_text(HEAP)
    scene = Scene.load(tmp_path / "heap.toml", method="instances", device=device)
    corners = scene._get().corners().reshape(-1, 3, 3)
    assert len(corners) == 7 * 12
    separate = Scene(
        corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), method="brute", device="reference"
    )
    random = np.random.default_rng(12)
    near = corners[random.integers(0, len(corners), 40)]
    points = np.concatenate([random.uniform(-4, 5, (60, 3)), near.mean(1), near[:, 0], near[:, :2].mean(1)])
    points = points.astype(np.float32)
    found, expected = scene.closest_point(points), separate.closest_point(points)
    for name in ("point", "distance", "triangle", "uv"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name
    assert 10 < (found.triangle >= 12).sum() < len(points)
    # Exactly: of triangles that are as near the lowest number.
    for point, triangle, distance in zip(points[::4], found.triangle[::4], found.distance[::4]):
        squares = [exact_square(corners, point) for corners in corners]
        assert squares.index(min(squares)) == triangle
        assert distance == pytest.approx(math.sqrt(min(squares)), rel=1e-7)
    assert np.array_equal(scene.contains(points), separate.contains(points))
    assert scene.signed_distance(points).tobytes() == separate.signed_distance(points).tobytes()
    assert len(set(np.sign(scene.signed_distance(points)))) == 3
    np.testing.assert_allclose(scene.winding_number(points), separate.winding_number(points), atol=1e-12)
