"""Scenes: what they answer, on device and reference."""

import pickle
import threading

import numpy as np
import pytest
from conftest import CUBE, CUBE_FACES, ROOT, SQUARE, SQUARE_FACES, SQUARES, SQUARES_FACES, down

import raybrook
from raybrook import NO_HIT, Scene


def test_closest_hits(squares):
    hits = squares.closest_hits([down(3, 1), down(1, 3), down(9, 1)])
    assert hits.t.tolist() == [2, 2, np.inf]
    assert hits.triangle.tolist() == [2, 3, NO_HIT]
    assert hits.mesh.tolist() == [0, 0, NO_HIT]
    assert hits.uv.tolist() == [[0.5, 0.25], [0.25, 0.5], [0, 0]]
    assert hits.hit.tolist() == [True, True, False]
    assert (hits.t.dtype, hits.triangle.dtype, hits.mesh.dtype, hits.uv.dtype) == ("f4", "u4", "u4", "f4")
    points = squares.points(hits)
    assert points.dtype == np.float64
    assert points[:2].tolist() == [[3, 1, 1], [1, 3, 1]]
    assert np.isnan(points[2]).all()


def test_any_count_and_crossings(squares):
    rays = [down(3, 1), down(2, 2), down(9, 1), down(3, 1, 0.5)]
    assert squares.any_hit(rays).tolist() == [True, True, False, True]
    assert squares.any_hit(rays).dtype == bool
    assert squares.count(rays).tolist() == [2, 4, 0, 1]
    assert squares.count_crossings(rays).tolist() == [2, 2, 0, 1]
    assert squares.count(rays).dtype == squares.count_crossings(rays).dtype == np.uint32


def test_list_hits(squares):
    rays = [down(3, 1), down(9, 1), down(2, 2)]
    hits = squares.list_hits(rays)
    assert hits.starts.tolist() == [0, 2, 2, 6]
    assert hits.ray.tolist() == [0, 0, 2, 2, 2, 2]
    assert hits.triangle.tolist() == [2, 0, 2, 3, 0, 1]
    assert hits.t.tolist() == [2, 3, 2, 2, 3, 3]
    assert hits.uv.shape == (6, 2)
    assert len(hits) == 6
    assert squares.points(hits)[:, 2].tolist() == [1, 0, 1, 1, 0, 0]
    assert squares.list_hits(rays, merge=True).triangle.tolist() == [2, 0, 2, 0]
    assert squares.list_hits(rays, most=1).triangle.tolist() == [2, 2]
    assert squares.list_hits(rays, most=1, merge=True).triangle.tolist() == [2, 2]
    assert len(squares.list_hits(rays, most=0)) == 0
    with pytest.raises(ValueError, match="most"):
        squares.list_hits(rays, most=-1)


def test_hits_whose_t_only_rounds_to_the_same_are_not_merged(device):
    # From far away both sides of a thin box are at the same float32 number.
    box = Scene(CUBE * np.float32([1, 1, 1e-3]), CUBE_FACES, device=device)
    ray = [0.25, 0.75, 2.0**20, 0, 0, -1]
    hits = box.list_hits(ray, merge=True)
    assert hits.t[0] == hits.t[1]
    assert len(hits) == 2
    along_the_edge = box.list_hits([0.5, 0.5, 2.0**20, 0, 0, -1])
    assert len(along_the_edge) == 4
    assert len(box.list_hits([0.5, 0.5, 2.0**20, 0, 0, -1], merge=True)) == 2


def test_contains(cube):
    points = np.array([[0.5, 0.5, 0.5], [2, 0.5, 0.5], [0, 0, 0], [1, 0.5, 0.25]], np.float32)
    inside = cube.contains(points)
    assert inside.tolist() == [True, False, True, True]
    assert inside.dtype == bool
    assert cube.contains(points[:1].reshape(1, 1, 3)).shape == (1, 1)
    assert cube.contains(np.zeros((0, 3))).shape == (0,)


