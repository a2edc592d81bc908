"""What the scripts of this folder share: runs of the program in folders of their own, and the table of what failed."""

import os
import signal
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib

# Seconds; a run that takes longer hangs.
LIMIT = 120


class Table:
    """Rows of kind, runs and failures; the first few failures of each kind are told on standard error."""

    SHOWN = 5

    def __init__(self):
        self.rows = {}

    def add(self, kind, fault=None):
        runs, failures = self.rows.get(kind, (0, 0))
        self.rows[kind] = (runs + 1, failures + (fault is not None))
        if fault is not None and failures < self.SHOWN:
            print(f"{kind}: {fault}", file=sys.stderr)

    def end(self):
        """Prints the table and ends the script."""
        print("kind, runs, failures")
        for kind, (runs, failures) in self.rows.items():
            print(f"{kind}, {runs}, {failures}")
        sys.exit(any(failures for _, failures in self.rows.values()))


def arguments(about):
    """The program and how many runs of each kind."""
    if len(sys.argv) not in (2, 3):
        sys.exit(f"{about}\nusage: {sys.argv[0]} PATH/OF/raybrook [COUNT]")
    return os.path.abspath(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else 20


def environment(folder):
    changed = dict(os.environ, RAYBROOK_CACHE_DIR=os.path.join(folder, "cache"))
    changed.pop("RAYBROOK_DEVICE", None)
    return changed


def faults_library(folder):
    """The library of opencl_faults.rs; FAULTS_LIBRARY names one that is compiled already. None without a compiler."""
    if given := os.environ.get("FAULTS_LIBRARY"):
        return given
    source = os.path.join(os.path.dirname(os.path.abspath(__file__)), "opencl_faults.rs")
    path = os.path.join(folder, "libopencl_faults.so")
    words = ["rustc", "--edition", "2024", "--crate-type", "cdylib", "-o", path, source]
    try:
        made = subprocess.run(words, capture_output=True)
    except FileNotFoundError:
        return None
    return path if made.returncode == 0 else None


def run(program, folder, words, **more):
    """Exit code and both outputs, as bytes; None for an output that goes elsewhere."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL, **more}
    try:
        ended = subprocess.run([program, *words], cwd=folder, env=environment(folder), timeout=LIMIT, **options)
    except subprocess.TimeoutExpired:
        return "hangs", b"", b""
    return ended.returncode, ended.stdout, ended.stderr


def png(width, height, value):
    """A grey picture."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    rows = b"".join(b"\0" + bytes([value]) * width for _ in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def is_png(data):
    """Whether a picture is whole: every chunk's sum, and the last one."""
    at = 8
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        name_and_data = data[at + 4 : at + 8 + length]
        if struct.pack(">I", zlib.crc32(name_and_data)) != data[at + 8 + length : at + 12 + length]:
            return False
        at += 12 + length
        if name_and_data[:4] == b"IEND":
            return at == len(data)
    return False


def npz(path, arrays, times=1):
    """Writes float32 arrays of three columns: name and rows, which come so many times."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, rows in arrays.items():
            text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({len(rows) * times}, 3), }}"
            text = text.ljust(117) + "\n"
            data = b"".join(struct.pack("<3f", *row) for row in rows) * times
            archive.writestr(name + ".npy", b"\x93NUMPY\x01\0" + struct.pack("<H", len(text)) + text.encode() + data)


def sphere(segments):
    """The text of an OBJ file with texture coordinates: a grid on a sphere."""
    import math

    lines = ["mtllib model.mtl", "usemtl skin"]
    for i in range(segments + 1):
        for j in range(segments + 1):
            a, b = math.pi * i / segments, 2 * math.pi * j / segments
            lines.append(f"v {math.sin(a) * math.cos(b)} {math.cos(a)} {math.sin(a) * math.sin(b)}")
            lines.append(f"vt {j / segments} {1 - i / segments}")
    for i in range(segments):
        for j in range(segments):
            k = i * (segments + 1) + j + 1
            corners = [k, k + 1, k + segments + 2, k + segments + 1]
            lines.append("f " + " ".join(f"{c}/{c}" for c in corners))
    return "\n".join(lines) + "\n"


def write(folder, name, data):
    path = os.path.join(folder, name)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as file:
        file.write(data.encode() if isinstance(data, str) else data)
    return path


def scene(folder, segments=24):
    """A model with a library and a texture that has the name of the model, a scene of it, and rays."""
    write(folder, "model.obj", sphere(segments))
    write(folder, "model.mtl", "newmtl skin\nKd 1 1 1\nmap_Kd model.png\nmap_Bump bump.png\n")
    write(folder, "model.png", png(16, 16, 200))
    write(folder, "bump.png", png(4, 4, 10))
    write(folder, "heights.png", png(4, 4, 90))
    write(folder, "floor.png", png(4, 4, 60))
    write(
        folder,
        "scene.toml",
        '[material.m]\ndiffuse = 1\ntexture = "floor.png"\n[[object]]\nfile = "model.obj"\n'
        '[[object]]\nsolid = "height-field"\nmaterial = "m"\nsize = [4, 4]\npicture = "heights.png"\nheight = 0.2\n',
    )
    rays = [(0.001 * i - 1.0, 0.3, 3.0) for i in range(2000)]
    npz(os.path.join(folder, "rays.npz"), {"origin": rays, "direction": [(0.0, 0.0, -1.0)] * len(rays)})


def files(folder):
    """Every file below a folder and what is in it, but for the cache."""
    found = {}
    for where, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if os.path.join(where, name) != os.path.join(folder, "cache")]
        for name in names:
            path = os.path.join(where, name)
            if os.path.isfile(path):
                with open(path, "rb") as file:
                    found[os.path.relpath(path, folder)] = file.read()
    return found


def outputs(folder):
    """What a run has written, but for what it keeps."""
    kept = (".partial", "-turntable.json")
    return {name: data for name, data in files(folder).items() if name.startswith("out") and not name.endswith(kept)}


def clear(folder):
    """Removes what a run has written and kept."""
    for name in files(folder):
        if name.startswith("out"):
            os.remove(os.path.join(folder, name))


def new_folder():
    return tempfile.TemporaryDirectory(prefix="raybrook-faults-")


SIGNALS = {"SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM, "SIGKILL": signal.SIGKILL}
