#!/usr/bin/env python3
"""Breaks long work once in every way, has the same command go on, and tells what that cost: a table of faults and commands.

A fault hits in the middle of the run. Then the command is run again: the output must have an undisturbed run's bytes.
FAULTS_LIBRARY names the library of opencl_faults.rs where it is compiled already.
"""

import os
import random
import re
import subprocess
import sys
import time

import common
import resume

RAYS = ["trace", "scene.toml", "many.npz", "-o", "out.npz", "--keep", "always"]
# Arguments without a device, and what the undisturbed run writes.
PICTURE = ["render", "scene.toml", "--size", "1600x1200"]
KEPT = ["-o", "out.pfm", "--keep", "always"]
TURN = ["turntable", "scene.toml", "--size", "400x300", "--samples", "4", "--frames", "12", "-o", "out.pfm"]
STRESS = ["stress", "--rays", "400", "--intersector", "thesis", "--json", "out.json", "--keep", "always"]
COMMANDS = {
    "render": ([*PICTURE, "--samples", "16", *KEPT], "out.pfm"),
    "render --error": ([*PICTURE, "--error", "0.3", *KEPT], "out.pfm"),
    "trace": (RAYS, "out.npz"),
    "turntable": (TURN, "out-0001.pfm"),
    "stress": (STRESS, "out.json"),
    "merge": (["merge", "part.pfm.part-1-of-2", "part.pfm.part-2-of-2", "-o", "out.pfm"], "out.pfm"),
}
PART = [*PICTURE, "--samples", "16", "-o", "part.pfm", "--device", "reference", "--part"]
WITHOUT_JOURNAL = ("turntable", "merge")
SIGNALS = ("SIGINT", "SIGTERM", "SIGKILL")
LOST, STRICT, DAMAGED = "device lost", "device lost, --strict-device", "SIGKILL, journal damaged"
TIMED = (*SIGNALS, DAMAGED)
CODES = {
    "SIGINT": (130,),
    "SIGTERM": (143,),
    "SIGKILL": (-9,),
    "disk full": (5,),
    DAMAGED: (-9,),
    LOST: (0,),
    STRICT: (4,),
}
REFERENCE = ["--device", "reference"]
# Times 4096 rays: four runs.
TIMES = 900
# The runs that a device is lost in have the small kernels, which compile in a moment.
SMALL = ["--device", "0", "--structure", "brute", "--intersector", "moller-trumbore", "--packet-size", "1"]


def outputs(folder):
    """What a run has written."""
    files = common.files(folder).items()
    return {name: data for name, data in files if name.startswith("out") and not is_on_its_way(name)}


def is_on_its_way(name):
    return name.endswith(".partial") or name.endswith("-turntable.json")


