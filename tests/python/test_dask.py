"""`raybrook.dask`: lazy answers with the bits of one scene, by every scheduler, whatever becomes of workers."""

import os
import warnings

import numpy as np
import pytest
from conftest import CUBE, CUBE_FACES, ROOT, SQUARE, SQUARE_FACES, SQUARES, SQUARES_FACES

import raybrook
from raybrook import Scene

dask = pytest.importorskip("dask", reason="Dask is not installed")
da = pytest.importorskip("dask.array", reason="dask.array is not installed")
lazy = pytest.importorskip("raybrook.dask")

REFERENCE = {"device": "reference"}


def rays(shape, seed=7):
    return np.random.default_rng(seed).random((*shape, 6), np.float32) * 4


def same(found, expected):
    found = dask.compute(*vars(found).values()) if hasattr(found, "__dict__") and not hasattr(found, "dask") else found
    if not isinstance(found, tuple):
        found, expected = (found.compute(),), (expected,)
    else:
        expected = tuple(vars(expected).values())
    for a, b in zip(found, expected, strict=True):
        assert (a.dtype, a.shape) == (b.dtype, b.shape) and a.tobytes() == b.tobytes()


def as_declared(array):
    """The array computed, which is what it was said to be."""
    computed = array.compute()
    assert (computed.dtype, computed.shape) == (array.dtype, array.shape)
    return computed


@pytest.mark.parametrize("shape", [(1000,), (30, 40), (), (0,), (3, 0)])
def test_answers_about_rays(shape):
    scene, given = Scene(SQUARES, SQUARES_FACES, **REFERENCE), rays(shape)
    same(lazy.trace(scene, given), scene.closest_hits(given))
    same(lazy.trace(scene, given, t_min=0.5, t_max=2), scene.closest_hits(given, t_min=0.5, t_max=2))
    for question in ("any_hit", "count", "count_crossings"):
        same(lazy.trace(scene, given, question), getattr(scene, question)(given))
    if given.size:
        chunked = da.from_array(given, chunks=(7,) * len(shape) + (4,))
        hits = lazy.trace(scene, chunked)
        assert hits.t.chunks == chunked.chunks[:-1] and hits.uv.chunks == (*chunked.chunks[:-1], (2,))
        same(hits, scene.closest_hits(given))


def test_rays_as_pairs_and_with_limits():
    scene = Scene(SQUARES, SQUARES_FACES, **REFERENCE)
    origins = rays((500,))[:, :3] * np.float32(1.5) + np.float32([0, 0, 3])
    down = np.array([0, 0, -1], np.float32)
    expected = scene.closest_hits((origins, down))
    assert expected.hit.any() and not expected.hit.all()
    same(lazy.trace(scene, (origins, down)), expected)
    same(lazy.trace(scene, (da.from_array(origins, chunks=(120, 2)), down)), expected)
    limited = np.concatenate([rays((500,)), np.tile(np.float32([0.25, 1]), (500, 1))], axis=1)
    same(lazy.trace(scene, limited, "count"), scene.count(limited))
    assert lazy.trace(scene, [[3, 1, 5, 0, 0, -1]], "any_hit").compute().tolist() == [True]


@pytest.mark.parametrize("origin", [None, (500.0, 0.0, 0.0)])
def test_answers_about_points(origin):
    move = np.array(origin or (0, 0, 0), np.float64)
    scene = Scene(CUBE + move, CUBE_FACES, origin=origin, **REFERENCE)
    points = np.random.default_rng(3).random((200, 3), np.float32) * 2 - np.float32(0.5)
    points = points + move if origin else points
    closest = lazy.query(scene, da.from_array(points, chunks=(64, -1)))
    assert closest.point.dtype == ("f8" if origin else "f4")
    same(closest, scene.closest_point(points))
    for question in ("contains", "distance", "signed_distance", "winding_number"):
        same(lazy.query(scene, points, question), getattr(scene, question)(points))


def test_nothing_is_traced_before_it_is_asked_for_and_once_for_all_arrays(monkeypatch):
    scene, given, calls = Scene(SQUARES, SQUARES_FACES, **REFERENCE), rays((100,)), []
    hits = lazy.trace(scene, da.from_array(given, chunks=(25, -1)))
    traced = Scene.closest_hits
    monkeypatch.setattr(Scene, "closest_hits", lambda *all, **named: calls.append(1) or traced(*all, **named))
    repr(hits.t)
    assert not calls
    dask.compute(*vars(hits).values())
    assert len(calls) == 4


