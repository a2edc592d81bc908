"""Tries an installed wheel: a batch of rays, a picture, the program. ``python try_wheel.py VERSION``, beside vase.obj.

Asserts what is right on every machine, on the device that is chosen and on the scalar reference.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np

import raybrook

assert raybrook.__version__ == sys.argv[1], raybrook.__version__
rays = np.random.default_rng(0).random((10_000, 6), np.float32) * 2 - 1
answers = []
for device in (None, "reference"):
    scene = raybrook.Scene.load("vase.obj", device=device)
    hits, picture = scene.closest_hits(rays), scene.render(160, 120, error=2.0)
    assert 0 < hits.hit.sum() < len(rays) and np.ptp(picture.pixels) > 0.1
    answers.append((hits.t.tobytes(), hits.triangle.tobytes(), picture.pixels.tobytes()))
    print(f"{scene.device}: {hits.hit.sum()} of {len(rays)} rays hit")
assert answers[0] == answers[1], "the device and the reference differ"

program = [sys.executable, "-m", "raybrook"]
told = subprocess.run([*program, "--version"], check=True, capture_output=True, text=True).stdout
assert told.split() == ["raybrook", sys.argv[1]], told
subprocess.run([*program, "render", "vase.obj", "--size", "160x120", "-o", "vase.png"], check=True)
assert Path("vase.png").read_bytes().startswith(b"\x89PNG")
np.savez("rays.npz", origin=rays[:, :3], direction=rays[:, 3:])
subprocess.run([*program, "trace", "vase.obj", "rays.npz", "-o", "hits.npz"], check=True)
assert np.load("hits.npz")["t"][hits.hit].tobytes() == hits.t[hits.hit].tobytes()
print("the wheel works")
