"""Layers of pictures, read by the OpenEXR library and compared with what else raybrook says:
python check_layers.py [SCENE]... [--raybrook PROGRAM] [--device NAME] [--size WxH]

An .exr with all layers is compared with a .pfm of the same picture, with the hits that `trace` finds for rays through
the middles of the pixels, with --stats, and with pictures of counted work (--aov). The rays are made here, from the
camera that --explain tells of. Without a SCENE one is made of which everything else is known, too: corners, normals,
texture coordinates, materials, objects and instances. Prints how many numbers were compared, and how many differ; ends
with 1 if any does. Needs numpy and OpenEXR (`pip install numpy OpenEXR`).
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
from hard_rays import knot

LAYERS = "depth,position,normal,geometric-normal,albedo,uv,primitive,object,instance,material,samples,error"
COUNTERS = "steps,tests,leaves"
ERROR = "2"
NONE = 2**32 - 1
EPS = 2.0**-24  # of float32, half of a step at 1
LEVELS = [0, 1, 4, 16, 64, 256]  # samples that a pixel may have


class Table:
    """Counts of numbers that were compared, and of those that differ."""

    def __init__(self, scene):
        self.scene, self.wrong = scene, 0

    def same(self, layer, other, found, expected):
        """Bit by bit."""
        found, expected = (np.ascontiguousarray(x).view(np.uint32).ravel() for x in (found, expected))
        self.row(layer, other, found != expected)

    def near(self, layer, other, found, expected, bound):
        """Within bounds of float32's rounding."""
        self.row(layer, other, ~(np.abs(found - expected) <= bound))

    def row(self, layer, other, wrong):
        self.wrong += int(np.count_nonzero(wrong))
        print(f"| {self.scene} | {layer} | {other} | {wrong.size:,} | {np.count_nonzero(wrong):,} |", flush=True)


def run(program, words, folder):
    done = subprocess.run([*program, *map(str, words)], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}: {done.stderr}")
    return done.stderr


def read_exr(path):
    """All channels by their names, with the types that they have in the file."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def read_pfm(path):
    kind, size, scale, pixels = Path(path).read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    assert kind == b"PF" and float(scale) < 0, "three little-endian floats a pixel"
    return np.frombuffer(pixels, "<f4").reshape(height, width, 3)[::-1]


def fma(a, b, c):
    """Of float32, rounded once: the product is exact in float64."""
    return (a.astype(np.float64) * b.astype(np.float64) + c.astype(np.float64)).astype(np.float32)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def camera_of(told):
    """Eye, target, up and field of view, as --explain tells of them."""
    numbers = {name: found for name, found in re.findall(r"^--(eye|target|up|fov) ([^:\s]+):", told, re.MULTILINE)}
    return [np.float32(numbers[name].split(",")).astype(np.float64) for name in ("eye", "target", "up", "fov")]


def rays_of(camera, width, height):
    """Origins and directions of the rays through the middles of the pixels; a direction's part along the view is 1."""
    eye, target, up, fov = camera
    forward = unit(target - eye)
    right = unit(np.cross(forward, up))
    half_height = np.tan(np.radians(fov[0]) / 2)
    across = (right * (half_height * (width / height))).astype(np.float32)
    upwards = (np.cross(right, forward) * half_height).astype(np.float32)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32) + np.float32(0.5)
    one = np.float32(1)
    x = fma(x, np.float32(2.0 / width), -one)[..., None]
    y = fma(-y, np.float32(2.0 / height), one)[..., None]
    directions = fma(across, x, fma(upwards, y, forward.astype(np.float32)))
    return np.broadcast_to(eye.astype(np.float32), directions.shape), directions


def traced(program, scene, rays, words, folder):
    """What `trace` hits by the rays of a picture."""
    origins, directions = (part.reshape(-1, 3) for part in rays)
    np.savez(folder / "rays.npz", origin=origins, direction=directions)
    run(program, ["trace", scene, "rays.npz", "-o", "hits.npz", "-q", *words], folder)
    with np.load(folder / "hits.npz") as hits:
        return {name: hits[name] for name in hits.files}