def test_a_scene_is_taken_as_it_is_and_kept_while_it_stays():
    scene, given = Scene(SQUARE, SQUARE_FACES, **REFERENCE), [2, 1, 5, 0, 0, -1]
    before = lazy.trace(scene, given).t
    assert lazy.trace(scene, given).t.name == before.name
    assert lazy._shared(scene).compute() is lazy._shared(scene).compute()
    scene.update_vertices(SQUARE + np.float32([0, 0, 1]))
    after = lazy.trace(scene, given).t
    scene.add_mesh(SQUARE + np.float32([0, 0, 3]), SQUARE_FACES)
    last = lazy.trace(scene, given).t
    assert [float(t.compute()) for t in (before, after, last)] == [5, 4, 2]


def test_what_cannot_be_asked_is_refused_at_once_or_by_the_worker():
    scene = Scene(SQUARE, SQUARE_FACES, **REFERENCE)
    with pytest.raises(ValueError, match="question: 'list_hits' is none of closest_hits, any_hit"):
        lazy.trace(scene, rays((3,)), "list_hits")
    with pytest.raises(ValueError, match="'count' is none of closest_point"):
        lazy.query(scene, np.zeros((2, 3)), "count")
    with pytest.raises(ValueError, match="rays: the last dimension must be 6 or 8"):
        lazy.trace(scene, np.zeros((2, 5)))
    with pytest.raises(ValueError, match="rays: the last dimension must be 6 or 8"):
        lazy.trace(scene, da.zeros((2, 5)))
    with pytest.raises(TypeError, match="a raybrook.Scene is needed, not list"):
        lazy.trace([], rays((3,)))
    with pytest.raises(ValueError, match="tasks: 0 is below 1"):
        lazy.render(scene, 8, 8, tasks=0)
    with pytest.raises(raybrook.OptionError, match="reaches beyond"):
        lazy.render(scene, 8, 8, crop=(0, 0, 9, 8))
    with pytest.raises(raybrook.InputError, match="not closed"):
        lazy.query(scene, np.zeros((2, 3)), "contains").compute()
    with pytest.raises(raybrook.OptionError, match="nonsense"):
        lazy.trace(Scene(SQUARE, SQUARE_FACES, method="nonsense", **REFERENCE), rays((3,)), "count").compute()


def test_rounding_is_told_where_it_happens():
    scene = Scene(SQUARE, SQUARE_FACES, **REFERENCE)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        lazy.trace(scene, [[0.1, 1, 5, 0, 0, -1]], "any_hit").compute(scheduler="synchronous")
    assert [str(one.message)[:22] for one in told] == ["rays: 1 of 6 numbers a"]


VIEWS = [
    dict(width=300, height=1000, samples=4),
    dict(width=300, height=1000, samples=4, crop=(20, 300, 70, 640), tasks=3),
    dict(width=700, height=520, error=2.0),
    dict(width=700, height=520, error=2.0, tasks=1, depth=2),
    dict(width=700, height=520, error=1.0, crop=(3, 5, 500, 400), view="top"),
    dict(width=5000, height=40, error=8.0, tasks=7, eye=(3, 2, 7), target=(2, 2, 0), up="z", fov=50),
    dict(width=5000, height=40, error=8.0, crop=(10, 3, 4900, 30)),
    dict(),
]


@pytest.fixture(scope="module")
def small():
    return Scene(SQUARES * np.float32([1, 1, 2]), SQUARES_FACES, **REFERENCE)


@pytest.mark.parametrize("view", VIEWS)
def test_pictures_have_the_bits_of_one_machine(small, view, tmp_path):
    arguments = {name: value for name, value in view.items() if name != "tasks"}
    if not arguments:
        path = tmp_path / "ball.toml"
        path.write_text('[image]\nwidth = 70\nheight = 50\nsamples = 4\n[[object]]\nsolid = "sphere"\n')
        small = Scene.load(path, **REFERENCE)
    picture = small.render(**arguments)
    pixels = as_declared(lazy.render(small, **view))
    assert pixels.shape == picture.pixels.shape and np.ptp(pixels) > 0
    assert pixels.tobytes() == picture.pixels.tobytes()
    assert raybrook.Picture.from_pixels(pixels).to_srgb8().tobytes() == picture.to_srgb8().tobytes()