def test_an_open_mesh_contains_nothing_to_be_told(squares):
    with pytest.raises(raybrook.InputError, match="not closed"):
        squares.contains([[1, 1, 1]])


def test_rays_of_any_leading_shape(squares):
    rays = np.zeros((2, 3, 4, 6), np.float32)
    rays[..., :3], rays[..., 5] = 1, -1
    hits = squares.closest_hits(rays)
    assert hits.t.shape == hits.triangle.shape == hits.mesh.shape == (2, 3, 4)
    assert hits.uv.shape == (2, 3, 4, 2)
    assert squares.points(hits).shape == (2, 3, 4, 3)
    assert squares.any_hit(rays).shape == squares.count(rays).shape == (2, 3, 4)
    assert squares.closest_hits(rays[0, 0, 0]).t.shape == ()
    assert squares.closest_hits(rays[:0]).t.shape == (0, 3, 4)
    assert squares.list_hits(rays[:0]).starts.tolist() == [0]
    assert squares.list_hits(rays).starts.shape == (25,)


def test_rays_as_pairs_and_with_limits(squares):
    origins, direction = np.float32([[3, 1, 3], [9, 1, 3]]), np.float32([0, 0, -1])
    assert squares.any_hit((origins, direction)).tolist() == [True, False]
    assert squares.closest_hits((origins, np.tile(direction, (2, 1)))).t.tolist() == [2, np.inf]
    limits = np.float32([[3, 1, 3, 0, 0, -1, 0, 1.5], [3, 1, 3, 0, 0, -1, 2, 2], [3, 1, 3, 0, 0, -1, 2.5, 9]])
    assert squares.closest_hits(limits).t.tolist() == [np.inf, 2, 3]
    assert squares.closest_hits(down(3, 1), t_min=2.5).t == 3
    assert not squares.any_hit(down(3, 1), t_max=1.5)
    with pytest.raises(ValueError, match="twice"):
        squares.any_hit(limits, t_max=1)


def test_rays_that_hit_nothing(squares):
    nan, inf = np.nan, np.inf
    rays = [[nan] * 6, [1, 1, 3, 0, 0, 0], [1, 1, 3, 0, 0, -inf], [inf, 1, 3, 0, 0, -1], [1, 1, 3, nan, 0, -1]]
    assert not squares.any_hit(rays).any()
    assert not squares.count(rays).any()
    assert squares.closest_hits(rays).triangle.tolist() == [NO_HIT] * len(rays)


def test_scenes_without_triangles(device):
    for scene in (Scene(device=device), Scene(np.zeros((0, 3)), np.zeros((0, 3), int), device=device)):
        assert scene.triangle_count == 0
        assert scene.bounds is None
        assert not scene.any_hit([down(1, 1)]).any()
        assert scene.closest_hits([down(1, 1)]).t.tolist() == [np.inf]
        assert scene.list_hits([down(1, 1)]).starts.tolist() == [0, 0]
        assert scene.contains([[1, 1, 1]]).tolist() == [False]


def test_meshes_have_numbers_and_places(device):
    scene = Scene(device=device)
    assert scene.add_mesh(SQUARE, SQUARE_FACES) == 0
    assert scene.add_mesh(np.zeros((0, 3)), np.zeros((0, 3), int)) == 1
    up = [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 1], [0, 0, 0, 1]]
    assert scene.add_mesh(SQUARE, SQUARE_FACES, transform=up) == 2
    assert scene.add_mesh(SQUARE, SQUARE_FACES[::-1], transform=np.array(up)[:3] * [[1], [1], [3]]) == 3
    assert scene.mesh_count == 4
    assert scene.triangle_count == 6
    hits = scene.closest_hits([down(3, 1, 2), down(7, 1, 2), down(3, 1, 9)])
    assert hits.mesh.tolist() == [2, 2, 3]
    assert hits.triangle.tolist() == [0, 0, 1]
    assert hits.t.tolist() == [1, 1, 6]
    assert scene.points(hits).tolist() == [[3, 1, 1], [7, 1, 1], [3, 1, 3]]
    assert scene.list_hits([down(3, 1, 9)]).mesh.tolist() == [3, 2, 0]
    assert scene.add_mesh(SQUARE + 8, SQUARE_FACES) == 4
    assert scene.closest_hits([down(9, 9, 10)]).mesh.tolist() == [4]


