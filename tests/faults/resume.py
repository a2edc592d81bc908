#!/usr/bin/env python3
"""Kills a render or a trace again and again at random times, spoils its journal now and then, and lets it go on, until the output is
there: it must have the bytes of an undisturbed run's, no block or run of rays may be lost but those that were being made, and what is
damaged is made again.
"""

import os
import random
import re
import subprocess
import sys
import time

import common

RENDER = ["render", "scene.toml", "--size", "1600x1200", "-o", "out.pfm", "--keep", "always", "--device"]
TRACE = ["trace", "scene.toml", "many.npz", "-o", "out.npz", "--keep", "always", "--device"]
KINDS = {
    "samples, reference": [*RENDER, "reference", "--samples", "4"],
    "error, reference": [*RENDER, "reference", "--error", "0.3"],
    "error, device": [*RENDER, "0", "--error", "0.3"],
    "closest hits, reference": [*TRACE, "reference"],
    "all hits, reference": [*TRACE, "reference", "--all-hits"],
    "any hits, device": [*TRACE, "0", "--any-hit"],
}
# What takes a moment in place of what takes long.
QUICK = {"1600x1200": "8x8", "many.npz": "rays.npz"}
SIGNALS = ["SIGKILL", "SIGKILL", "SIGINT", "SIGTERM"]


def finished(text):
    """How many blocks a run says that it begins with."""
    found = re.search(r"goes on with .*?: (\d+) of", text)
    return int(found.group(1)) if found else 0


def until_done(program, words, kills, seconds, chance):
    """What is wrong with one output whose run is killed so often, or None; and how often it was."""
    with common.new_folder() as folder:
        common.scene(folder)
        if "many.npz" in words:
            many(os.path.join(folder, "many.npz"), chance)
        # With kernels compiled, which takes longer than a run lives.
        common.run(program, folder, [QUICK.get(word, word) for word in words])
        output = os.path.join(folder, words[words.index("-o") + 1])
        os.remove(output)
        kept = killed = 0
        while True:
            child = subprocess.Popen(
                [program, *words], cwd=folder, env=common.environment(folder), stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )
            is_killed = killed < kills
            if is_killed:
                time.sleep(chance.uniform(0.05, seconds))
                child.send_signal(common.SIGNALS[chance.choice(SIGNALS)])
            text = b"".join(child.communicate(timeout=common.LIMIT)).decode(errors="replace")
            begun = finished(text)
            # A run that was killed before it could say anything tells nothing.
            if begun and begun < kept:
                return f"{kept} blocks became {begun}", killed
            kept = max(kept, begun)
            if child.returncode == 0:
                break
            if not is_killed:
                return f"exit code {child.returncode}: {text}", killed
            killed += 1
            journal = output + ".partial"
            if os.path.exists(journal) and chance.random() < 0.1:
                spoil(journal, chance)
                kept = 0
        left = [name for name in common.files(folder) if ".partial" in name or name.startswith(".raybrook-")]
        if left:
            return f"left behind: {left}", killed
        whole = [*words[: words.index("--keep")], "--keep", "never", *words[words.index("--keep") + 2 :]]
        with open(output, "rb") as file:
            found = file.read()
        common.run(program, folder, whole)
        with open(output, "rb") as file:
            return (None if file.read() == found else "other bytes"), killed


def many(path, chance, times=1500):
    """Writes a batch of rays towards a sphere, six million unless told otherwise, of which some miss."""
    origins = [(chance.uniform(-1.2, 1.2), chance.uniform(-1.2, 1.2), 3.0) for _ in range(4096)]
    common.npz(path, {"origin": origins, "direction": [(0.0, 0.0, -1.0)] * len(origins)}, times)


def spoil(journal, chance):
    """Changes a byte behind the header, or cuts the end off."""
    size = os.path.getsize(journal)
    if size < 2000:
        return
    with open(journal, "r+b") as file:
        if chance.random() < 0.5:
            file.seek(chance.randrange(1000, size))
            file.write(bytes([chance.randrange(256)]))
        else:
            file.truncate(chance.randrange(1000, size))


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(f"usage: {sys.argv[0]} RAYBROOK KILLS [SEED]")
    program, kills = os.path.abspath(sys.argv[1]), int(sys.argv[2])
    chance = random.Random(int(sys.argv[3]) if len(sys.argv) == 4 else 1)
    failures = 0
    print("| kind | outputs | killed | what was wrong |\n|---|--:|--:|---|")
    for kind, words in KINDS.items():
        outputs, all_killed, seconds, fault = 0, 0, 2.0, None
        while all_killed < kills and fault is None:
            fault, killed = until_done(program, words, kills - all_killed, seconds, chance)
            outputs += 1
            all_killed += killed
            # An output that is there before its run is killed twice is killed sooner the next time.
            seconds = seconds if killed > 1 else max(0.1, seconds / 2)
        failures += fault is not None
        print(f"| {kind} | {outputs} | {all_killed} | {fault or 'nothing'} |", flush=True)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
