"""The interface of Open3D: with NumPy, and where Open3D is installed, with its tensors and beside its answers.

The behaviour is that of Open3D's test_raycasting_scene.py, whose cases stand here in our own words."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import CUBE, CUBE_FACES, SQUARE, SQUARE_FACES

import raybrook
from raybrook.open3d import RaycastingScene

INVALID_ID = 4294967295
TRIANGLE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0]])
ONE = np.uint32([[0, 1, 2]])
CUBE_RAYS = np.float32([[0.5, 0.5, -1, 0, 0, 1], [0.5, 0.5, 0.5, 0, 0, 1], [10, 10, 10, 1, 0, 0]])
DTYPES = {"t_hit": "f4", "geometry_ids": "u4", "primitive_ids": "u4", "primitive_uvs": "f4", "primitive_normals": "f4"}
DTYPES.update({"ray_ids": "u4", "ray_splits": "u4", "points": "f4"})
LAST = {"primitive_uvs": (2,), "primitive_normals": (3,), "points": (3,)}


def scene_of(*meshes, **options):
    scene = RaycastingScene(**options)
    for number, mesh in enumerate(meshes):
        assert scene.add_triangles(*mesh) == number
    return scene


@pytest.fixture
def triangle(device):
    return scene_of((TRIANGLE, ONE), device=device)


@pytest.fixture
def cube(device):
    return scene_of((CUBE, CUBE_FACES), device=device)


def test_cast_rays(triangle):
    rays = np.float32([[0.25, 0.125, 1, 0, 0, -1], [10, 10, 10, 1, 0, 0], [np.nan] * 6, [0.25, 0.125, 1, 0, 0, 0]])
    found = triangle.cast_rays(rays)
    assert set(found) == {"t_hit", "geometry_ids", "primitive_ids", "primitive_uvs", "primitive_normals"}
    assert found["t_hit"].numpy().tolist() == [1, np.inf, np.inf, np.inf]
    assert found["geometry_ids"].tolist() == found["primitive_ids"].tolist() == [0] + 3 * [INVALID_ID]
    assert found["primitive_uvs"].tolist() == [[0.125, 0.125], [0, 0], [0, 0], [0, 0]]
    assert found["primitive_normals"].tolist() == [[0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    assert RaycastingScene.INVALID_ID == triangle.INVALID_ID == INVALID_ID
    for key, array in found.items():
        assert array.dtype == DTYPES[key], key
        assert type(array.cpu().numpy()) is np.ndarray
    assert found["t_hit"][0].item() == 1


def test_occlusions(triangle):
    rays = np.float32([[0.25, 0.125, 1, 0, 0, -1], [10, 10, 10, 1, 0, 0]])
    assert triangle.test_occlusions(rays).tolist() == [True, False]
    assert triangle.test_occlusions(rays).dtype == bool
    assert not triangle.test_occlusions(rays, tfar=0.5).any()
    assert not triangle.test_occlusions(rays, tnear=1.5).any()
    assert not triangle.test_occlusions(rays, 0.0, 0.5, 4).any()


def test_counts_and_lists(cube):
    counts = cube.count_intersections(CUBE_RAYS)
    assert (counts.tolist(), counts.dtype) == ([2, 1, 0], np.int32)
    found = cube.list_intersections(CUBE_RAYS)
    assert set(found) == {"ray_splits", "ray_ids", "t_hit", "geometry_ids", "primitive_ids", "primitive_uvs"}
    assert found["t_hit"].tolist() == [1, 2, 0.5]
    assert found["ray_splits"].tolist() == [0, 2, 3, 3]
    assert found["ray_ids"].tolist() == [0, 0, 1]
    assert found["primitive_uvs"].shape == (3, 2)
    for key, array in found.items():
        assert array.dtype == DTYPES[key], key


def test_an_edge_of_a_geometry_counts_once_and_two_geometries_twice(device):
    scene = scene_of((SQUARE, SQUARE_FACES), (SQUARE, SQUARE_FACES), device=device)
    through_the_diagonal = np.float32([[2, 2, 1, 0, 0, -1]])
    assert scene.count_intersections(through_the_diagonal).tolist() == [2]
    found = scene.list_intersections(through_the_diagonal)
    assert found["geometry_ids"].tolist() == [0, 1]
    assert found["primitive_ids"].tolist() == [0, 0]
    assert scene.cast_rays(through_the_diagonal)["geometry_ids"].tolist() == [0]


def test_geometries_have_their_own_primitives(device):
    up = SQUARE + np.float32([8, 0, 0])
    scene = scene_of((SQUARE, SQUARE_FACES), (up, SQUARE_FACES[::-1]), device=device)
    rays = np.float32([[3, 1, 1, 0, 0, -1], [11, 1, 1, 0, 0, -1], [9, 3, 1, 0, 0, -1]])
    found = scene.cast_rays(rays)
    assert found["geometry_ids"].tolist() == [0, 1, 1]
    assert found["primitive_ids"].tolist() == [0, 1, 0]
    later = scene.add_triangles(SQUARE + np.float32([16, 0, 0]), SQUARE_FACES)
    assert later == 2
    assert scene.cast_rays(np.float32([[19, 1, 1, 0, 0, -1]]))["geometry_ids"].tolist() == [2]


@pytest.mark.parametrize("shape", [(11,), (1, 2, 3), (32, 14), (0,), (2, 0)])
def test_shapes(triangle, shape):
    rays = np.random.default_rng(5).random((*shape, 6), np.float32)
    for key, array in triangle.cast_rays(rays).items():
        assert array.shape == (*shape, *LAST.get(key, ())), key
        assert array.dtype == DTYPES[key], key
    counts = triangle.count_intersections(rays)
    assert counts.shape == triangle.test_occlusions(rays).shape == shape
    for key, array in triangle.list_intersections(rays).items():
        count = rays[..., 0].size + 1 if key == "ray_splits" else counts.sum()
        assert array.shape == (count, *LAST.get(key, ())), key
        assert array.dtype == DTYPES[key], key


def test_without_triangles(device):
    for scene in (RaycastingScene(device=device), scene_of((TRIANGLE[:0], ONE[:0]), device=device)):
        assert scene.cast_rays(CUBE_RAYS)["t_hit"].tolist() == [np.inf] * 3
        assert scene.cast_rays(CUBE_RAYS)["geometry_ids"].tolist() == [INVALID_ID] * 3
        assert scene.count_intersections(CUBE_RAYS).tolist() == [0, 0, 0]
        assert not scene.test_occlusions(CUBE_RAYS).any()
        assert scene.list_intersections(CUBE_RAYS)["ray_splits"].tolist() == [0, 0, 0, 0]


def test_vertices_that_are_not_finite_are_never_hit(device):
    broken = np.concatenate([SQUARE, [[np.nan] * 3]]).astype(np.float32)
    scene = scene_of((broken, np.uint32([[0, 1, 4], [0, 1, 2], [0, 2, 3]])), device=device)
    assert scene.cast_rays(np.float32([[3, 1, 1, 0, 0, -1]]))["primitive_ids"].tolist() == [1]


def test_arguments(triangle):
    rays = np.float32([[0.25, 0.125, 1, 0, 0, -1]])
    for given in (rays.tolist(), rays.astype(float), np.asfortranarray(np.repeat(rays, 2, 0))[::2]):
        assert triangle.cast_rays(given)["t_hit"].tolist() == [1]
    with pytest.warns(raybrook.RoundingWarning):
        triangle.cast_rays(rays.astype(float) + 0.1)
    for wrong in (rays[0], rays[:, :5], np.zeros((1, 8))):
        with pytest.raises(ValueError, match="rays"):
            triangle.cast_rays(wrong)
    with pytest.raises(ValueError, match="vertices"):
        RaycastingScene().add_triangles(TRIANGLE[:, :2], ONE)
    with pytest.raises(ValueError, match="device"):
        RaycastingScene(device=SimpleNamespace())
    assert RaycastingScene(nthreads=2, device="CPU:0").cast_rays(rays)["t_hit"].tolist() == [np.inf]


def test_meshes_with_attributes_of_open3d():
    mesh = SimpleNamespace(
        vertex=SimpleNamespace(positions=CUBE), triangle=SimpleNamespace(indices=CUBE_FACES.astype("i8"))
    )
    for add in (lambda scene: scene.add_triangles(mesh), lambda scene: scene.add_triangles(mesh=mesh)):
        scene = RaycastingScene()
        assert add(scene) == 0
        assert scene.count_intersections(CUBE_RAYS).tolist() == [2, 1, 0]


def test_copies_are_their_own(triangle):
    for again in (RaycastingScene(triangle), copy.deepcopy(triangle), copy.copy(triangle)):
        assert again.add_triangles(TRIANGLE + np.float32([0, 0, 0.5]), ONE) == 1
        ray = np.float32([[0.25, 0.125, 1, 0, 0, -1]])
        assert again.cast_rays(ray)["t_hit"].tolist() == [0.5]
        assert triangle.cast_rays(ray)["t_hit"].tolist() == [1]


def test_pinhole_rays():
    rays = RaycastingScene.create_rays_pinhole(np.array([[2, 0, 1], [0, 2, 1], [0, 0, 1.0]]), np.eye(4), 3, 2)
    assert (rays.shape, rays.dtype) == ((2, 3, 6), np.float32)
    assert not rays[..., :3].any()
    assert rays[..., 3].tolist() == [[-0.25, 0.25, 0.75]] * 2
    assert rays[..., 4].tolist() == [[-0.25] * 3, [0.25] * 3]
    assert (rays[..., 5] == 1).all()
    rays = RaycastingScene.create_rays_pinhole(
        fov_deg=60, center=[0, 0, 0], eye=[1, 2, 3], up=[0, 1, 0], width_px=4, height_px=2
    )
    assert (rays[..., :3] == [1, 2, 3]).all()
    middle = rays[..., 3:].mean(axis=(0, 1))
    np.testing.assert_allclose(middle / np.linalg.norm(middle), -np.array([1, 2, 3]) / np.sqrt(14), atol=1e-6)
    for wrong in ((np.eye(2), np.eye(4), 3, 2), (np.eye(3), np.eye(3), 3, 2), (60, [0, 0], [1, 2, 3], [0, 1, 0], 3, 2)):
        with pytest.raises(ValueError, match="shape"):
            RaycastingScene.create_rays_pinhole(*wrong)


# Beside Open3D itself.


@pytest.fixture
def o3d():
    return pytest.importorskip("open3d", reason="Open3D is not installed")


def test_tensors_in_tensors_out(o3d):
    scene = RaycastingScene(device=o3d.core.Device("CPU:0"))
    assert scene.add_triangles(o3d.core.Tensor(CUBE), o3d.core.Tensor(CUBE_FACES)) == 0
    assert scene.add_triangles(o3d.t.geometry.TriangleMesh.create_box().translate([5, 0, 0])) == 1
    rays = o3d.core.Tensor(CUBE_RAYS)
    for found in (scene.cast_rays(rays), scene.list_intersections(rays)):
        assert all(isinstance(array, o3d.core.Tensor) for array in found.values())
    assert scene.count_intersections(rays).numpy().tolist() == [2, 1, 0]
    assert isinstance(scene.test_occlusions(rays), o3d.core.Tensor)


def test_the_same_keys_shapes_and_dtypes_as_open3d(o3d):
    rays = o3d.core.Tensor(np.random.default_rng(6).random((5, 7, 6), np.float32) - np.float32(0.5))
    theirs, ours = o3d.t.geometry.RaycastingScene(), RaycastingScene()
    for scene in (theirs, ours):
        scene.add_triangles(o3d.core.Tensor(CUBE), o3d.core.Tensor(CUBE_FACES))
    for name in ("cast_rays", "list_intersections"):
        expected, found = getattr(theirs, name)(rays), getattr(ours, name)(rays)
        assert set(expected) == set(found)
        for key in expected:
            assert (expected[key].shape, expected[key].dtype) == (found[key].shape, found[key].dtype), key
        expected, found = ({key: array.numpy() for key, array in them.items()} for them in (expected, found))
        if name == "list_intersections":
            # Theirs are in no order within a ray.
            order = np.lexsort((expected["t_hit"], expected["ray_ids"]))
            expected = {key: array if key == "ray_splits" else array[order] for key, array in expected.items()}
        for key in expected:
            np.testing.assert_allclose(found[key], expected[key], atol=1e-5, err_msg=key)
    for name in ("test_occlusions", "count_intersections"):
        expected, found = getattr(theirs, name)(rays), getattr(ours, name)(rays)
        assert expected.dtype == found.dtype
        assert np.array_equal(expected.numpy(), found.numpy())
    pinhole = dict(fov_deg=60, center=[0, 0, 0], eye=[1, 2, 3], up=[0, 1, 0], width_px=7, height_px=5)
    expected, found = (
        kind.create_rays_pinhole(**pinhole) for kind in (o3d.t.geometry.RaycastingScene, RaycastingScene)
    )
    np.testing.assert_allclose(found, expected.numpy(), atol=2e-7)
