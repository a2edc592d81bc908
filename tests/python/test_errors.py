"""Errors and notes: of the command line's kinds and in its words."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, SQUARES, SQUARES_FACES, down

import raybrook
from raybrook import Scene


def test_kinds_of_errors():
    scene = Scene(SQUARES, SQUARES_FACES, method="unheard-of")
    with pytest.raises(raybrook.OptionError, match="unheard-of") as caught:
        scene.any_hit([down(1, 1)])
    assert isinstance(caught.value, (raybrook.Error, ValueError)) and caught.value.exit_code == 2
    with pytest.raises(raybrook.OptionError, match="precision: 'best' is neither"):
        Scene(SQUARES, SQUARES_FACES, precision="best")
    with pytest.raises(raybrook.InputError, match="triangle 3 names vertex 99") as caught:
        Scene(SQUARES, np.where(SQUARES_FACES == 7, 99, SQUARES_FACES))
    assert caught.value.exit_code == 3
    with pytest.raises(raybrook.InputError, match="vertex 0 of the mesh is .NaN"):
        Scene(SQUARES * np.float32(np.nan), SQUARES_FACES)
    with pytest.raises(raybrook.DeviceError, match="toaster") as caught:
        Scene(SQUARES, SQUARES_FACES, device="toaster").any_hit([down(1, 1)])
    assert caught.value.exit_code == 4
    with pytest.raises(raybrook.OutputError, match="nowhere") as caught:
        Scene(SQUARES, SQUARES_FACES, device="reference").preview().save("/nowhere/picture.png")
    assert caught.value.exit_code == 5
    with pytest.raises(raybrook.OutOfMemoryError, match="memory") as caught:
        Scene(SQUARES, SQUARES_FACES, device="reference", memory_limit=1000).render(4000, 4000)
    assert isinstance(caught.value, MemoryError) and caught.value.exit_code == 4


def test_a_mesh_at_fault_is_named():
    scene = Scene(SQUARES, SQUARES_FACES)
    scene.add_mesh(SQUARES, SQUARES_FACES + 1)
    with pytest.raises(raybrook.InputError, match="mesh 1: .*triangle 3 names vertex 8"):
        scene.any_hit([down(1, 1)])


def command_line(*words, **options):
    command = [sys.executable, "-m", "raybrook", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, **options)


def test_the_words_are_the_command_lines(tmp_path):
    path = tmp_path / "broken.obj"
    path.write_text("v 0 0 0\nf 1 2 3\n")
    with pytest.raises(raybrook.InputError) as caught:
        Scene.load(path)
    run = command_line("info", path)
    assert run.returncode == caught.value.exit_code == 3
    assert run.stderr.strip() == f"raybrook: {caught.value}"


def test_the_command_line():
    run = command_line("--version")
    assert (run.returncode, run.stdout) == (0, f"raybrook {raybrook.__version__}\n")
    assert command_line("render", "--unheard-of").returncode == 2
    assert command_line("info", "nowhere.obj").returncode == 3
    help_text = command_line("--help").stdout
    assert "Usage: raybrook" in help_text and "python" not in help_text
    script = Path(sys.executable).parent / "raybrook"
    if script.exists():
        assert subprocess.run([script, "--version"], capture_output=True, text=True).stdout == run.stdout


def test_the_command_line_is_stopped_as_the_program(tmp_path):
    scene = ROOT / "scenes" / "vase.obj"
    words = ["render", scene, "--size", "3000x3000", "--samples", "256", "--device", "reference", "-o", "vase.png"]
    run = subprocess.Popen(
        [sys.executable, "-m", "raybrook", *map(str, words)], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    time.sleep(1)
    run.send_signal(signal.SIGINT)
    assert "stopped by SIGINT" in run.communicate(timeout=30)[1]
    assert run.returncode == 128 + signal.SIGINT
    # What is finished is kept, and nothing else.
    assert {path.name for path in tmp_path.iterdir()} <= {"vase.png.partial"}


def test_pictures_of_the_command_line_are_the_packages(tmp_path):
    scene = ROOT / "scenes" / "vase.obj"
    options = ["--size", "40x30", "--samples", "4", "--device", "reference", "-o", tmp_path / "cli.pfm"]
    assert command_line("render", scene, *options).returncode == 0
    Scene.load(scene, device="reference").render(40, 30, samples=4).save(tmp_path / "package.pfm")
    assert (tmp_path / "cli.pfm").read_bytes() == (tmp_path / "package.pfm").read_bytes()


WITHOUT_OPENCL = """
import os, warnings
os.environ["OCL_ICD_VENDORS"] = "/nowhere"
import raybrook
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    for _ in range(2):
        scene = raybrook.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        assert scene.any_hit([0.25, 0.25, 1, 0, 0, -1])
        assert scene.device == "reference"
assert len(told) == 1 and told[0].category is raybrook.NoteWarning, [str(t.message) for t in told]
print(told[0].message)
"""


def test_without_opencl_the_reference_answers_with_one_warning():
    run = subprocess.run([sys.executable, "-c", WITHOUT_OPENCL], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "reference" in run.stdout


def test_devices():
    for device in raybrook.devices():
        assert device.name and device.platform and device.kind
        assert device.unusable is None or isinstance(device.unusable, str)


def test_a_variable_names_the_device(monkeypatch):
    monkeypatch.setenv("RAYBROOK_DEVICE", "reference")
    assert Scene(SQUARES, SQUARES_FACES).device == "reference"
    monkeypatch.setenv("RAYBROOK_DEVICE", "toaster")
    with pytest.raises(raybrook.DeviceError, match="toaster"):
        Scene(SQUARES, SQUARES_FACES).any_hit([down(1, 1)])
    assert Scene(SQUARES, SQUARES_FACES, device="reference").any_hit(down(1, 1))