def start(program, folder, words, variables):
    return subprocess.Popen(
        [program, *words],
        cwd=folder,
        env={**common.environment(folder), **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def ended(child):
    try:
        said = b"".join(child.communicate(timeout=common.LIMIT))
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return "hangs", ""
    return child.returncode, said.decode(errors="replace")


def hit(program, folder, command, words, fault_and_middle, library):
    """Runs a command that a fault hits: its exit code, and what it said."""
    fault, middle = fault_and_middle
    if fault in TIMED:
        child = start(program, folder, words, {})
        time.sleep(middle)
        child.send_signal(common.SIGNALS[fault.split(",")[0]])
        return ended(child)
    if fault == "disk full":
        # Blocks of 512 bytes in dash, of 1024 in others: less than the output takes.
        size = {"stress": 4, "turntable": 1200, "merge": 12000, "trace": 80000}.get(command, 24000)
        limited = ["-c", f'ulimit -f {size}; exec "$0" "$@"', program, *words]
        return ended(start("sh", folder, limited, {}))
    variables = {"OPENCL_DYLIB_PATH": library, "OPENCL_FAULT": f"from:{middle}:-36"}
    return ended(start(program, folder, words, variables))


def launch_in_the_middle(program, folder, words, library):
    """The number of a call of an undisturbed run."""
    log = os.path.join(folder, "log")
    code, said = ended(start(program, folder, words, {"OPENCL_DYLIB_PATH": library, "OPENCL_FAULT_LOG": log}))
    if code not in (0, 1):
        sys.exit(f"{' '.join(words)} ends with {code}: {said}")
    with open(log) as file:
        launches = [number for number, name in enumerate(file, 1) if name.strip() == "clEnqueueNDRangeKernel"]
    return launches[len(launches) // 2]


def clear(folder):
    for name in common.files(folder):
        if name.startswith("out"):
            os.remove(os.path.join(folder, name))


def begun_with(said):
    """What a run says that it begins with."""
    found = re.search(r"goes on with .*?: (\d+ of \d+ \w+)", said)
    return found.group(1) if found else "nothing"


def one(program, command, fault, library, chance):
    """A row: exit code, what was kept, the exit code of the same command, whether the bits are equal; and what is wrong."""
    is_of_device = fault.startswith("device")
    words = [*COMMANDS[command][0], *(SMALL if is_of_device else REFERENCE if command != "merge" else [])]
    with common.new_folder() as folder:
        common.scene(folder)
        if "many.npz" in words:
            resume.many(os.path.join(folder, "many.npz"), chance, TIMES)
        if command == "merge":
            for part in ("1/2", "2/2"):
                common.run(program, folder, [*PART, part])
        if is_of_device:
            middle = launch_in_the_middle(program, folder, words, library)
        else:
            begun = time.monotonic()
            common.run(program, folder, words)
            middle = 0.5 * (time.monotonic() - begun)
        undisturbed = outputs(folder)
        clear(folder)
        strict = ["--strict-device"] if fault == STRICT else []
        code, said = hit(program, folder, command, [*words, *strict], (fault, middle), library)
        if fault == DAMAGED:
            journal = os.path.join(folder, COMMANDS[command][1] + ".partial")
            if os.path.exists(journal):
                resume.spoil(journal, chance)
        frames = len(outputs(folder))
        again, text = (code, said) if code in (0, 1) else ended(start(program, folder, words, {}))
        is_equal = outputs(folder) == undisturbed
        names = common.files(folder)
        left = [name for name in names if name.endswith(".partial") or os.path.basename(name).startswith(".raybrook-")]
        has_note = fault != LOST or command == "stress" or "goes on in place of" in said
        is_right = again in (0, 1) and is_equal and not left and has_note and is_expected(command, fault, code)
        kept = "all" if code in (0, 1) else f"{frames} of 12 frames" if command == "turntable" else begun_with(text)
        row = (code, kept, again, "yes" if is_equal else "no")
        return row, None if is_right else f"{said}{text}{left}"


def is_expected(command, fault, code):
    """Whether a run that a fault hit may end so: whoever is late finds it at its end."""
    if command == "stress" and fault == LOST:
        return code == 4
    return code in CODES[fault] or fault in TIMED and code in (0, 1)


def faults_of(command):
    faults = [*SIGNALS, "disk full"]
    if command not in WITHOUT_JOURNAL:
        faults.append(DAMAGED)
    if command == "stress":
        faults.append(LOST)
    elif command not in ("merge", "render --error"):
        faults += [LOST, STRICT]
    return faults


def main():
    wanted = sys.argv[2:] or list(COMMANDS)
    if len(sys.argv) < 2 or not set(wanted) <= set(COMMANDS):
        sys.exit(f"{__doc__}\nusage: {sys.argv[0]} PATH/OF/raybrook [COMMAND ...]: {', '.join(COMMANDS)}")
    program = os.path.abspath(sys.argv[1])
    chance = random.Random(1)
    failures = 0
    with common.new_folder() as folder:
        library = common.faults_library(folder) or sys.exit("rustc is missing, or cannot compile opencl_faults.rs")
        print("| command | fault | exit code | kept | the same command again | same bits |\n|---|---|--:|---|--:|---|")
        for command in wanted:
            for fault in faults_of(command):
                row, wrong = one(program, command, fault, library, chance)
                print(f"| `{command}` | {fault} | " + " | ".join(str(value) for value in row) + " |", flush=True)
                if wrong is not None:
                    failures += 1
                    print(f"{command}, {fault}: {wrong}", file=sys.stderr)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
