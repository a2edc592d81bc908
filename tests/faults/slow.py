#!/usr/bin/env python3
"""Makes inputs that were slow by construction at three sizes, runs raybrook on them, and prints how its time grows.

    tests/faults/slow.py [--binary target/release/raybrook] [--device reference] [--scale 1.0] [CASE...]

Of each case: the sizes, the user seconds of each, and the exponent p of the power N^p that their growth is. Exit code
1 where p is above 1.3: more than N log N; and where ties take more than MOST_TIMES_WATERTIGHT times as long as with the
watertight test, which decides none of them exactly: deciding each anew is linear, too, but was 17 to 44 times as slow.
The time that no input takes, that of the smallest possible one, is taken off; where the largest size takes less than a
tenth of a second the case is fine, whatever the exponent.
"""

import argparse
import array
import io
import math
import os
import random
import resource
import struct
import subprocess
import sys
import tempfile
import zipfile

MOST_EXPONENT = 1.3
SECONDS_THAT_MATTER = 0.1
MOST_TIMES_WATERTIGHT = 8.0
TIES = ("identical triangles", "triangles in one plane")


def write_obj(path, triangles):
    with open(path, "w") as file:
        for triangle in triangles:
            for corner in triangle:
                file.write("v %.9g %.9g %.9g\n" % corner)
        for i in range(len(triangles)):
            file.write(f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}\n")


def identical(n):
    return [((0.0, 0.0, 0.0), (1.0, 0.0, 0.25), (0.25, 1.0, 0.5))] * n


def in_one_plane(n):
    """Large triangles one upon the other in an oblique plane that float32 meets exactly."""
    chance = random.Random(1)

    def corner(k):
        angle = 2.0 * math.pi * (k / 3.0) + chance.random()
        x, y = (round(500.0 * f(angle) + chance.randrange(-50, 50)) for f in (math.cos, math.sin))
        return (float(x), float(y), float(2 * x + 3 * y))

    return [(corner(0), corner(1), corner(2)) for _ in range(n)]


def soup(n):
    """Small triangles in a unit cube, as large as surfaces of so many would have them."""
    chance = random.Random(2)
    size = 2.0 / math.sqrt(n)
    result = []
    for _ in range(n):
        centre = [chance.random() for _ in range(3)]
        result.append(tuple(tuple(x + size * (chance.random() - 0.5) for x in centre) for _ in range(3)))
    return result


def one_outlier(n):
    triangles = soup(n)
    triangles[n // 2] = ((-1e38, 0.5, 0.5), *triangles[n // 2][1:])
    return triangles


def many_outliers(n):
    triangles, chance = soup(n), random.Random(3)
    for i in range(0, n, 100):
        far = tuple((chance.random() - 0.5) * 2e38 for _ in range(3))
        triangles[i] = (far, *triangles[i][1:])
    return triangles


def rays_npz(path, count):
    """Rays that start in the unit cube, in all directions."""
    chance = random.Random(4)
    origins, directions = array.array("f"), array.array("f")
    for _ in range(count):
        origins.extend(chance.random() for _ in range(3))
        directions.extend(chance.gauss(0.0, 1.0) for _ in range(3))
    with zipfile.ZipFile(path, "w") as file:
        for name, numbers in (("origin", origins), ("direction", directions)):
            header = "{'descr': '<f4', 'fortran_order': False, 'shape': (%d, 3), }" % count
            header += " " * (-(len(header) + 11) % 64) + "\n"
            data = io.BytesIO()
            data.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode())
            data.write(numbers.tobytes())
            file.writestr(name + ".npy", data.getvalue())


def toml_materials(n):
    lines = [f"[material.m{i}]\ndiffuse = [0.5, {i / n:.7f}, 0.5]\n" for i in range(n)]
    lines.append('[[object]]\nsolid = "box"\nmaterial = "m0"\n')
    return "".join(lines)


