"""The interface of trimesh: with any object of vertices and faces, and with trimesh where it is installed."""

import copy
import pickle
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import CUBE, CUBE_FACES, SQUARES, SQUARES_FACES

from raybrook import RoundingWarning
from raybrook.trimesh import RayMeshIntersector

DOWN = np.array([[3, 1, 3], [9, 1, 3], [2, 2, 3]]), np.array([[0, 0, -1.0]] * 3)


def mesh_of(vertices, faces):
    return SimpleNamespaceWithHash(vertices=np.asarray(vertices, float), faces=np.asarray(faces, int))


class SimpleNamespaceWithHash(SimpleNamespace):
    """A mesh whose hash tells its contents, as trimesh's does."""

    def __hash__(self):
        return hash((self.vertices.tobytes(), self.faces.tobytes()))


@pytest.fixture
def squares(device):
    return RayMeshIntersector(mesh_of(SQUARES, SQUARES_FACES), device=device)


@pytest.fixture
def cube(device):
    return RayMeshIntersector(mesh_of(CUBE, CUBE_FACES), device=device)


def test_intersects_id(squares):
    index_tri, index_ray = squares.intersects_id(*DOWN)
    assert index_tri.tolist() == [2, 0, 2, 0]
    assert index_ray.tolist() == [0, 0, 2, 2]
    assert index_tri.dtype == index_ray.dtype == np.int64
    index_tri, index_ray = squares.intersects_id(*DOWN, multiple_hits=False)
    assert (index_tri.tolist(), index_ray.tolist()) == ([2, 2], [0, 2])
    index_tri, index_ray = squares.intersects_id(*DOWN, max_hits=1)
    assert (index_tri.tolist(), index_ray.tolist()) == ([2, 2], [0, 2])
    *_, locations = squares.intersects_id(*DOWN, return_locations=True)
    assert locations.dtype == np.float64
    assert locations.tolist() == [[3, 1, 1], [3, 1, 0], [2, 2, 1], [2, 2, 0]]
    *_, locations = squares.intersects_id(*DOWN, multiple_hits=False, return_locations=True)
    assert locations.tolist() == [[3, 1, 1], [2, 2, 1]]


def test_intersects_location_first_and_any(squares):
    locations, index_ray, index_tri = squares.intersects_location(*DOWN)
    assert (locations.shape, index_ray.tolist(), index_tri.tolist()) == ((4, 3), [0, 0, 2, 2], [2, 0, 2, 0])
    locations, *_ = squares.intersects_location(*DOWN, multiple_hits=False)
    assert locations.shape == (2, 3)
    first = squares.intersects_first(*DOWN)
    assert (first.tolist(), first.dtype) == ([2, -1, 2], np.int64)
    hit = squares.intersects_any(*DOWN)
    assert (hit.tolist(), hit.dtype) == ([True, False, True], bool)


def test_nothing_and_nothing_hit(squares):
    none = np.zeros((0, 3))
    for rays in ((none, none), ([], []), (DOWN[0] + 100, DOWN[1]), (DOWN[0] * np.nan, DOWN[1]), (DOWN[0], DOWN[1] * 0)):
        locations, index_ray, index_tri = squares.intersects_location(*rays)
        assert (locations.shape, index_ray.shape, index_tri.shape) == ((0, 3), (0,), (0,))
        assert squares.intersects_id(*rays, multiple_hits=False)[0].shape == (0,)
        assert squares.intersects_first(*rays).tolist() == [-1] * len(rays[0])
        assert squares.intersects_any(*rays).tolist() == [False] * len(rays[0])


def test_arguments_that_are_none(squares):
    for ask in (squares.intersects_id, squares.intersects_location, squares.intersects_first, squares.intersects_any):
        with pytest.raises(ValueError, match="don't match"):
            ask(DOWN[0], DOWN[1][:2])
        with pytest.raises(ValueError, match="shape"):
            ask(DOWN[0][0], DOWN[1][0])
    with pytest.raises(ValueError, match=r"points must be \(n,3\)"):
        squares.contains_points([1, 2, 3])