def test_pictures_have_as_many_tasks_as_are_asked_for(small):
    def tasks(**view):
        graph = lazy.render(small, **view).__dask_graph__()
        return sum(str(key).startswith("_render_blocks") for key in dict(graph))

    assert tasks(width=1024, height=2048, samples=1) == 16
    assert tasks(width=1024, height=2048, samples=1, tasks=4) == 4
    assert tasks(width=2048, height=2048, error=1.0) == 32
    assert tasks(width=2048, height=2048, error=1.0, tasks=4) == 4
    assert tasks(width=65535, height=65535, error=1.0) == 1024
    assert lazy.render(small, 65535, 65535, samples=1).shape == (65535, 65535, 3)


def test_pixels_that_are_no_picture_are_refused():
    for shape in ((4, 3), (2, 4, 4), (0, 4, 3), (3,)):
        with pytest.raises(ValueError, match="pixels|size"):
            raybrook.Picture.from_pixels(np.zeros(shape, np.float32))


def test_by_processes():
    scene = Scene.load(ROOT / "scenes" / "vase.obj", **REFERENCE)
    given = rays((2000,))
    hits = lazy.trace(scene, da.from_array(given, chunks=(500, -1)))
    with dask.config.set(scheduler="processes", num_workers=2):
        same(hits, scene.closest_hits(given))


def test_another_file_at_the_workers_is_told(tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = Scene.load(path, **REFERENCE)
    answer = lazy.trace(scene, [[0.25, 0.25, 1, 0, 0, -1]], "any_hit")
    sent = lazy._shared(scene).compute()
    again = lazy._received(*_of_another_process(sent))
    assert again.get() is not scene and again.get().any_hit([0.25, 0.25, 1, 0, 0, -1])
    assert answer.compute().tolist() == [True]
    path.write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(raybrook.InputError, match="mesh.obj: this worker's file differs"):
        lazy._received(*_of_another_process(sent)).get()
    other = lazy._SharedScene(sent.scene, sent.key, sent.digest, "0.0.1")
    with pytest.raises(raybrook.InputError, match="the scene comes from 0.0.1"):
        other.get()


def _of_another_process(sent):
    """What a worker that has not seen the scene yet makes of it."""
    import pickle

    scene, key, *rest = sent.__reduce__()[1]
    return pickle.loads(pickle.dumps(scene)), os.urandom(8).hex(), *rest


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    options = dict(n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True)
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        yield client


def opened_scenes():
    """Which scenes a worker has built."""
    import raybrook.dask

    return os.getpid(), [shared.key for shared in raybrook.dask._kept.values() if shared.scene._is_open]


def test_on_a_cluster_a_scene_is_built_once_for_each_worker(cluster):
    scene, given = Scene(SQUARES, SQUARES_FACES, **REFERENCE), rays((20_000,))
    for _ in range(2):
        same(lazy.trace(scene, da.from_array(given, chunks=(1000, -1))), scene.closest_hits(given))
    same(lazy.query(scene, given[:, :3]), scene.closest_point(given[:, :3]))
    found = cluster.run(opened_scenes)
    assert [len(keys) for _, keys in found.values()] == [1, 1]
    assert len({pid for pid, _ in found.values()}) == 2


@pytest.mark.parametrize("view", [{"samples": 16}, {"error": 0.25}])
def test_a_worker_that_is_killed_changes_no_bit(cluster, view):
    scene = Scene.load(ROOT / "scenes" / "vase.obj", **REFERENCE)
    expected = scene.render(640, 480, **view).pixels
    processes = list(cluster.run(os.getpid).values())
    future = cluster.compute(lazy.render(scene, 640, 480, tasks=12, **view))
    while not any(cluster.processing().values()):
        assert not future.done()
    os.kill(processes[0], 9)
    assert not future.done()
    assert future.result().tobytes() == expected.tobytes()
    assert processes[0] not in cluster.run(os.getpid).values()


def test_what_a_file_says_of_pictures_tells_scenes_apart(tmp_path):
    (tmp_path / "one.obj").write_text("v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n")
    for samples in (1, 16):
        text = f'[image]\nwidth = 12\nheight = 8\nsamples = {samples}\n[[object]]\nfile = "one.obj"\n'
        (tmp_path / "scene.toml").write_text(text)
        scene = Scene.load(tmp_path / "scene.toml", **REFERENCE)
        assert lazy.render(scene).compute().tobytes() == scene.render().pixels.tobytes(), samples
