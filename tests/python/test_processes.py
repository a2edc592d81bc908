"""Processes that are forked or spawned: each has the right answers, or an error that says what to do. None hangs."""

import subprocess
import sys

import pytest

HEAD = """
import concurrent.futures, multiprocessing, os, sys
import numpy as np
import raybrook

RAY = np.float32([0.25, 0.25, 1, 0, 0, -1])

def triangle(device, dtype=np.float32, **others):
    return raybrook.Scene(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype), [[0, 1, 2]], device=device, **others)

def ask(scene):
    return float(scene.closest_hits(RAY).t)

def told(work):
    try:
        work()
    except raybrook.DeviceError as error:
        return "spawn" in str(error)

def in_a_fork(work, end=os._exit):
    child = os.fork()
    if child == 0:
        result = 1
        try:
            result = 0 if work() else 2
        finally:
            end(result)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""

CASES = {
    # Nothing was started before the fork: parent and child open the device for themselves.
    "made before": """
scene = triangle(device)
in_a_fork(lambda: ask(scene) == 1)
assert ask(scene) == 1
in_a_fork(lambda: told(lambda: ask(scene)) and told(lambda: triangle(device).any_hit(RAY)))
""",
    "of few float64 numbers": """
scene = triangle(device, np.float64, origin="auto")
in_a_fork(lambda: ask(scene) == 1)
""",
    "with context of multiprocessing": """
scene = triangle(device)
with multiprocessing.get_context("fork").Pool(2) as pool:
    assert pool.map(ask, [scene] * 4) == [1] * 4
""",
    # What needs threads is refused, whatever the parent had used them for.
    "asked before": """
scene = triangle(device)
assert ask(scene) == 1
in_a_fork(lambda: told(lambda: ask(scene)) and told(lambda: triangle(device).distance(RAY[:3])))
in_a_fork(lambda: told(raybrook.devices) and told(lambda: scene.render(4, 4)) and told(lambda: scene.bounds))
in_a_fork(lambda: told(lambda: scene.update_vertices(np.ones((3, 3), np.float32))))
assert ask(scene) == 1
""",
    "listed before": """
raybrook.devices()
in_a_fork(lambda: told(lambda: ask(triangle(device))))
""",
    "loaded before": """
open("mesh.obj", "w").write("v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n")
scene = raybrook.Scene.load("mesh.obj", device=device)
in_a_fork(lambda: told(lambda: ask(scene)) and told(lambda: raybrook.Scene.load("mesh.obj")))
""",
    "rounded before": """
many = np.ones((20_000, 6))
scene = triangle(device)
raybrook._arrays.float32("many", many)
in_a_fork(lambda: told(lambda: ask(scene)) and told(lambda: raybrook._arrays.float32("many", many)))
""",
    "rendered before": """
picture = triangle(device).render(8, 6, samples=1)
in_a_fork(lambda: told(picture.to_srgb8) and told(lambda: picture.save("a.png")) and picture.pixels.shape == (6, 8, 3))
assert not os.path.exists("a.png")
""",
    # The child ends, and frees what it has of the parent's, by the usual way.
    "ended as usual": """
scene = triangle(device)
assert ask(scene) == 1
in_a_fork(lambda: told(lambda: ask(scene)), end=sys.exit)
def forget():
    global scene
    del scene
    return True
in_a_fork(forget, end=sys.exit)
in_a_fork(lambda: True, end=sys.exit)
""",
    "executors": """
scene = triangle(device)
assert ask(scene) == 1
fork, spawn = map(multiprocessing.get_context, ("fork", "spawn"))
with concurrent.futures.ProcessPoolExecutor(2, mp_context=fork) as pool:
    assert all(told(pool.submit(ask, scene).result) for _ in range(3))
with concurrent.futures.ProcessPoolExecutor(2, mp_context=spawn) as pool:
    assert list(pool.map(ask, [scene] * 3)) == [1] * 3
""",
}


@pytest.mark.parametrize("case", CASES)
def test_forked_and_spawned(case, device, tmp_path):
    if not hasattr(__import__("os"), "fork"):
        pytest.skip("this system has no fork")
    begin = f"device = {device!r}\n"
    path = tmp_path / "program.py"
    body = "\n".join(" " * 4 + line for line in (begin + CASES[case]).splitlines())
    path.write_text(f"{HEAD}\nif __name__ == '__main__':\n{body}\n")
    run = subprocess.run(
        [sys.executable, "-W", "ignore", path], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr
