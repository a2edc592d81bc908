#!/usr/bin/env python3
"""Breaks input files at random, gives them to raybrook, and counts how it takes that.

Small files of every format that raybrook reads (the project's own scenes, and some made here) are changed by bytes,
cuts, insertions, numbers, and words, and each is rendered, described, or traced on the reference under a limit of time
and memory. Whatever happens, the program must end by itself with a documented exit code. The same seed makes the same
files.

    tests/faults/mutate.py target/debug/raybrook --runs 1000 --seed 1 --keep failing

prints one row a kind of file (`kind, runs, failures`), then one line a failure, and ends with 1 when there is one.
Needs Python 3.8 and nothing else.
"""

import argparse
import base64
import io
import json
import os
import random
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib

DOCUMENTED = {0, 2, 3, 4, 5}  # 1 is for commands that compare
ADDRESS_SPACE = 2 << 30  # of one run, bytes

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

EXTREMES = [
    b"0", b"-0", b"1", b"-1", b"2", b"nan", b"inf", b"-inf",
    b"1e38", b"-3.4e38", b"3.5e38", b"1e39", b"1e-45", b"1e-38", b"1e308", b"1e999",
    b"255", b"256", b"4095", b"4096", b"4097", b"65535", b"65536",
    b"2147483647", b"2147483648", b"4294967295", b"4294967296", b"-2147483649",
    b"9223372036854775807", b"18446744073709551616", b"1e1000000000",
    b"0x10", b"1_000", b".", b"", b"99999999999999999999999999999999",
]
EXTREME_BYTES = [
    b"\x00\x00\x00\x00", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80",
    b"\x00\x00\x80\x7f", b"\x00\x00\x80\xff", b"\x00\x00\xc0\x7f",
    b"\x7f\x7f\x7f\x7f", b"\x01\x00\x00\x00", b"\x00\x00\x00\x01",
]


def ply(order, smooth):
    """A tetrahedron as PLY: `order` is "ascii", "<" or ">"."""
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    name = {"ascii": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        "ply\nformat %s 1.0\ncomment made\nelement vertex %d\n"
        "property float x\nproperty float y\nproperty float z\n" % (name, len(points))
    )
    if smooth:
        head += (
            "property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\n"
            "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        )
    head += "element face %d\nproperty list uchar int vertex_indices\nend_header\n" % len(faces)
    rows = []
    for i, p in enumerate(points):
        extra = (0, 0, 1, 0.5, 0.25 * i, 10 * i, 20, 250) if smooth else ()
        if order == "ascii":
            rows.append((" ".join(str(x) for x in p + extra) + "\n").encode())
        else:
            rows.append(struct.pack(order + ("8f3B" if smooth else "3f"), *(p + extra)))
    for f in faces:
        rows.append(b"3 %d %d %d\n" % f if order == "ascii" else struct.pack(order + "B3i", 3, *f))
    return head.encode() + b"".join(rows)


def stl(binary):
    corners = [((0, 0, 0), (1, 0, 0), (0, 1, 0)), ((0, 0, 0), (0, 1, 0), (0, 0, 1))]
    if binary:
        facets = b"".join(struct.pack("<12fH", 0, 0, 0, *[x for p in t for x in p], 0) for t in corners)
        return b"made".ljust(80, b" ") + struct.pack("<I", len(corners)) + facets
    text = "solid made\n"
    for t in corners:
        text += "facet normal 0 0 0\nouter loop\n" + "".join("vertex %g %g %g\n" % p for p in t) + "endloop\nendfacet\n"
    return (text + "endsolid made\n").encode()


def png(width=4, height=4):
    rows = b"".join(b"\x00" + bytes((17 * x * y + x) % 256 for x in range(3 * width)) for y in range(height))
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    )


def gltf(binary):
    """A tetrahedron in two places, one of its points sparse, with a texture, a camera and a light."""
    parts = [struct.pack("<12f", 0, 0, 0, 9, 9, 9, 0, 1, 0, 0, 0, 1), bytes([0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3]),
             b"\x01\0\0\0", struct.pack("<3f", 1, 0, 0), struct.pack("<8f", 0, 0, 1, 0, 0, 1, 1, 1), png()]
    views, data = [], b""
    for part in parts:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part)})
        data += part.ljust(-(-len(part) // 4) * 4, b"\0")
    buffer = {"byteLength": len(data)}
    if not binary:
        buffer["uri"] = "data:;base64," + base64.b64encode(data).decode()
    text = json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "buffers": [buffer], "bufferViews": views,
        "nodes": [{"mesh": 0, "children": [1, 2]}, {"mesh": 0, "translation": [2, 0, 0], "rotation": [0, 0, 0.6, 0.8]},
                  {"camera": 0, "translation": [1, 0, 5], "extensions": {"KHR_lights_punctual": {"light": 0}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
                          "count": 1, "indices": {"bufferView": 2, "componentType": 5121},
                          "values": {"bufferView": 3}}},
                      {"bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR"},
                      {"bufferView": 4, "componentType": 5126, "count": 4, "type": "VEC2"}],
        "materials": [{"alphaMode": "BLEND", "pbrMetallicRoughness": {
                           "baseColorFactor": [1, 1, 1, 0.5], "roughnessFactor": 0.3,
                           "baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}], "images": [{"bufferView": 5}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "extensions": {"KHR_lights_punctual": {"lights": [
                           {"type": "spot", "intensity": 40, "spot": {"outerConeAngle": 0.5}}]}},
    }).encode()
    if not binary:
        return text
    text = text.ljust(-(-len(text) // 4) * 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(data)) + b"BIN\0" + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


OFF = b"""STCNOFF
4 3 0
0 0 0 0 0 1 255 0 0 255 0 0
1 0 0 0 0 1 0 255 0 255 1 0
1 1 0 0 0 1 0 0 255 128 1 1
0 1 0 0 0 1 9 9 9 255 0 1
4 0 1 2 3 1 0 0
3 0 1 2 0.5 0.5 0.5
3 2 1 0
"""

THREEMF = b"""<?xml version="1.0"?>
<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>
<basematerials id="5"><base name="a" displaycolor="#FF0000"/><base name="b" displaycolor="#00FF0080"/></basematerials>
<object id="1" pid="5" pindex="0"><mesh><vertices>\
<vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/></vertices>
<triangles><triangle v1="0" v2="1" v3="2" pid="5" p1="0" p2="1"/>\
<triangle v1="2" v2="1" v3="0"/></triangles></mesh></object>
<object id="2"><components><component objectid="1"/>\
<component objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"/></components></object>
</resources><build><item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 0 0"/></build></model>
"""


def threemf(compression):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        archive.writestr(zipfile.ZipInfo("3D/3dmodel.model"), THREEMF, compression)
    return file.getvalue()


def npy(rows, columns, numbers):
    shape = "(%d,)" % rows if columns == 1 else "(%d, %d)" % (rows, columns)
    text = "{'descr': '<f4', 'fortran_order': False, 'shape': %s, }" % shape
    text += " " * (63 - (len(text) + 10) % 64) + "\n"
    return (
        b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()
        + struct.pack("<%df" % len(numbers), *numbers)
    )


def npz(compression, second):
    arrays = {
        "origin": npy(3, 3, [0.2, 0.2, 5] * 3),
        "direction": npy(3, 3, [0, 0, -1] * 3),
        "t_max": npy(3, 1, [9, 8, 7]),
    }
    if second:
        arrays["next_direction"] = npy(3, 3, [0, 1, 1] * 3)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for name, data in arrays.items():
            archive.writestr(zipfile.ZipInfo(name + ".npy"), data, compression)
    return file.getvalue()


OBJ = b"""mtllib made.mtl
v 0 0 0
v 1 0 0
v 1 1 0.5
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
usemtl red
f 1/1/1 2/2/1 3/3/1 4
usemtl glass
f -4 -3 -1
"""
MTL = (
    b"newmtl red\nKd 0.8 0.1 0.1\nKs 0.5 0.5 0.5\nNs 20\nmap_Kd made.png\n"
    b"newmtl glass\nd 0.1\nNi 1.5\nTf 1 1 0.9\nillum 7\n"
)
NFF = b"""b 0.1 0.2 0.3
v
from 2 1.5 4
at 0 0 0
up 0 1 0
angle 40
hither 1
resolution 8 8
l 4 3 2
f 0.9 0.2 0.3 0.5 0.5 3 0 1
p 3
0 0 0
1 0 0
0 1 0
pp 3
0 0 1 0 0 1
1 0 1 0 0 1
0 1 1 0 0 1
s 0 0.5 0 0.25
c
0 0 0 0.2
0 1 0 0
"""
TOML = b"""[image]
width = 8
height = 8
samples = 1

[camera]
eye = [2.0, 1.5, 4.0]
target = [0.0, 0.5, 0.0]
fov = 40

[trace]
depth = 4
ambient = [0.2, 0.2, 0.2]
background = { bottom = [0.1, 0.1, 0.2], top = [0.5, 0.6, 1.0] }

[[light]]
kind = "spot"
position = [3, 4, 5]
target = [0, 0, 0]
intensity = 2
outer = 30
falloff = "quadratic"

[material.red]
diffuse = [0.8, 0.1, 0.1]
specular = 0.5
shininess = 40
mirror = 0.2

[material.wood]
texture = { kind = "wood", scale = 0.3, turbulence = 0.6, octaves = 3, seed = 1 }

[material.made]
texture = "made.png"
toon = { steps = 3 }

[[object]]
solid = "sphere"
radius = 0.5
segments = 8
material = "red"
translate = [0.1, 0.5, 0.0]
rotate = [10, 20, 30]

[[object]]
solid = "torus"
segments = 8
sides = 6
major-radius = 1.0
minor-radius = 0.2
material = "wood"
instances = [{ translate = [0, 1, 0] }, { translate = [1, 0, 0], scale = 0.5, material = "made" }]

[[object]]
solid = "height-field"
formula = "noise"
amplitude = 0.2
frequency = 3
seed = 7
segments = 8

[[object]]
file = "made.obj"
scale = [1, 2, 1]
"""


def own(name):
    with open(os.path.join(REPOSITORY, "scenes", name), "rb") as file:
        return file.read()


def kinds():
    """Of each kind the name of the file that is changed, how it is used, and what it is before."""
    scene, rays = ["render", "info", "trace"], ["rays"]
    return {
        "toml": ("made.toml", scene, [TOML, own("spheres.toml")]),
        "obj": ("made.obj", scene, [OBJ]),
        "mtl": ("made.mtl", ["obj"], [MTL]),
        "ply ascii": ("made.ply", scene, [ply("ascii", False), ply("ascii", True)]),
        "ply binary": ("made.ply", scene, [ply("<", False), ply("<", True), ply(">", True)]),
        "stl ascii": ("made.stl", scene, [stl(False)]),
        "stl binary": ("made.stl", scene, [stl(True)]),
        "gltf": ("made.gltf", scene, [gltf(False)]),
        "glb": ("made.glb", scene, [gltf(True)]),
        "off": ("made.off", scene, [OFF]),
        "3mf": ("made.3mf", scene, [threemf(zipfile.ZIP_STORED), threemf(zipfile.ZIP_DEFLATED)]),
        "nff": ("made.nff", scene, [NFF]),
        "npz": ("made.npz", rays, [npz(zipfile.ZIP_STORED, False), npz(zipfile.ZIP_DEFLATED, True)]),
        "png": ("made.png", ["obj"], [png(), png(7, 3)]),
    }


def mutate(rng, data):
    """`data` with one to four changes."""
    for _ in range(rng.choice([1, 1, 1, 2, 3, 4])):
        data = rng.choice([flip, cut, insert, number, number, swap, word, repeat])(rng, data)
    return data


def flip(rng, data):
    if not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def cut(rng, data):
    ends = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return data[: ends[0]] if rng.random() < 0.5 else data[: ends[0]] + data[ends[1] :]


def insert(rng, data):
    at = rng.randrange(len(data) + 1)
    what = rng.choice([
        bytes(rng.randrange(256) for _ in range(rng.randrange(1, 9))), rng.choice(EXTREMES), rng.choice(EXTREME_BYTES)
    ])
    return data[:at] + what + data[at:]


def number(rng, data):
    places = list(re.finditer(rb"-?[0-9][0-9.eE+-]*", data))
    if not places or rng.random() < 0.2:
        at = rng.randrange(len(data) + 1)
        return data[:at] + rng.choice(EXTREME_BYTES) + data[at + 4 :]
    place = rng.choice(places)
    return data[: place.start()] + rng.choice(EXTREMES) + data[place.end() :]


def words_of(data):
    return list(re.finditer(rb"[A-Za-z_][A-Za-z_0-9-]*", data))


def swap(rng, data):
    places = words_of(data)
    if len(places) < 2:
        return flip(rng, data)
    one, other = sorted(rng.sample(places, 2), key=lambda place: place.start())
    return data[: one.start()] + other.group() + data[one.end() : other.start()] + one.group() + data[other.end() :]


def word(rng, data):
    places = words_of(data)
    if not places:
        return flip(rng, data)
    place = rng.choice(places)
    return data[: place.start()] + rng.choice(places).group() + data[place.end() :]


def repeat(rng, data):
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    times = rng.choice([1, 2, 50])
    return b"\n".join(lines[:at] + [lines[at]] * times + lines[at:])


def command(rng, binary, name, uses):
    use = rng.choice(uses)
    tail = ["--device", "reference", "-q"]
    scene = name if use not in ("obj", "rays") else "made.obj"
    if use == "info":
        return [
            binary, "info", scene, "-q",
            "--structure", rng.choice(["bvh2", "bvh8", "kd", "grid", "octree", "instances"]),
        ]
    if use in ("trace", "rays"):
        rays = name if use == "rays" else "made.npz"
        return [binary, "trace", scene, rays, "-o", "out.npz"] + (["--any-hit"] if rng.random() < 0.3 else []) + tail
    # A bare name's own size would take long.
    return [binary, "render", scene, "-o", "out.png", "--size", "8x8", "--samples", "1"] + tail


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def run(argv, folder, timeout):
    """What went wrong, or None."""
    env = dict(os.environ, RAYON_NUM_THREADS="2", RAYBROOK_CACHE_DIR=os.path.join(folder, "cache"))
    try:
        done = subprocess.run(
            argv, cwd=folder, env=env, timeout=timeout, preexec_fn=limited,
            stdin=subprocess.DEVNULL, capture_output=True,
        )
    except subprocess.TimeoutExpired:
        return "hangs", b""
    if done.returncode in DOCUMENTED:
        if done.returncode and not done.stderr.strip():
            return "no message with code %d" % done.returncode, b""
        if any(byte < 32 and byte not in (9, 10) or byte == 127 for byte in done.stderr):
            return "control characters in a message", done.stderr
        return None
    what = {101: "panic", -6: "abort"}.get(done.returncode, "ends with %d" % done.returncode)
    return what, done.stderr


def write(folder, name, data):
    with open(os.path.join(folder, name), "wb") as file:
        file.write(data)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("binary", help="the program")
    parser.add_argument("--runs", type=int, default=100, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", choices=sorted(kinds()), help="instead of all")
    parser.add_argument("--timeout", type=float, default=20, help="seconds of one run")
    parser.add_argument("--keep", metavar="DIR", help="keep the files of failing runs there")
    args = parser.parse_args()
    binary = os.path.abspath(args.binary)
    failures = []
    print("kind, runs, failures", flush=True)
    for kind, (name, uses, sources) in kinds().items():
        if args.kinds and kind not in args.kinds:
            continue
        failed = 0
        with tempfile.TemporaryDirectory() as folder:
            for index in range(args.runs):
                rng = random.Random("%d %s %d" % (args.seed, kind, index))
                for other, data in {
                    "made.obj": OBJ, "made.mtl": MTL, "made.png": png(), "made.npz": npz(zipfile.ZIP_STORED, True)
                }.items():
                    write(folder, other, data)
                write(folder, name, mutate(rng, rng.choice(sources)))
                argv = command(rng, binary, name, uses)
                fault = run(argv, folder, args.timeout)
                if fault is None:
                    continue
                failed += 1
                what, text = fault
                failures.append("%s, run %d: %s: %s: %s" % (
                    kind, index, what, " ".join(argv[1:]), ascii(text[-300:].decode(errors="replace"))
                ))
                if args.keep:
                    shutil.copytree(
                        folder, os.path.join(args.keep, "%s-%d-%d" % (kind.replace(" ", "-"), args.seed, index)),
                        dirs_exist_ok=True,
                    )
        print("%s, %d, %d" % (kind, args.runs, failed), flush=True)
    for failure in failures:
        print(failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
