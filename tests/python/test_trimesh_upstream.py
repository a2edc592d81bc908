"""trimesh's own tests of its ray tracers, on ours: they come with trimesh's source distribution, of the version that is
installed."""

import os
import subprocess
import sys
import tarfile
import xml.etree.ElementTree as xml
from pathlib import Path

import pytest
from conftest import shared

pytest.importorskip("trimesh", reason="trimesh is not installed")
pytest.importorskip("manifold3d", reason="manifold3d, which one of trimesh's tests needs, is not installed")

HERE = Path(__file__).parent
TESTS = ("test_ray.py", "test_ray_upstream.py")
HOW_MANY = 30
DOWNLOAD_LIMIT_S = 60


@pytest.fixture(scope="module")
def models():
    """The models of trimesh's tests."""
    return shared("trimesh-models")


@pytest.fixture(scope="module")
def folder(models, tmp_path_factory):
    """A folder with trimesh's tests; without their models it is not needed."""
    import trimesh

    folder = tmp_path_factory.mktemp("trimesh")
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--no-deps",
        "--no-binary",
        ":all:",
        "--dest",
        folder,
    ]
    try:
        command.append(f"trimesh=={trimesh.__version__}")
        subprocess.run(command, check=True, capture_output=True, timeout=DOWNLOAD_LIMIT_S)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as failure:
        pytest.skip(f"trimesh's source distribution cannot be downloaded: {failure}")
    with tarfile.open(next(folder.glob("*.tar.gz"))) as archive:
        for member in archive.getmembers():
            name = Path(member.name)
            if name.parent.name == "tests" and name.name in TESTS:
                (folder / name.name).write_bytes(archive.extractfile(member).read())
    (folder / "generic.py").write_bytes((HERE / "upstream" / "generic.py").read_bytes())
    return folder


def test_all_of_trimeshs_ray_tests_pass(folder, models):
    report = folder / "report.xml"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "raybrook_in_trimesh", "-p", "no:cacheprovider"]
    command += [f"--rootdir={folder}", f"--junitxml={report}", *(folder / name for name in TESTS)]
    paths = os.pathsep.join([str(HERE / "upstream"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths, "TRIMESH_MODELS": str(models)}
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    suite = xml.parse(report).getroot().find("testsuite")
    counts = {key: int(suite.get(key)) for key in ("tests", "failures", "errors", "skipped")}
    assert counts == {"tests": HOW_MANY, "failures": 0, "errors": 0, "skipped": 0}, run.stdout