def test_the_callers_arrays_may_change_later(device):
    vertices, faces = SQUARE.copy(), SQUARE_FACES.copy()
    scene = Scene(vertices, faces, device=device)
    vertices += 100
    faces[:] = 0
    assert scene.any_hit(down(3, 1))


@pytest.mark.parametrize("transform", [np.eye(3), np.diag([1, 1, 1, 2]), np.full((4, 4), np.nan)])
def test_transforms_that_are_none(transform):
    with pytest.raises(ValueError, match="transform"):
        Scene(SQUARE, SQUARE_FACES, transform=transform)


def test_device_and_reference_agree_on_every_method(device):
    random = np.random.default_rng(1)
    faces = np.arange(300).reshape(-1, 3)
    vertices = random.random((300, 3), np.float32)
    rays = (random.random((2000, 6), np.float32) - np.float32(0.5)) * 2
    expected = Scene(vertices, faces, device="reference").closest_hits(rays)
    for method in (None, "kd+ropes", "bvh2", "grid"):
        found = Scene(vertices, faces, device=device, method=method).closest_hits(rays)
        assert np.array_equal(found.triangle, expected.triangle), method
        assert found.t.tobytes() == expected.t.tobytes()
        assert found.uv.tobytes() == expected.uv.tobytes()


def test_files(device):
    scene = Scene.load(ROOT / "scenes" / "vase.obj", device=device)
    assert scene.triangle_count > 100
    assert scene.mesh_count == 1
    low, high = scene.bounds
    middle = (low + high) / 2
    ray = [*middle[:2], high[2] + 1, 0, 0, -1]
    hits = scene.list_hits(np.float32(ray))
    assert len(hits) >= 2
    assert hits.triangle.max() < scene.triangle_count
    with pytest.raises(TypeError, match="file"):
        scene.add_mesh(SQUARE, SQUARE_FACES)
    with pytest.raises(raybrook.InputError, match="nowhere.obj"):
        Scene.load("nowhere.obj")


def test_pickles(squares):
    rays = [down(3, 1), down(9, 1)]
    again = pickle.loads(pickle.dumps(squares))
    assert again.closest_hits(rays).t.tobytes() == squares.closest_hits(rays).t.tobytes()
    assert again.add_mesh(SQUARE, SQUARE_FACES) == 1
    assert squares.mesh_count == 1
    loaded = pickle.loads(pickle.dumps(Scene.load(ROOT / "scenes" / "vase.obj")))
    assert loaded.triangle_count > 100


def test_several_threads_take_turns(squares):
    rays = np.float32([down(3, 1), down(9, 1)] * 500)
    expected = squares.closest_hits(rays).t.tobytes()
    found = []

    def ask():
        found.extend(squares.closest_hits(rays).t.tobytes() for _ in range(5))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 20


def test_what_was_chosen_is_told(squares, device):
    assert any(choice.startswith("structure ") for choice in squares.choices)
    if device == "reference":
        assert squares.device == "reference"
    assert "4 triangles" in repr(squares)
    assert squares.bounds.tolist() == [[0, 0, 0], [4, 4, 1]]
    by_method = Scene(SQUARES, SQUARES_FACES, device=device, method="kd+ropes", cache=False)
    assert by_method.choices[0].startswith("structure kd")
    fast = Scene(SQUARES, SQUARES_FACES, device=device, precision="fast")
    assert fast.closest_hits(down(3, 1)).triangle == 2
