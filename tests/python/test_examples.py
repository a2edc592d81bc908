"""The examples and benches work, and the exact judge agrees with raybrook."""

import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT

from raybrook import Scene

EXAMPLES = ROOT / "examples" / "python"
sys.path.insert(0, str(EXAMPLES))

from exact_judge import nearest  # noqa: E402
from hard_rays import aimed_rays, crumpled, knot, on_a_grid, sphere  # noqa: E402


@pytest.mark.parametrize("mesh", [sphere(2), crumpled(2), knot(60, 8)], ids=["sphere", "crumpled", "knot"])
def test_all_hits_are_the_exact_judges(mesh, device):
    vertices, faces = on_a_grid(mesh)
    rays = aimed_rays(vertices, faces, 600)
    right = nearest(vertices[faces], rays)
    scene = Scene(vertices, faces, device=device)
    hits = scene.closest_hits(rays)
    assert hits.hit.tolist() == list(map(bool, right))
    assert all(found in triangles for found, triangles in zip(hits.triangle, right) if triangles)
    assert np.array_equal(scene.any_hit(rays), hits.hit)
    assert sum(len(triangles) > 1 for triangles in right) > 100  # through edges and vertices, exactly


def test_the_judge_knows_what_is_easy():
    triangle = np.float32([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    rays = np.float32([[0.25, 0.25, 1, 0, 0, -1], [2, 2, 1, 0, 0, -1], [0, 0, 1, 0, 0, -1], [0.25, 0.25, 1, 0, 0, 1]])
    assert nearest(triangle, rays) == [{0}, set(), {0}, set()]
    assert nearest(triangle[:, ::-1], rays) == [{0}, set(), {0}, set()]


@pytest.mark.parametrize("model", [[], [ROOT / "scenes" / "vase.obj"]], ids=["made", "file"])
def test_the_table_of_rates(model, tmp_path):
    command = [sys.executable, ROOT / "benches" / "python" / "rates.py", *model, "--rays=400", "--rounds=1"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("\n| ") == 55


def test_the_models_of_the_table_of_rates(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benches" / "python")
    import rates

    vertices, faces = rates.MADE["voxels"]()
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(faces) == 256_820 and (np.abs(normals).sum(axis=1) == 1).all()
    # A closed surface, seen from outside: as much of it looks one way as the other, and it holds whole cubes.
    assert (normals.sum(axis=0) == 0).all()
    volume = np.einsum("ni,ni->", corners[:, 0], normals)
    assert volume > 0 and volume % 6 == 0
    vertices, faces = rates.MADE["landscape"]()
    corners = vertices[faces]
    ups = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert len(faces) == 498_002 and (ups == 1).all()


def test_the_simulation_of_many_machines(tmp_path):
    words = ["--machines=50", "--parts", "50", "400", "--runs=3"]
    run = subprocess.run([sys.executable, ROOT / "benches" / "scale.py", *words], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in run.stdout.splitlines() if line[:1] == "|"
    ]
    idle = [int(row[5].rstrip("%")) for row in rows if row[0] in ("50", "400")]
    # Of each of three pictures: more parts than machines leave fewer of these idle.
    assert len(idle) == 6 and all(few > 2 * many for few, many in zip(idle[::2], idle[1::2])), idle


def test_the_table_of_wrong_answers(tmp_path):
    model = ROOT / "scenes" / "vase.obj"
    command = [sys.executable, EXAMPLES / "wrong_answers.py", "--rays=200", model]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "| raybrook | 0 | 0 | 0 | 0 |" in run.stdout
