#!/usr/bin/env python3
"""Kills renders again and again at random times, spoils its journal now and then, and lets it go on, until the picture is there: the
pixels must be those of an undisturbed run, no block may be lost but those that were being rendered, and what is damaged is rendered again.
"""

import os
import random
import re
import subprocess
import sys
import time

import common

RENDER = ["render", "scene.toml", "--size", "1600x1200", "-o", "out.pfm", "--keep", "always", "--device"]
KINDS = {
    "samples, reference": [*RENDER, "reference", "--samples", "4"],
    "error, reference": [*RENDER, "reference", "--error", "0.3"],
    "error, device": [*RENDER, "0", "--error", "0.3"],
}
JOURNAL = "out.pfm.partial"
SIGNALS = ["SIGKILL", "SIGKILL", "SIGINT", "SIGTERM"]


def finished(text):
    """How many blocks a run says that it begins with."""
    found = re.search(r"goes on with .*?: (\d+) of", text)
    return int(found.group(1)) if found else 0


def until_done(program, words, kills, seconds, chance):
    """What is wrong with one render that is killed so often, or None; and how often it was."""
    with common.new_folder() as folder:
        common.scene(folder)
        # With kernels compiled, which takes longer than a run lives.
        common.run(program, folder, ["8x8" if word == "1600x1200" else word for word in words])
        os.remove(os.path.join(folder, "out.pfm"))
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
            journal = os.path.join(folder, JOURNAL)
            if os.path.exists(journal) and chance.random() < 0.1:
                spoil(journal, chance)
                kept = 0
        left = [name for name in common.files(folder) if ".partial" in name or name.startswith(".raybrook-")]
        if left:
            return f"left behind: {left}", killed
        whole = [*words[: words.index("--keep")], "--keep", "never", *words[words.index("--keep") + 2 :]]
        picture = os.path.join(folder, "out.pfm")
        with open(picture, "rb") as file:
            pixels = file.read()
        common.run(program, folder, whole)
        with open(picture, "rb") as file:
            return (None if file.read() == pixels else "other pixels"), killed


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
    print("| kind | pictures | killed | what was wrong |\n|---|--:|--:|---|")
    for kind, words in KINDS.items():
        pictures, all_killed, seconds, fault = 0, 0, 2.0, None
        while all_killed < kills and fault is None:
            fault, killed = until_done(program, words, kills - all_killed, seconds, chance)
            pictures += 1
            all_killed += killed
            # A picture that is done before it is killed twice is killed sooner the next time.
            seconds = seconds if killed > 1 else max(0.1, seconds / 2)
        failures += fault is not None
        print(f"| {kind} | {pictures} | {all_killed} | {fault or 'nothing'} |", flush=True)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