def compare(program, name, scene, words, size, folder):
    """Compares what is known of every scene; returns the table, the channels, the rays and their hits."""
    table, (width, height) = Table(name), map(int, size.split("x"))
    common = [scene, "--size", size, "--error", ERROR, *words]
    told = run(
        program,
        ["render", *common, "--explain", "--layers", f"{LAYERS},{COUNTERS}", "--stats", "stats.json", "-o", "all.exr"],
        folder,
    )
    run(program, ["render", *common, "-q", "-o", "plain.pfm"], folder)
    run(program, ["render", *common, "-q", "--aov", COUNTERS, "-o", "aov.pfm"], folder)
    channels, stats = read_exr(folder / "all.exr"), json.loads((folder / "stats.json").read_text())
    assert all(channel.shape == (height, width) for channel in channels.values())
    floats = {channel for channel, pixels in channels.items() if pixels.dtype == np.float32}
    whole = {f"{layer}.X" for layer in ["primitive", "object", "instance", "material", "samples", *COUNTERS.split(",")]}
    assert set(channels) - floats == whole and all(channels[name].dtype == np.uint32 for name in whole), channels

    rgb = np.stack([channels[letter] for letter in "RGB"], axis=-1)
    table.same("R, G, B", "`-o .pfm`", rgb, read_pfm(folder / "plain.pfm"))
    for counter in COUNTERS.split(","):
        counts = read_pfm(folder / f"aov-{counter}.pfm")[..., 0]
        table.same(counter, "`--aov` to `.pfm`", channels[f"{counter}.X"].astype(np.float32), counts)
    samples, pixels = channels["samples.X"], stats["adaptive"]["pixels"]
    found = [np.count_nonzero(samples == level) for level in LEVELS]
    table.row("samples", "`--stats`: pixels by samples", np.array(found) != np.array(pixels))
    error = np.sqrt(np.mean(channels["error.X"].astype(np.float64) ** 2))
    # Errors of blocks are added in units of 2^-20 or so; a thousandth is far above that.
    estimated = stats["adaptive"]["estimated_error"]
    table.near("error", "`--stats`: its mean", np.array([error]), np.array([estimated]), estimated / 1000)

    rays = rays_of(camera_of(told), width, height)
    hits = traced(program, scene, rays, words, folder)
    table.same("depth", "`trace`: t", channels["depth.Z"], hits["t"])
    primitive = hits["primitive"].astype(np.int64)
    primitive = np.where(primitive < 0, NONE, primitive).astype(np.uint32)
    table.same("primitive", "`trace`", channels["primitive.X"], primitive)
    is_hit = primitive.reshape(height, width) != NONE
    for layer in ["object", "instance", "material"]:
        table.row(layer, "none where nothing is hit", (channels[f"{layer}.X"] != NONE)[~is_hit])
    points = np.stack([channels[f"position.{axis}"] for axis in "XYZ"], axis=-1)[is_hit].astype(np.float64)
    origins, directions = (part[is_hit].astype(np.float64) for part in rays)
    along = directions * channels["depth.Z"][is_hit].astype(np.float64)[:, None]
    # t is rounded once, by half of a step; a point of a triangle by a few, of its corners' coordinates.
    largest = np.abs(np.concatenate([points, origins])).max() if len(points) else 0.0
    table.near("position", "origin + t direction", points, origins + along, 8 * EPS * (largest + np.abs(along)))
    for layer in ["normal", "geometric_normal"]:
        normals = np.stack([channels[f"{layer}.{axis}"] for axis in "XYZ"], axis=-1)[is_hit].astype(np.float64)
        table.near(layer, "length 1", np.linalg.norm(normals, axis=-1), 1.0, 4 * EPS)
    towards = np.sum(normals * directions, axis=-1)
    table.row("geometric_normal", "towards the camera", towards > 4 * EPS * np.linalg.norm(directions, axis=-1))
    return table, channels, hits


def write_mesh(path, vertices, faces, texture, normals):
    """An .obj whose corners have texture coordinates and normals."""
    corners = {"v": vertices, "vt": texture, "vn": normals}
    lines = [f"{kind} {' '.join(map(str, row))}" for kind, rows in corners.items() for row in rows]
    lines += ["f " + " ".join(f"{corner}/{corner}/{corner}" for corner in face) for face in faces + 1]
    path.write_text("\n".join(lines) + "\n")


