#!/usr/bin/env python3
"""Small scenes and options at random for a while, each command once undisturbed and then with whatever may
happen to it: killed again and again, its journal damaged, in parts that are merged, out of time, on a full
disk, with little memory, on a device that dies, with a broken input. A run must end by itself with a code that
is documented for that, leave no file that it should not, tell of no panic, and what it writes must have the
bytes of the undisturbed run's.

    tests/faults/soak_runs.py target/release/raybrook 1800                # seconds, 1800 by default
    tests/faults/soak_runs.py target/release/raybrook 1800 --seed 7
    tests/faults/soak_runs.py target/release/raybrook --seed 7 --case 123 # that case again, as it was

The device is number 0, with kernels that are compiled once. Prints a row for each disturbance, and ends with 1
if anything failed.
"""

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import common
import mutate

# Exit codes: README.md. By what became of the run.
DONE, USAGE, INPUT, DEVICE, OUTPUT, TIME = 0, 2, 3, 4, 5, 124
STOPPED = {"SIGINT": 130, "SIGTERM": 143, "SIGKILL": -signal.SIGKILL}
PANIC = (b"panicked at", b"RUST_BACKTRACE", b"stack overflow", b"internal error", b"AddressSanitizer")
# Of what is on a device: what compiles in a moment, and is the same for all scenes.
ON_DEVICE = ["--features", "all", "--kernels", "mega", "--structure", "bvh2", "--packet-size", "1"]
CODES_OF_DRIVERS = [-4, -5, -2, -9999]


class Failure(Exception):
    """What did not hold."""


def number(chance, low, high):
    return f"{chance.uniform(low, high):.3f}"


def vector(chance, low, high):
    return "[" + ", ".join(number(chance, low, high) for _ in range(3)) + "]"


def material(chance, name):
    lines = [f"[material.{name}]", f"diffuse = {vector(chance, 0, 1)}"]
    for key, share in [("mirror", 0.3), ("transmission", 0.3), ("specular", 0.5), ("emission", 0.1)]:
        if chance.random() < share:
            lines.append(f"{key} = {number(chance, 0, 1)}")
    if chance.random() < 0.3:
        kind = chance.choice(["checker", "noise", "marble", "wood"])
        lines.append(f'texture = {{ kind = "{kind}", scale = {number(chance, 0.05, 1)} }}')
    elif chance.random() < 0.2:
        lines.append('texture = "floor.png"')
    return lines


def solid(chance, materials):
    kinds = {
        "sphere": ["segments = %d" % chance.randint(3, 40), "radius = " + number(chance, 0.2, 1)],
        "box": ["size = " + vector(chance, 0.2, 1.5)],
        "cylinder": ["segments = %d" % chance.randint(3, 30)],
        "cone": ["segments = %d" % chance.randint(3, 30)],
        "torus": ["segments = %d" % chance.randint(3, 30), "sides = %d" % chance.randint(3, 20)],
    }
    kind = chance.choice([*kinds, "file"])
    lines = (
        ["[[object]]", 'file = "model.obj"'] if kind == "file" else ["[[object]]", f'solid = "{kind}"', *kinds[kind]]
    )
    if kind != "file" or chance.random() < 0.5:
        lines.append(f'material = "{chance.choice(materials)}"')
    lines += [f"translate = {vector(chance, -1.5, 1.5)}", f"rotate = {vector(chance, 0, 360)}"]
    if chance.random() < 0.2:
        places = ", ".join(f"{{ translate = {vector(chance, -3, 3)} }}" for _ in range(chance.randint(1, 4)))
        lines.append(f"instances = [{places}]")
    return lines


def scene(chance):
    """The text of a scene file."""
    names = ["a", "b", "c"][: chance.randint(1, 3)]
    lines = []
    if chance.random() < 0.6:
        lines += [
            "[camera]",
            f"eye = {vector(chance, 3, 6)}",
            f"target = {vector(chance, -0.5, 0.5)}",
            f"fov = {number(chance, 20, 90)}",
        ]
    for _ in range(chance.randint(0, 2)):
        lines += [
            "[[light]]",
            'kind = "point"',
            f"position = {vector(chance, -5, 5)}",
            f"intensity = {number(chance, 0.2, 2)}",
        ]
    for name in names:
        lines += material(chance, name)
    for _ in range(chance.randint(1, 4)):
        lines += solid(chance, names)
    return "\n".join(lines) + "\n"


