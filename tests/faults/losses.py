#!/usr/bin/env python3
"""Breaks long work once in every way, has the same command go on, and tells what that cost: a table of faults and
commands.

A fault hits in the middle of the run. Then the command is run again: the output must have an undisturbed run's bytes,
and nothing that was finished may be made twice, but what was damaged. FAULTS_LIBRARY names the library of
opencl_faults.rs where it is compiled already. Disks that are full are small file systems in memory, which only root may
mount; else their rows are skipped.
"""

import contextlib
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
FULL, LIMITED = "disk full", "file size limited"
TIMED = (*SIGNALS, DAMAGED)
CODES = {
    "SIGINT": (130,),
    "SIGTERM": (143,),
    "SIGKILL": (-9,),
    FULL: (5,),
    LIMITED: (5,),
    DAMAGED: (-9,),
    LOST: (0,),
    STRICT: (4,),
}
REFERENCE = ["--device", "reference"]
# Bytes that are left on a disk that is filled in the middle of the run: less than the journal and the output take.
ROOM = {"stress": 8 << 10, "turntable": 8 << 20, "trace": 40 << 20}
# Times 4096 rays: four runs.
TIMES = 900
# The runs that a device is lost in have the small kernels, which compile in a moment.
SMALL = ["--device", "0", "--structure", "kd", "--packet-size", "1"]
INTERSECTOR = ["--intersector", "moller-trumbore"]


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
    if fault == LIMITED:
        # Blocks of 512 bytes in dash, of 1024 in others: less than the output takes.
        size = {"stress": 4, "turntable": 1200, "merge": 12000, "trace": 80000}.get(command, 24000)
        limited = ["-c", f'ulimit -f {size}; exec "$0" "$@"', program, *words]
        return ended(start("sh", folder, limited, {}))
    if fault == FULL:
        with full_disk(folder, ROOM.get(command, 12 << 20)):
            return ended(start(program, folder, words, {}))
    variables = {"OPENCL_DYLIB_PATH": library, "OPENCL_FAULT": f"from:{middle}:-36"}
    return ended(start(program, folder, words, variables))


def launch_in_the_middle(program, folder, words, library):
    """The number of a call of an undisturbed run. The first launches are small, so that it is not the middle one."""
    log = os.path.join(folder, "log")
    code, said = ended(start(program, folder, words, {"OPENCL_DYLIB_PATH": library, "OPENCL_FAULT_LOG": log}))
    if code not in (0, 1):
        sys.exit(f"{' '.join(words)} ends with {code}: {said}")
    with open(log) as file:
        launches = [number for number, name in enumerate(file, 1) if name.strip() == "clEnqueueNDRangeKernel"]
    return launches[len(launches) * 3 // 4]


def mount(*words):
    return subprocess.run(["mount", "-t", "tmpfs", *words], capture_output=True).returncode == 0


@contextlib.contextmanager
def disk(folder):
    """Puts a file system in memory at a folder; yields whether that is allowed."""
    is_there = mount("tmpfs", folder)
    try:
        yield is_there
    finally:
        if is_there:
            subprocess.run(["umount", folder], check=True)


@contextlib.contextmanager
def full_disk(folder, room):
    """Leaves so many bytes of that file system."""
    found = os.statvfs(folder)
    used = (found.f_blocks - found.f_bfree) * found.f_frsize
    mount("-o", f"remount,size={used + room}", folder) or sys.exit("no smaller file system")
    try:
        yield
    finally:
        mount("-o", f"remount,size={found.f_blocks * found.f_frsize}", folder)


def begun_with(said):
    """How many pieces of how many a run says that it begins with, and what they are."""
    found = re.search(r"goes on with .*?: (\d+) of (\d+ \w+)", said)
    return (int(found.group(1)), found.group(2)) if found else (0, "")


def one(program, command, fault, library, chance):
    """A row: exit code, what was lost and kept, the exit code of the same command, whether the bits are equal; and what
    is wrong.
    """
    is_of_device = fault.startswith("device")
    words = words_of(command, is_of_device)
    with common.new_folder() as folder, disk(folder) if fault == FULL else contextlib.nullcontext(True) as is_possible:
        if not is_possible:
            return None, None
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
            middle = 0.75 * (time.monotonic() - begun)
        undisturbed = common.outputs(folder)
        common.clear(folder)
        strict = ["--strict-device"] if fault == STRICT else []
        code, said = hit(program, folder, command, [*words, *strict], (fault, middle), library)
        while fault in TIMED and code in (0, 1):
            # It was late: the machine does something else now and then.
            common.clear(folder)
            middle *= 0.7
            code, said = hit(program, folder, command, words, (fault, middle), library)
        kept = resume.Frames(folder) if command == "turntable" else resume.Journal(folder, COMMANDS[command][1])
        finished, before = kept.finished()
        if fault == DAMAGED and kept.size() is not None:
            resume.spoil(kept.path, chance)
        again, text = (code, said) if code in (0, 1) else ended(start(program, folder, words, {}))
        is_equal = common.outputs(folder) == undisturbed
        names = common.files(folder)
        left = [name for name in names if name.endswith(".partial") or os.path.basename(name).startswith(".raybrook-")]
        has_note = fault != LOST or command == "stress" or "goes on in place of" in said
        lost, share = 0, "all"
        if code not in (0, 1):
            lost, share = loss(command, kept, (finished, before), text)
        is_right = again in (0, 1) and is_equal and not left and has_note and is_expected(command, fault, code)
        is_right = is_right and (lost == 0 or fault == DAMAGED)
        made_anew = f"0 ({lost} damaged, made anew)" if fault == DAMAGED and lost else lost
        row = (code, made_anew, share, again, "yes" if is_equal else "no")
        return row, None if is_right else f"{said}{text}{left}"


def words_of(command, is_of_device):
    """A command with its device."""
    words = COMMANDS[command][0]
    if is_of_device:
        return [*words, *SMALL, *([] if command == "stress" else INTERSECTOR)]
    return words if command == "merge" else [*words, *REFERENCE]


def loss(command, kept, finished_before, text):
    """How many finished pieces the same command did not go on with, and how many it did, from what it said."""
    finished, before = finished_before
    if command == "merge":
        return 0, "nothing is kept"
    if command == "turntable":
        return int(kept.has_lost(before)), f"{finished} of 12 frames"
    begun, of = begun_with(text)
    return max(0, finished - begun), f"{begun} of {of}" if of else "0"


def is_expected(command, fault, code):
    """Whether a run that a fault hit may end so: whoever is late finds it at its end."""
    if command == "stress" and fault == LOST:
        return code == 4
    return code in CODES[fault]


def faults_of(command):
    faults = [*SIGNALS, FULL, LIMITED]
    if command not in WITHOUT_JOURNAL:
        faults.append(DAMAGED)
    if command == "stress":
        faults.append(LOST)
    elif command != "merge":
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
        print(
            "| command | fault | exit code | finished pieces lost | kept | the same command again | same bits |\n"
            "|---|---|--:|--:|---|--:|---|"
        )
        for command in wanted:
            for fault in faults_of(command):
                row, wrong = one(program, command, fault, library, chance)
                row = row or ("SKIPPED: only root may mount a file system", "", "", "", "")
                print(f"| `{command}` | {fault} | " + " | ".join(str(value) for value in row) + " |", flush=True)
                if wrong is not None:
                    failures += 1
                    print(f"{command}, {fault}: {wrong}", file=sys.stderr)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
