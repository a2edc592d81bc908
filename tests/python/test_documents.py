"""The samples of the book and of the README are programs that work."""

import re
import subprocess
import sys
from importlib.util import find_spec

import pytest
from conftest import ROOT


def samples(path):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / path).read_text(), re.MULTILINE | re.DOTALL)


def run(program, folder):
    (folder / "scenes").symlink_to(ROOT / "scenes")
    path = folder / "sample.py"
    path.write_text(program)
    done = subprocess.run([sys.executable, path], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_the_readme_begins_with_python(tmp_path):
    fences = re.findall(r"^```(\w+)", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert fences[0] == "python"
    run(samples("README.md")[0], tmp_path)


def test_the_page_on_python(tmp_path):
    parts = samples("docs/book/src/python.md")
    if find_spec("trimesh") is None:
        parts = [part for part in parts if "import trimesh" not in part]
    run("\n".join(parts), tmp_path)


@pytest.mark.parametrize(("number", "needs"), [(0, "distributed"), (1, "multiprocessing")])
def test_the_page_on_many_cores_and_machines(number, needs, tmp_path):
    if find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed")
    run(samples("docs/book/src/many.md")[number], tmp_path)