def method(chance):
    """An exact method for the reference."""
    structure = chance.choice(["auto", "kd", "bvh2", "bvh8", "grid", "octree"])
    words = [] if structure == "auto" else ["--structure", structure]
    if structure == "kd" and chance.random() < 0.5:
        words += ["--traversal", chance.choice(["stack", "ropes", "restart", "short-stack", "push-down"])]
    return words


class Case:
    """A command in a folder of its own."""

    def __init__(self, program, folder, chance, has_device):
        self.program, self.folder, self.chance = program, folder, chance
        common.scene(folder, chance.randint(4, 24))
        common.write(folder, "scene.toml", scene(chance))
        self.is_on_device = has_device and chance.random() < 0.3
        self.is_picture = chance.random() < 0.65
        where = ["--device", "0", *ON_DEVICE] if self.is_on_device else ["--device", "reference", *method(chance)]
        self.words = [*(self.picture() if self.is_picture else self.rays()), *where, "-q"]
        self.output = self.words[self.words.index("-o") + 1]

    def picture(self):
        chance = self.chance
        size = f"{chance.randint(1, 400)}x{chance.randint(1, 300)}"
        samples = (
            ["--error", number(chance, 0.5, 8)]
            if chance.random() < 0.6
            else ["--samples", str(chance.choice([1, 2, 4, 9, 16]))]
        )
        words = ["render", "scene.toml", "--size", size, *samples, "-o", "out." + chance.choice(["png", "pfm", "exr"])]
        if chance.random() < 0.3:
            words += ["--depth", str(chance.randint(1, 12))]
        return words

    def rays(self):
        chance = self.chance
        origins = [tuple(chance.uniform(-3, 3) for _ in range(3)) for _ in range(512)]
        directions = [tuple(chance.uniform(-1, 1) for _ in range(3)) for _ in range(512)]
        times = chance.choice([1, 50, 2500, 5000])  # a run has 1,048,576 rays
        common.npz(os.path.join(self.folder, "many.npz"), {"origin": origins, "direction": directions}, times)
        asked = chance.choice([[], [], ["--any-hit"], ["--all-hits"], ["--all-hits=2"]])
        return ["trace", "scene.toml", "many.npz", "-o", "out.npz", *asked]

    def path(self, name=None):
        return os.path.join(self.folder, name or self.output)

    def start(self, words, changed=None, **more):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
        environment = {**common.environment(self.folder), "RAYBROOK_CACHE_DIR": CACHE, **(changed or {})}
        return subprocess.Popen([self.program, *words], cwd=self.folder, env=environment, **pipes, **more)

    def end(self, child, codes):
        """The exit code, which is one of these."""
        try:
            texts = child.communicate(timeout=common.LIMIT)
        except subprocess.TimeoutExpired:
            child.kill()
            child.communicate()
            raise Failure("hangs") from None
        text = b"".join(texts)
        if any(word in text for word in PANIC):
            raise Failure(f"panics: {text[-400:]!r}")
        if child.returncode not in codes:
            raise Failure(f"exit code {child.returncode}, not {sorted(codes)}: {text[-400:]!r}")
        if child.returncode in (USAGE, INPUT, DEVICE, OUTPUT) and b"raybrook: " not in text and b"error: " not in text:
            raise Failure(f"exit code {child.returncode} without a message: {text[-400:]!r}")
        return child.returncode

    def run(self, words, codes, changed=None, **more):
        return self.end(self.start(words, changed, **more), codes)

    def result(self):
        """The bytes of the output, which is taken away; None where there is none."""
        try:
            with open(self.path(), "rb") as file:
                data = file.read()
        except FileNotFoundError:
            return None
        os.remove(self.path())
        return data

    def check_result(self, right):
        if self.result() != right:
            raise Failure("other bytes than undisturbed")

    def check_files(self, before, allowed=()):
        """There is nothing but what was there before, with the same bytes, and what is allowed."""
        after = common.files(self.folder)
        lost = [name for name, data in before.items() if after.get(name) != data]
        more = [name for name in after if name not in before and name not in allowed]
        if lost or more:
            raise Failure(f"lost or changed: {lost}; left behind: {more}")


