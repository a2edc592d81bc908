"""A device that fails in the middle of the work: `fall_back` says whether the reference goes on."""

import os
import shutil
import subprocess
import sys

import pytest
from conftest import ROOT, has_device

ASK = """
import sys, warnings
import numpy as np
import raybrook

scene = raybrook.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], device="cpu", fall_back=sys.argv[1] == "True")
try:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        t = [float(scene.closest_hits(np.float32([0.25, 0.25, z, 0, 0, -1])).t) for z in (1, 2)]
    assert t == [1, 2] and scene.device == "reference", (t, scene.device)
    [warning] = told
    assert warning.category is raybrook.NoteWarning and warning.filename == "<string>", warning
    print(warning.message)
except raybrook.DeviceError as error:
    print("DeviceError:", error)
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """An OpenCL library that spoils calls."""
    rustc = shutil.which(os.environ.get("RUSTC", "rustc"))
    if rustc is None or sys.platform != "linux":
        pytest.skip("there is no Rust compiler for the library that spoils calls")
    made = tmp_path_factory.mktemp("faults") / "libopencl_faults.so"
    source = ROOT / "tests" / "faults" / "opencl_faults.rs"
    subprocess.run([rustc, "--edition", "2024", "--crate-type", "cdylib", "-o", made, source], check=True)
    return made


def run(library, fault, program, falls_back, **more):
    """What a program says whose calls of OpenCL are spoilt."""
    asked = subprocess.run(
        [sys.executable, "-c", program, str(falls_back)],
        env={**os.environ, "OPENCL_DYLIB_PATH": str(library), "OPENCL_FAULT": fault, **more},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert asked.returncode == 0, asked
    return asked


@pytest.mark.parametrize("call", ["clEnqueueReadBuffer", "clEnqueueMapBuffer", "clEnqueueUnmapMemObject"])
@pytest.mark.parametrize("falls_back", [True, False])
def test_the_reference_goes_on_if_that_is_wanted(library, falls_back, call):
    if not has_device():
        pytest.skip("there is no OpenCL device")
    asked = run(library, f"from:{call}:-5", ASK, falls_back)
    begins = "the reference traces in place of" if falls_back else "DeviceError:"
    assert asked.stdout.startswith(begins) and call in asked.stdout, asked


SHARE = """
import sys, warnings
import numpy as np
import raybrook

rays = np.zeros((600_000, 6), np.float32)  # three runs of a processor
rays[:] = [0.25, 0.25, 1, 0, 0, -1]
rays[:, 0] += np.arange(len(rays), dtype=np.float32) / len(rays)
mesh = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
try:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        scene = raybrook.Scene(*mesh, device="all", fall_back=sys.argv[1] == "True")
        print(scene.device)
        hits = scene.closest_hits(rays)
        any_hit = scene.any_hit(rays)
    print(scene.device, *(warning.message for warning in told), sep="\\n")
    assert all(warning.category is raybrook.NoteWarning for warning in told), told
    one = raybrook.Scene(*mesh, device="reference")
    expected = one.closest_hits(rays)
    assert hits.t.tobytes() == expected.t.tobytes() and (hits.triangle == expected.triangle).all()
    assert (any_hit == one.any_hit(rays)).all() and 0 < any_hit.sum() < len(rays)
except raybrook.DeviceError as error:
    print("DeviceError:", error)
"""

OTHERS, REFERENCE = "the other devices trace in place of", "the reference traces in place of"


@pytest.mark.parametrize(
    ("fault", "falls_back", "told"),
    [
        ("", False, []),
        ("only:clEnqueueReadBuffer:-36", False, [OTHERS]),
        ("from:clEnqueueReadBuffer:-36", True, [OTHERS, REFERENCE]),
        ("from:clEnqueueReadBuffer:-36", False, ["DeviceError:"]),
    ],
)
def test_devices_share_the_work_and_go_on_without_those_that_are_lost(library, fault, falls_back, told):
    if not has_device():
        pytest.skip("there is no OpenCL device")
    # PoCL has two kinds of devices for the same processor.
    asked = run(library, fault, SHARE, falls_back, POCL_DEVICES="pthread basic")
    devices, *said = asked.stdout.splitlines()
    if " + " not in devices:
        pytest.skip("there is but one device")
    if told == ["DeviceError:"]:
        assert len(said) == 1 and said[0].startswith(told[0]) and "clEnqueueReadBuffer" in said[0], asked
        return
    after, *notes = said
    assert len(after.split(" + ")) == 2 - told.count(OTHERS), asked
    assert (after == "reference") == (REFERENCE in told) and len(notes) == len(told), asked
    for note, begins in zip(notes, told, strict=True):
        assert note.startswith(begins) and "clEnqueueReadBuffer" in note, asked