def test_lists_integers_and_strides_are_taken(squares):
    origins, directions = np.repeat(DOWN[0], 2, axis=0)[::2], np.asfortranarray(DOWN[1])
    for rays in (
        (origins, directions),
        (origins.tolist(), directions.tolist()),
        (origins.astype(int), DOWN[1].astype(int)),
    ):
        assert squares.intersects_first(*rays).tolist() == [2, -1, 2]


def test_contains_points(cube):
    inside = cube.contains_points([[0.5, 0.5, 0.5], [2, 0.5, 0.5], [0.5, 0.5, -1], [0, 0, 0]])
    assert (inside.tolist(), inside.dtype) == ([True, False, False, True], bool)
    assert cube.contains_points(np.zeros((0, 3))).shape == (0,)


def test_an_open_mesh_is_left_through_its_hole(device):
    # Without its top, a point inside still has the bottom and four sides around it.
    without_top = RayMeshIntersector(mesh_of(CUBE, CUBE_FACES[[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]]), device=device)
    found = without_top.contains_points([[0.5, 0.5, 0.5], [0.5, 0.5, 9], [9, 9, 9]])
    assert found.tolist() == [False, False, False] or found.tolist() == [True, False, False]
    assert not found[1:].any()


def test_changes_of_the_mesh_are_noticed(squares):
    assert squares.intersects_any(*DOWN).tolist() == [True, False, True]
    squares.mesh.vertices = squares.mesh.vertices + [6, 0, 0]
    assert squares.intersects_any(*DOWN).tolist() == [False, True, False]
    assert squares.intersects_location(*DOWN)[0][:, 2].tolist() == [1, 0]


def test_a_mesh_far_from_the_origin_keeps_its_shape(device):
    far = np.array([528980.85, 183526.1, 12.3])
    mesh = mesh_of(CUBE * 0.1 + far, CUBE_FACES)
    with pytest.warns(RoundingWarning, match="rays"):
        ray = RayMeshIntersector(mesh, device=device)
        above = far + [0.025, 0.075, 1]
        locations, *_ = ray.intersects_location([above], [[0, 0, -1]])
    np.testing.assert_allclose(locations, [far + [0.025, 0.075, 0.1], far + [0.025, 0.075, 0]], atol=1e-7)
    just_above = far + [0.025, 0.075, 0.1001]
    assert ray.intersects_any([just_above, just_above], [[0, 0, 1], [0, 0, -1]]).tolist() == [False, True]
    assert ray.contains_points([far + 0.05, far + 0.1001, far - 0.0001]).tolist() == [True, False, False]
    with pytest.warns(RoundingWarning, match="by at most 0.0"):
        as_it_is = RayMeshIntersector(mesh, scale_to_box=False, device=device)
        as_it_is.intersects_any([above], [[0, 0, -1]])


def test_float32_numbers_stay_as_they_are(squares):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        squares.mesh.vertices = squares.mesh.vertices + [2**20, 0, 0]
        assert squares.intersects_any(DOWN[0] + [2**20, 0, 0], DOWN[1]).tolist() == [True, False, True]


def test_any_object_with_vertices_and_faces(device):
    ray = RayMeshIntersector(SimpleNamespace(vertices=SQUARES, faces=SQUARES_FACES), device=device)
    assert ray.intersects_first(*DOWN).tolist() == [2, -1, 2]
    assert ray.intersects_any(*DOWN).tolist() == [True, False, True]


def test_copies_and_pickles(squares):
    for again in (copy.copy(squares), copy.deepcopy(squares), pickle.loads(pickle.dumps(squares))):
        assert again.intersects_first(*DOWN).tolist() == [2, -1, 2]


def test_a_mesh_of_trimesh():
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    mesh = trimesh.creation.box(extents=[2, 2, 2])
    mesh.ray = RayMeshIntersector(mesh)
    assert mesh.contains([[0, 0, 0], [2, 0, 0]]).tolist() == [True, False]
    assert mesh.ray.intersects_any([[0, 0, 5]], [[0, 0, -1]]).all()
    mesh.apply_translation([10, 0, 0])
    assert mesh.contains([[0, 0, 0], [10, 0, 0]]).tolist() == [False, True]
