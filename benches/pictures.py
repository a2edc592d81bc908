#!/usr/bin/env python3
"""How long whole pictures take: benches/pictures.py RAYBROOK [RAYBROOK...] SCENE [--size WxH] [-- OPTION...]

Renders the same picture with each of the programs in turn, such as one of before a change and one of after it, and
compares their files. What stands behind `--` is for `raybrook render`, such as `--samples 4`. Of each program medians:

- wall: seconds of the whole process, as its user waits for them, and how many times those of the first program;
- processor: seconds of all cores;
- asked: 1.25 times the kernels' seconds and .15 s, what a picture should take at most on two cores;
- kernel, decide: seconds of device time, and of the host to decide where a picture by its error needs more rays;
- MiB: the most memory at a time.

Kernels are compiled in a round before that is not counted; with `--cold` in every round, as in a user's first run.
Nothing else should run meanwhile. Python 3 on Unix, nothing else.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CACHES = ["RAYBROOK_CACHE_DIR", "POCL_CACHE_DIR", "CUDA_CACHE_PATH"]


def rendered(program, arguments, folder):
    """What is told of one picture, and its file."""
    picture, stats = folder / "picture.png", folder / "stats.json"
    words = [program, "render", arguments.scene, "--size", arguments.size, "--device", arguments.device, "--quiet"]
    words += ["--output", str(picture), "--stats", str(stats), *arguments.more]
    start = time.perf_counter()
    renderer = subprocess.Popen(words, env=os.environ | {name: str(folder) for name in CACHES})
    _, status, used = os.wait4(renderer.pid, 0)
    wall = time.perf_counter() - start
    renderer.returncode = os.waitstatus_to_exitcode(status)
    if renderer.returncode != 0:
        sys.exit(f"{' '.join(words)}: exit code {renderer.returncode}")
    told = json.loads(stats.read_text())
    decide = (told.get("adaptive") or {}).get("decide_s", 0.0)
    memory = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 2**20
    return (wall, used.ru_utime + used.ru_stime, sum(told["kernel_s"]), decide, memory), picture.read_bytes()


def one_round(turns, arguments):
    """The same of each program, with its folder."""
    for _, folder in turns:
        if arguments.cold:
            shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(exist_ok=True)
    return [rendered(program, arguments, folder) for program, folder in turns]


def main():
    words = sys.argv[1:]
    end = words.index("--") if "--" in words else len(words)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("programs", metavar="RAYBROOK", nargs="+")
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("--size", default="1920x1080", metavar="WxH")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rounds", type=int, default=5, metavar="N")
    parser.add_argument("--cold", action="store_true", help="with empty caches of kernels in every round")
    arguments = parser.parse_args(words[:end])
    arguments.more = words[end + 1 :]
    if arguments.rounds < 1:
        parser.error("--rounds: at least 1")
    for program in arguments.programs:
        if shutil.which(program) is None:
            parser.error(f"{program}: there is no such program")
    with tempfile.TemporaryDirectory() as made:
        turns = [(program, Path(made) / str(i)) for i, program in enumerate(arguments.programs)]
        files = [file for _, file in one_round(turns, arguments)]
        rounds = [[told for told, _ in one_round(turns, arguments)] for _ in range(arguments.rounds)]
    print("| program | wall, s | | processor, s | asked, s | kernel, s | decide, s | MiB | file |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|---|")
    first = None
    for program, file, *told in zip(arguments.programs, files, *rounds):
        wall, processor, kernel, decide, memory = (statistics.median(column) for column in zip(*told))
        first = first or wall
        same = "" if program is arguments.programs[0] else "the same" if file == files[0] else "other bytes"
        print(f"| {program} | {wall:.3f} | {wall / first:.2f} | {processor:.2f} | {1.25 * kernel + 0.15:.3f} "
              f"| {kernel:.3f} | {decide:.3f} | {memory:.0f} | {same} |")


if __name__ == "__main__":
    main()