class Known:
    """A ground and a knot that stands on it twice, and what is known of each of their triangles."""

    COLOURS = {"ground": [0.7, 0.65, 0.5], "red": [0.8, 0.1, 0.05], "blue": [0.1, 0.2, 0.9]}
    PLACES = [(-3.5, 1.5, 0.0), (3.5, 1.5, -2.0)]

    def __init__(self, folder):
        ground = np.float32([[-12, 0, 9], [12, 0, 9], [12, 0, -9], [-12, 0, -9]])
        ground_faces, ground_texture = np.array([[0, 1, 2], [0, 2, 3]]), np.float32([[0, 0], [4, 0], [4, 3], [0, 3]])
        ground_normals = np.float32([[0, 1, 0]] * 4)
        vertices, faces = knot(120, 10)
        texture = np.stack(np.divmod(np.arange(len(vertices), dtype=np.float32), 10), axis=-1) / np.float32([12, 10])
        # Beside the true normals by a little, so that nobody mistakes one for the other.
        normals = unit(vertices.reshape(-1, 10, 3) - vertices.reshape(-1, 10, 3).mean(axis=1, keepdims=True) + 0.03)
        normals = normals.reshape(-1, 3).astype(np.float32)
        write_mesh(folder / "ground.obj", ground, ground_faces, ground_texture, ground_normals)
        write_mesh(folder / "knot.obj", vertices, faces, texture, normals)
        instances = zip(self.PLACES, ["red", "blue"])
        instances = [f'{{ translate = {list(place)}, material = "{name}" }}' for place, name in instances]
        materials = [f"[material.{name}]\ndiffuse = {colour}" for name, colour in self.COLOURS.items()]
        objects = ['[[object]]\nfile = "ground.obj"\nmaterial = "ground"']
        objects += [f'[[object]]\nfile = "knot.obj"\ninstances = [{", ".join(instances)}]']
        camera = "[camera]\neye = [1.5, 7.0, 15.0]\ntarget = [0.3, 1.0, -0.5]\nfov = 38"
        self.path = folder / "known.toml"
        self.path.write_text("\n\n".join([camera, *materials, *objects]) + "\n")
        placed = [vertices.astype(np.float64) + place for place in self.PLACES]
        self.corners = np.concatenate([ground[ground_faces], *[part[faces] for part in placed]]).astype(np.float64)
        self.texture = np.concatenate([ground_texture[ground_faces], *[texture[faces]] * 2]).astype(np.float64)
        self.normals = np.concatenate([ground_normals[ground_faces], *[normals[faces]] * 2]).astype(np.float64)
        counts = [len(ground_faces), len(faces), len(faces)]
        self.material = np.repeat([0, 1, 2], counts).astype(np.uint32)
        self.object = np.repeat([0, 1, 1], counts).astype(np.uint32)
        self.instance = np.repeat([NONE, 0, 1], counts).astype(np.uint32)

    def compare(self, table, channels, hits):
        """Compares layers with what is known of the triangles that were hit."""
        shape = channels["primitive.X"].shape
        is_hit = (hits["primitive"] >= 0).reshape(shape)
        triangle = hits["primitive"].reshape(shape)[is_hit]
        u, v = (hits[name].reshape(shape)[is_hit].astype(np.float64) for name in "uv")
        weights = np.stack([1 - u - v, u, v], axis=-1)[..., None]
        layer = lambda name, letters: np.stack([channels[f"{name}.{c}"] for c in letters], axis=-1)[is_hit]
        for name in ["object", "instance", "material"]:
            table.same(name, "the scene", channels[f"{name}.X"][is_hit], getattr(self, name)[triangle])
        colours = np.float32(list(self.COLOURS.values()))
        table.same("albedo", "the scene", layer("albedo", "RGB"), colours[self.material[triangle]])
        # A sum of three products, and weights that are rounded, in units of the largest term.
        corners, texture, normals = self.corners[triangle], self.texture[triangle], self.normals[triangle]
        for name, letters, values in (("uv", "UV", texture), ("position", "XYZ", corners)):
            bound = 8 * EPS * np.abs(values).max(axis=(1, 2))[:, None]
            table.near(name, "the scene's corners", layer(name, letters), (weights * values).sum(axis=1), bound)
        edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        across = np.cross(*edges)
        # Corners are rounded: a triangle turns by that, in units of its smallest height.
        longest = np.max([np.linalg.norm(edge, axis=-1) for edge in (*edges, edges[1] - edges[0])], axis=0)
        bound = 8 * EPS * (1 + np.abs(corners).max(axis=(1, 2)) * longest / np.linalg.norm(across, axis=-1))
        found = layer("geometric_normal", "XYZ").astype(np.float64)
        side = np.sign(np.sum(unit(across) * found, axis=-1, keepdims=True))
        table.near("geometric_normal", "the scene's corners", found, side * unit(across), bound[:, None])
        found = layer("normal", "XYZ").astype(np.float64)
        expected = unit((weights * normals).sum(axis=1))
        expected *= np.sign(np.sum(expected * layer("geometric_normal", "XYZ"), axis=-1, keepdims=True))
        table.near("normal", "the scene's normals", found, expected, 16 * EPS)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--raybrook", default="raybrook", metavar="PROGRAM")
    parser.add_argument("--device", default="reference")
    parser.add_argument("--size", default="240x180", metavar="WxH")
    arguments = parser.parse_args()
    program = arguments.raybrook.split()
    program[0] = str(Path(program[0]).resolve()) if "/" in program[0] else program[0]
    words, wrong = ["--device", arguments.device], 0
    print("| scene | layer | compared with | numbers | wrong |\n|---|---|---|--:|--:|")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        known = [] if arguments.scenes else [Known(folder)]
        for scene in known or map(Path, arguments.scenes):
            path = (scene.path if known else scene).resolve()
            table, channels, hits = compare(program, path.name, path, words, arguments.size, folder)
            if known:
                scene.compare(table, channels, hits)
            wrong += table.wrong
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
