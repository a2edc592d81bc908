"""Scenes that move, and coordinates that need float64."""

import pickle
import warnings

import numpy as np
import pytest
from conftest import CUBE, CUBE_FACES, ROOT, SQUARE, SQUARE_FACES, down

import raybrook


def rays_around(seed):
    random = np.random.default_rng(seed)
    origins = random.uniform(-3, 3, (500, 3)).astype(np.float32)
    return np.concatenate([origins, -origins + random.uniform(-1, 1, (500, 3))], axis=1).astype(np.float32)


def answers(scene, rays):
    hits, everything = scene.closest_hits(rays), scene.list_hits(rays)
    return [array.tobytes() for array in (hits.t, hits.uv, hits.triangle, hits.mesh, everything.t, everything.starts)]


def test_moved_vertices_have_the_answers_of_a_new_scene(device):
    rays = rays_around(1)
    scene = raybrook.Scene(device=device)
    scene.add_mesh(CUBE, CUBE_FACES)
    scene.add_mesh(SQUARE, SQUARE_FACES)
    shapes = [(CUBE * np.float32(k), SQUARE + np.float32([0, k, 0])) for k in (1, 0.5, 2, 0, 1.5)]
    seen = set()
    for cube, square in shapes:
        scene.update_vertices(cube)
        scene.update_vertices(square, mesh=1)
        fresh = raybrook.Scene(device=device)
        fresh.add_mesh(cube, CUBE_FACES)
        fresh.add_mesh(square, SQUARE_FACES)
        assert answers(scene, rays) == answers(fresh, rays)
        assert np.array_equal(scene.bounds, fresh.bounds)
        hits = scene.closest_hits(rays)
        assert np.array_equal(scene.points(hits), fresh.points(hits), equal_nan=True)
        seen.add(answers(scene, rays)[0])
    assert len(seen) == len(shapes)


def test_a_transform_moves_a_mesh(squares):
    squares.update_vertices(np.concatenate([SQUARE, SQUARE]), transform=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2]])
    assert squares.closest_hits(down(1, 1, 5)).t.tolist() == 3


def test_what_cannot_be_moved_is_refused_and_stays(squares):
    before = answers(squares, rays_around(2))
    with pytest.raises(ValueError, match="vertices: the mesh has 8, and 4 are given"):
        squares.update_vertices(SQUARE)
    with pytest.raises(ValueError, match="there is no mesh 1: the scene has 1"):
        squares.update_vertices(SQUARE, mesh=1)
    with pytest.raises(raybrook.InputError, match="vertex 0 of the mesh"):
        squares.update_vertices(np.full((8, 3), np.nan, np.float32))
    assert answers(squares, rays_around(2)) == before
    with pytest.raises(TypeError, match="from a file"):
        raybrook.Scene.load(ROOT / "scenes" / "vase.obj").update_vertices(SQUARE)


FAR = np.array([500_000.25, 4_649_776.125, 0.0])


@pytest.mark.parametrize("origin", ["auto", FAR, FAR + 64])
def test_far_away_nothing_is_lost(device, origin):
    with warnings.catch_warnings():
        warnings.simplefilter("error", raybrook.RoundingWarning)
        scene = raybrook.Scene(SQUARE + FAR, SQUARE_FACES, origin=origin, device=device)
        near = raybrook.Scene(SQUARE, SQUARE_FACES, device=device)
        rays = np.array([down(1, 1.5), down(0, 0), down(4, 2), down(5, 1)], np.float64)
        moved = rays + np.concatenate([FAR, np.zeros(3)])
        assert answers(scene, moved) == answers(near, rays)
        assert answers(scene, (moved[:, :3], moved[:, 3:])) == answers(near, rays)
        hits = scene.closest_hits(moved)
        assert np.array_equal(scene.points(hits), near.points(hits) + FAR, equal_nan=True)
        assert np.array_equal(scene.bounds, near.bounds + FAR)
        again = pickle.loads(pickle.dumps(scene))
        assert answers(again, moved) == answers(near, rays) and np.array_equal(again.origin, scene.origin)
        scene.update_vertices(SQUARE + FAR + [0, 0, 1])
        assert scene.closest_hits(moved[0]).t == 2
    picture = scene.render(16, 12, samples=1, eye=FAR + [2, 2, 9], target=FAR + [2, 2, 0])
    near.update_vertices(SQUARE + np.float32([0, 0, 1]))
    # Shading is float32, and rounds other coordinates in other ways: by some parts in 2^24 of them.
    expected = near.render(16, 12, samples=1, eye=[2, 2, 9], target=[2, 2, 0]).pixels
    assert np.ptp(expected) > 0.1 and np.allclose(picture.pixels, expected, rtol=0, atol=1e-4)


def test_without_an_origin_rounding_is_told():
    with pytest.warns(raybrook.RoundingWarning, match="vertices: 4 of 12 numbers .* by at most 0.125"):
        raybrook.Scene(SQUARE + FAR, SQUARE_FACES)
    assert raybrook.Scene(SQUARE, SQUARE_FACES, origin="auto").origin.tolist() == [0, 0, 0]
    with pytest.raises(ValueError, match="neither a place nor 'auto'"):
        raybrook.Scene(SQUARE, SQUARE_FACES, origin="here")
    with pytest.raises(TypeError, match="takes no origin"):
        raybrook.Scene.load(ROOT / "scenes" / "vase.obj", origin="auto")
