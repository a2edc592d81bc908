"""Long calls: progress, Ctrl-C, other threads; and memory."""

import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import ROOT


def many(count):
    random = np.random.default_rng(2)
    rays = random.random((count, 6), np.float32)
    rays[:, :3] *= 4
    return rays


def test_progress_goes_from_0_to_1(squares):
    told = []
    squares.closest_hits(many(300_000), progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1
    assert all(0 <= done <= 1 for done in told)


def test_what_progress_raises_stops_the_call(cube):
    class Enough(Exception):
        pass

    def enough(done):
        raise Enough(done)

    rays = many(400_000)
    for ask in (cube.closest_hits, cube.any_hit, cube.count, cube.list_hits, cube.count_crossings):
        with pytest.raises(Enough):
            ask(rays, progress=enough)
    points = np.ascontiguousarray(rays[:, :3])
    for ask in (cube.contains, cube.closest_point, cube.signed_distance, cube.winding_number):
        with pytest.raises(Enough):
            ask(points, progress=enough)
    with pytest.raises(Enough):
        cube.render(1000, 2000, samples=16, progress=enough)
    assert cube.any_hit([0.5, 0.25, 3, 0, 0, -1])


CALLS = ["closest_hits(rays)", "render(1000, 9000, samples=64)", "winding_number(rays[:, :3])"]


@pytest.mark.parametrize("call", CALLS)
def test_ctrl_c_stops_a_call(device, call):
    program = f"""
import numpy as np, raybrook, sys, time, threading, os, signal
scene = raybrook.Scene.load({str(ROOT / "scenes" / "vase.obj")!r}, device={device!r})
scene.any_hit(np.zeros((1, 6), np.float32))
if {"render" in call}:
    scene.render(8, 8, samples=64)  # nothing stops a compiler
rays = np.broadcast_to(np.float32([[0, 1, 5, 0, 0, -1]]), (30_000_000, 6)) if {"rays" in call} else None
rays = None if rays is None else np.ascontiguousarray(rays)
threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
start = time.time()
try:
    while True:
        scene.{call}
except KeyboardInterrupt:
    print("stopped", time.time() - start)
assert not scene.any_hit([[0, 0, 0, 0, 0, 0]]).any()
print("goes on")
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    words = run.stdout.split()
    assert words[0] == "stopped" and words[2:] == ["goes", "on"], run.stdout
    assert float(words[1]) < 10


def test_other_threads_go_on(squares):
    rays = many(3_000_000)
    squares.any_hit(rays[:1])
    ticks, is_over = [], threading.Event()

    def tick():
        while not is_over.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    squares.closest_hits(rays)
    end = time.perf_counter()
    is_over.set()
    thread.join()
    within = [moment for moment in ticks if start < moment < end]
    gaps = np.diff([start, *within, end])
    assert gaps.max() < max(0.5 * (end - start), 0.1)


MEMORY = """
import resource, sys
import numpy as np, raybrook
scene = raybrook.Scene.load(sys.argv[1])
rays = np.random.default_rng(3).random((4_000_000, 6), np.float32)
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
before = peak()
hits = scene.closest_hits(rays)
arrays = hits.t.nbytes + hits.triangle.nbytes + hits.mesh.nbytes + hits.uv.nbytes
beyond = peak() - before - arrays
assert beyond < 2**30, beyond
print(beyond)
"""


def test_many_rays_take_less_than_a_gibibyte_beyond_the_arrays():
    run = subprocess.run([sys.executable, "-c", MEMORY, ROOT / "scenes" / "vase.obj"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
