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


@pytest.mark.parametrize("falls_back", [True, False])
def test_the_reference_goes_on_if_that_is_wanted(library, falls_back):
    if not has_device():
        pytest.skip("there is no OpenCL device")
    fault = {"OPENCL_DYLIB_PATH": str(library), "OPENCL_FAULT": "from:clEnqueueReadBuffer:-5"}
    asked = subprocess.run(
        [sys.executable, "-c", ASK, str(falls_back)],
        env={**os.environ, **fault},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    begins = "the reference traces in place of" if falls_back else "DeviceError:"
    assert asked.stdout.startswith(begins) and "clEnqueueReadBuffer" in asked.stdout, asked