def toml_objects(n):
    objects = f'[[object]]\nsolid = "box"\nsize = 0.1\ntranslate = [%d, %d, 0]\n'
    return "".join(objects % (i % 100, i // 100) for i in range(n))


def toml_lights(n):
    light = '[[light]]\nkind = "point"\nposition = [%d, 5, 5]\n'
    return "".join(light % i for i in range(n)) + '[[object]]\nsolid = "box"\n'


def toml_textures(n):
    material = '[material.m%d]\ntexture = { kind = "noise", seed = %d }\n'
    return "".join(material % (i, i) for i in range(n)) + '[[object]]\nsolid = "box"\nmaterial = "m0"\n'


def toml_instances(n):
    places = ", ".join(f"{{ translate = [{i}, 0, 0] }}" for i in range(n))
    return f'[[object]]\nsolid = "box"\ninstances = [{places}]\n'


def nff_materials(n):
    head = "v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 45\nhither 1\nresolution 8 8\n"
    ball = "f 0.5 %.7f 0.5 1 0 0 0 1\np 3\n%d 0 0\n%d 1 0\n%d 0 1\n"
    return head + "".join(ball % (i / n, i, i, i) for i in range(n))


def obj_materials(folder, n):
    with open(os.path.join(folder, "many.mtl"), "w") as file:
        file.write("".join(f"newmtl m{i}\nKd 0.5 {i / n:.7f} 0.5\n" for i in range(n)))
    triangle = "v %d 0 0\nv %d 1 0\nv %d 0 1\nusemtl m%d\nf -3 -2 -1\n"
    return "mtllib many.mtl\n" + "".join(triangle % (i, i, i, i) for i in range(n))


def text_case(ending, make, *options):
    def prepare(folder, n):
        path = os.path.join(folder, "scene" + ending)
        with open(path, "w") as file:
            file.write(make(folder, n) if make is obj_materials else make(n))
        return ["info", path, *options]

    return prepare


def picture_case(make, *options):
    def prepare(folder, n):
        path = os.path.join(folder, "scene.obj")
        write_obj(path, make(n))
        return ["render", path, "--size", "32x32", "--samples", "1", "-o", os.path.join(folder, "o.png"), *options]

    return prepare


def rays_case(make, *options):
    def prepare(folder, n):
        path, rays = os.path.join(folder, "scene.obj"), os.path.join(folder, "rays.npz")
        write_obj(path, make(n))
        # A structure that tests all triangles for each takes N^(5/3), a hierarchy hardly more than N^(2/3), and a grid,
        # of which a ray crosses N^(1/3) cells, N.
        rays_npz(rays, int(12 * n ** (2 / 3)))
        return ["trace", path, rays, "-o", os.path.join(folder, "hits.npz"), *options]

    return prepare


def cases():
    result = {
        "identical triangles": (picture_case(identical), 25_000),
        "triangles in one plane": (picture_case(in_one_plane), 25_000),
    }
    for accel in ("kd", "bvh2", "bvh8"):
        result[f"one outlier, {accel}"] = (rays_case(one_outlier, "--structure", accel), 10_000)
        result[f"1 % outliers, {accel}"] = (rays_case(many_outliers, "--structure", accel), 10_000)
    for accel in ("grid", "octree"):
        result[f"one outlier, {accel}"] = (rays_case(one_outlier, "--structure", accel), 10_000)
    result |= {
        "TOML materials": (text_case(".toml", toml_materials), 20_000),
        "TOML objects": (text_case(".toml", toml_objects), 10_000),
        "TOML lights": (text_case(".toml", toml_lights), 10_000),
        "TOML textures": (text_case(".toml", toml_textures), 20_000),
        "TOML instances": (text_case(".toml", toml_instances, "--structure", "instances"), 10_000),
        "NFF materials": (text_case(".nff", nff_materials), 20_000),
        "MTL materials": (text_case(".obj", obj_materials), 20_000),
    }
    return result


def user_seconds(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)} ended with {done.returncode}: {done.stderr.decode(errors='replace')}")
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def main():
    parser = argparse.ArgumentParser(description="How the time of inputs grows that were slow by construction.")
    parser.add_argument("--binary", default="target/release/raybrook")
    parser.add_argument("--device", default="reference")
    parser.add_argument("--scale", type=float, default=1.0, help="factor of all sizes")
    parser.add_argument("case", nargs="*", help="parts of names; all cases without any")
    arguments = parser.parse_args()
    is_slow = False
    print(f"{'case':26} {'N':>8} {'2 N':>8} {'4 N':>8}  {'user s':>8} {'':>8} {'':>8}  exponent")
    for name, (prepare, size) in cases().items():
        if arguments.case and not any(part in name for part in arguments.case):
            continue
        sizes = [int(size * arguments.scale) * factor for factor in (1, 2, 4)]
        seconds = []
        with tempfile.TemporaryDirectory() as folder:
            for n in [64, *sizes]:
                command = [arguments.binary, *prepare(folder, n)]
                if command[1] != "info":
                    command += ["--device", arguments.device]
                seconds.append(min(user_seconds(command) for _ in range(2)))
            times = 0.0
            if name in TIES:
                rounded = [*command, "--intersector", "watertight"]
                times = seconds[-1] / max(min(user_seconds(rounded) for _ in range(2)), 1e-3)
        least, *seconds = seconds
        spent = [max(s - least, 1e-3) for s in seconds]
        exponent = math.log(spent[2] / spent[0]) / math.log(4.0)
        too_slow = exponent > MOST_EXPONENT and spent[2] > SECONDS_THAT_MATTER
        too_slow |= times > MOST_TIMES_WATERTIGHT
        is_slow |= too_slow
        numbers = " ".join(f"{n:8}" for n in sizes) + "  " + " ".join(f"{s:8.3f}" for s in seconds)
        beside = f"  {times:.1f} times watertight" if times else ""
        print(f"{name:26} {numbers}  {exponent:8.2f}{beside}{'  SLOW' if too_slow else ''}", flush=True)
    sys.exit(1 if is_slow else 0)


if __name__ == "__main__":
    main()