def killed(case, right, before, seconds, words=None, output=None):
    """Kills runs of a command, damages its journal now and then, and lets it end."""
    chance, words = case.chance, [*(words or case.words), "--keep", "always"]
    journal = output or case.output + ".partial"
    refused = set()
    for _ in range(chance.randint(1, 4)):
        child = case.start(words)
        time.sleep(chance.uniform(0, 1.2 * seconds))
        name = chance.choice(["SIGKILL", "SIGKILL", "SIGINT", "SIGTERM"])
        child.send_signal(common.SIGNALS[name])
        # It may have ended before, or be as good as done.
        code = case.end(child, {DONE, STOPPED[name], -common.SIGNALS[name], *refused})
        case.check_files(before, (case.output, journal))
        if code == INPUT:
            os.remove(case.path(journal))
            refused = set()
        if chance.random() < 0.3 and os.path.exists(case.path(journal)):
            damage(case.path(journal), chance)
            # One whose header is damaged is left to the user.
            refused = {INPUT}
    # What does not even begin as a journal is not removed by --restart.
    if case.run(words, {DONE, *refused}) == INPUT and case.run([*words, "--restart"], {DONE, INPUT}) == INPUT:
        os.remove(case.path(journal))
        case.run(words, {DONE})


def damage(path, chance):
    """Changes bytes of a file, or cuts it off, or lengthens it."""
    with open(path, "rb") as file:
        data = file.read()
    if not data:
        return
    kind, at = chance.randrange(3), chance.randrange(len(data))
    few = bytes(chance.randrange(256) for _ in range(chance.randint(1, 8)))
    data = [data[:at] + few + data[at + len(few) :], data[:at], data + few][kind]
    with open(path, "wb") as file:
        file.write(data)


def kills(case, right, before, seconds):
    killed(case, right, before, seconds)
    case.check_result(right)
    case.check_files(before)


def parts(case, right, before, seconds):
    """In parts, of which some are killed, and one may be made twice; then merged."""
    count = case.chance.randint(2, 5)
    names = [f"{case.output}.part-{number}-of-{count}" for number in range(1, count + 1)]
    for number, name in enumerate(names, 1):
        words = [*case.words, "--part", f"{number}/{count}"]
        if case.chance.random() < 0.3:
            killed(
                case,
                right,
                {**before, **{n: d for n, d in common.files(case.folder).items() if n in names[: number - 1]}},
                seconds,
                words,
                name,
            )
        else:
            case.run(words, {DONE})
    case.chance.shuffle(names)
    merge = ["merge", *names, "-o", case.output, "-q"]
    if case.chance.random() < 0.3:
        case.run(["merge", *names[1:], "-o", case.output, "-q"], {DONE, INPUT})  # a part without blocks may be missing
        case.result()
    case.run(merge, {DONE})
    case.check_result(right)
    for name in names:
        os.remove(case.path(name))
    case.check_files(before)


def out_of_time(case, right, before, seconds):
    limit = f"{max(0.01, case.chance.uniform(0, 1.2 * seconds)):.3f}s"
    words = [*case.words, "--keep", "always"]
    if case.run([*words, "--time-limit", limit], {DONE, TIME}) == TIME:
        case.check_files(before, (case.output, case.output + ".partial"))
        case.run(words, {DONE})
    case.check_result(right)
    case.check_files(before)


