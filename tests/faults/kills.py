#!/usr/bin/env python3
"""Stops render, trace, stress and study at random times and looks at what is left: no unfinished file, no output \
that is not whole,
the exit code of the signal, and what stress and study have found until then.
"""

import json
import os
import random
import subprocess
import sys
import time

import common

SMALL = ["--device", "reference"]
COMMANDS = {
    "render": [
        "render", "scene.toml", "--size", "512x384", "--samples", "4", "-o", "out.png", "--stats", "out.json", *SMALL
    ],
    "trace": ["trace", "model.obj", "rays.npz", "-o", "out.npz", "--stats", "out.json", "--repeat", "200", *SMALL],
    "stress": ["stress", "--rays", "300", "--json", "out.json", "--write", "wrong", "--intersector", "thesis", *SMALL],
    "study": ["study", "leaf-size", "layout", "--quick", "-o", "report", *SMALL],
}
# Seconds within which a program that has just been started may not even run.
YOUNG = 0.5
OLD = {"out.png": common.png(2, 2, 1), "out.json": b'{"old": true}', "out.npz": None}


def is_whole(name, data):
    """Whether a file is complete, as far as its kind tells; a journal may end in half a line."""
    if name.endswith(".png"):
        return common.is_png(data)
    if name.endswith(".json"):
        try:
            json.loads(data)
        except ValueError:
            return False
        return True
    if name.endswith(".npz"):
        return data[-22:-18] == b"PK\x05\x06"
    if name.endswith(".html"):
        return data.endswith(b"</html>")
    return True


def duration(program, words):
    with common.new_folder() as folder:
        common.scene(folder)
        start = time.monotonic()
        code, _, said = common.run(program, folder, words)
        if code not in (0, 1):
            sys.exit(f"{' '.join(words)} ends with {code}: {said.decode(errors='replace')}")
        return time.monotonic() - start


def fault(program, command, words, name, delay):
    """What is wrong with one run that is stopped, or None."""
    with common.new_folder() as folder:
        common.scene(folder)
        for old, data in OLD.items():
            if data is not None:
                common.write(folder, old, data)
        before = common.files(folder)
        child = subprocess.Popen(
            [program, *words],
            cwd=folder,
            env=common.environment(folder),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        time.sleep(delay)
        child.send_signal(common.SIGNALS[name])
        try:
            said = child.communicate(timeout=common.LIMIT)
        except subprocess.TimeoutExpired:
            child.kill()
            return "hangs"
        text = b"".join(said).decode(errors="replace")
        expected = {"SIGINT": 130, "SIGTERM": 143, "SIGKILL": -9}[name]
        # The run may have been at its end, or too young to take care of signals.
        early = -common.SIGNALS[name] if delay < YOUNG else expected
        if child.returncode not in (expected, early, 0, 1):
            return f"exit code {child.returncode} after {delay:.3f} s: {text}"
        after = common.files(folder)
        left = [file for file in after if os.path.basename(file).startswith(".raybrook-")]
        if left:
            return f"left behind: {left}"
        lost = [file for file in before if file not in after or file not in OLD and after[file] != before[file]]
        if lost:
            return f"lost or changed: {lost}"
        broken = [file for file in after if not is_whole(file, after[file])]
        if broken:
            return f"not whole: {broken}"
        lines = said[0].decode(errors="replace").splitlines()[1:]
        kinds = [line for line in lines if "wrong of" not in line and not line.startswith("raybrook")]
        if command == "stress" and child.returncode in (130, 143) and kinds:
            report = json.loads(after["out.json"])
            if len(report.get("methods", [{"kinds": []}])[0]["kinds"]) < len(kinds):
                return f"{len(kinds)} kinds were told, out.json has: {after['out.json'][:200]}"
        return None


def main():
    program, count = common.arguments(__doc__)
    table = common.Table()
    generator = random.Random(1)
    for command, words in COMMANDS.items():
        whole = duration(program, words)
        for name in common.SIGNALS:
            for _ in range(count):
                table.add(f"{command} {name}", fault(program, command, words, name, generator.uniform(0, whole)))
    table.end()


main()