def full_disk(case, right, before, seconds):
    """No file may grow beyond some bytes: as on a full disk, and found out in the middle of a write."""
    most = case.chance.choice([0, 1, 512, 4096, case.chance.randrange(1 << 20)])
    words = [*case.words, "--keep", case.chance.choice(["always", "never"])]

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    # A driver's compiler writes files of its own.
    codes = {DONE, OUTPUT, DEVICE} if case.is_on_device else {DONE, OUTPUT}
    if case.run(words, codes, preexec_fn=limit) != DONE:
        case.check_files(before, (case.output + ".partial",))
        if os.path.exists(case.path()):
            raise Failure("an output on a full disk")
        code = case.run([*case.words, "--keep", "always"], {DONE, INPUT})
        if code == INPUT:
            case.run([*case.words, "--keep", "always", "--restart"], {DONE})
    case.check_result(right)
    case.check_files(before, (case.output + ".partial",) if "never" in words else ())


def little_memory(case, right, before, seconds):
    words = [*case.words, "--memory-limit", case.chance.choice(["1M", "20M", "40M", "60M", "100M", "200M"])]
    if case.run(words, {DONE, INPUT, DEVICE}) == DONE:
        case.check_result(right)
    case.check_files(before)


def dying_device(case, right, before, seconds):
    """A call of OpenCL fails, or it and all later ones do."""
    fault = (
        f"{case.chance.choice(['only', 'from'])}:{case.chance.randint(1, 160)}:{case.chance.choice(CODES_OF_DRIVERS)}"
    )
    words = [*case.words, "--keep", case.chance.choice(["always", "never"])]
    if case.run(words, {DONE, DEVICE}, {"OPENCL_DYLIB_PATH": LIBRARY, "OPENCL_FAULT": fault}) == DEVICE:
        case.check_files(before, (case.output + ".partial",))
        case.run([*case.words, "--keep", "always"], {DONE})
    case.check_result(right)
    case.check_files(before)


def broken_input(case, right, before, seconds):
    name = case.chance.choice(
        ["scene.toml", "model.obj", "model.mtl", "floor.png", *([] if case.is_picture else ["many.npz"])]
    )
    with open(case.path(name), "rb") as file:
        data = file.read()
    common.write(case.folder, name, mutate.mutate(case.chance, data))
    broken = common.files(case.folder)
    case.run([*case.words, "--memory-limit", "1G"], {DONE, INPUT, DEVICE})
    case.result()
    case.check_files(broken)
    common.write(case.folder, name, data)
    case.run(case.words, {DONE})
    case.check_result(right)


DISTURBANCES = [kills, kills, parts, parts, out_of_time, full_disk, little_memory, broken_input]


def one(program, seed, index):
    """The name of the disturbance, and what did not hold, or None."""
    chance = random.Random(f"{seed} {index}")
    with common.new_folder() as folder:
        case = Case(program, folder, chance, LIBRARY is not None)
        choices = [*DISTURBANCES, *([dying_device] * 3 if case.is_on_device else [])]
        disturb = chance.choice(choices)
        try:
            before = common.files(folder)
            begun = time.monotonic()
            case.run([*case.words, "--keep", "never"], {DONE})
            seconds = time.monotonic() - begun
            right = case.result()
            disturb(case, right, before, seconds)
            return disturb.__name__, None
        except Failure as failure:
            return disturb.__name__, f"--seed {seed} --case {index}: {' '.join(case.words)}: {failure}"


def main():
    global CACHE, LIBRARY
    about = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    about.add_argument("program")
    about.add_argument("seconds", type=int, nargs="?", default=1800)
    about.add_argument("--seed", type=int, default=1)
    about.add_argument("--case", type=int, help="this one alone")
    about.add_argument("--no-device", action="store_true", help="the reference alone; without a compiler, too")
    given = about.parse_args()
    program, table = os.path.abspath(given.program), common.Table()
    with tempfile.TemporaryDirectory(prefix="raybrook-soak-") as folder:
        CACHE = os.path.join(folder, "cache")
        LIBRARY = None if given.no_device else common.faults_library(folder)
        print(f"seed {given.seed}, {'with' if LIBRARY else 'without'} a device", flush=True)
        until, index = time.monotonic() + given.seconds, given.case or 0
        while time.monotonic() < until:
            kind, fault = one(program, given.seed, index)
            table.add(kind.replace("_", " "), fault)
            if given.case is not None:
                break
            index += 1
        shutil.rmtree(CACHE, ignore_errors=True)
    table.end()


if __name__ == "__main__":
    main()
