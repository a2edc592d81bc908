#!/usr/bin/env python3
"""Kills a render or a trace again and again at random times, spoils its journal now and then, and lets it go on, until
the output is there: it must have the bytes of an undisturbed run's, no block or run of rays may be lost but those that
were being made, and what is damaged is made again.

With --one a single run of each command that takes some 20 s is killed so many times before it may end, and no journal
is spoilt: what was finished stays as it is, byte by byte, and the next run begins with it.
"""

import argparse
import json
import os
import random
import re
import struct
import subprocess
import sys
import time
import zlib

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
ON = ["--device", "reference"]
ALWAYS = ["--keep", "always", *ON]
TURN = ["turntable", "scene.toml", "--size", "400x300"]
RENDER_LARGE = ["render", "scene.toml", "-o", "out.pfm", *ALWAYS, "--size"]
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
                [program, *words],
                cwd=folder,
                env=common.environment(folder),
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
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
    with open(journal, "r+b") as file:
        data = file.read()
        header = next((end for end, _ in records(data)), len(data))
        if header == len(data):
            return
        at = chance.randrange(header, len(data))
        if chance.random() < 0.5:
            file.seek(at)
            file.write(bytes([data[at] ^ chance.randrange(1, 256)]))
        else:
            file.truncate(at)


# One run of each, of some 20 s on two cores, and how often it is killed.
ONE = {
    "render": ([*RENDER_LARGE, "4800x3600", "--samples", "5"], 100),
    "render --error": ([*RENDER_LARGE, "3200x2400", "--error", "0.12"], 100),
    "trace": ([*TRACE, "reference"], 100),
    "stress": (["stress", "--rays", "6000", "--intersector", "thesis", "--json", "out.json", *ALWAYS], 30),
    "turntable": ([*TURN, "--samples", "8", "--frames", "72", "-o", "out.pfm", *ON], 30),
}
# How many pieces a run keeps at a time, as long as nobody knows.
GUESS = 8
# Seconds that one of them takes at most, also where the machine does something else.
LONG = 900
# Times 4096 rays: 36 runs.
TIMES = 9000


def records(data):
    """Where each whole record of a journal ends, and what is in it, up to the first that is not whole."""
    at = 16
    while data[at : at + 4] == b"rec\n" and at + 16 <= len(data):
        checksum, length = struct.unpack("<IQ", data[at + 4 : at + 16])
        payload = data[at + 16 : at + 16 + length]
        if len(payload) < length or zlib.crc32(data[at + 8 : at + 16] + payload) != checksum:
            return
        at += 16 + length
        yield at, payload


class Journal:
    """What a journal keeps."""

    def __init__(self, folder, output):
        self.path = os.path.join(folder, output + ".partial")

    def size(self):
        """In bytes; None before there is one."""
        return os.path.getsize(self.path) if os.path.exists(self.path) else None

    def finished(self):
        """How many pieces, and the bytes that must stay."""
        if not os.path.exists(self.path):
            return 0, b""
        with open(self.path, "rb") as file:
            data = file.read()
        pieces, end = 0, 0
        for end, payload in records(data):
            if payload[:1] != b"H":
                (length,) = struct.unpack("<I", payload[1:5])
                pieces += len(json.loads(payload[5 : 5 + length]).get("blocks", [0]))
        return pieces, data[:end]

    def has_lost(self, before):
        """Whether something of what was there before is gone or changed."""
        return not self.finished()[1].startswith(before)


class Frames:
    """The frames of a turntable."""

    def __init__(self, folder):
        self.folder = folder

    def size(self):
        """In frames; None before there is their manifest."""
        is_begun = os.path.exists(os.path.join(self.folder, "out-turntable.json"))
        return sum(name.endswith(".pfm") for name in os.listdir(self.folder)) if is_begun else None

    def finished(self):
        """How many frames, and what they are and when they were written, which must stay."""
        frames = {name: data for name, data in common.files(self.folder).items() if name.endswith(".pfm")}
        times = {name: os.stat(os.path.join(self.folder, name)).st_mtime_ns for name in frames}
        return len(frames), (frames, times)

    def has_lost(self, before):
        (frames, times), (old, old_times) = self.finished()[1], before
        return any(frames.get(name) != data or times[name] != old_times[name] for name, data in old.items())


def begin(program, folder, words):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.Popen([program, *words], cwd=folder, env=common.environment(folder), **pipes)


def undisturbed(program, folder, words, kept):
    """What a run writes, the seconds until it has kept something, and those that it takes."""
    begun = time.monotonic()
    child, at_first, start = begin(program, folder, words), None, None
    while child.poll() is None and start is None:
        size = kept.size()
        at_first = size if at_first is None else at_first
        start = time.monotonic() - begun if size != at_first else None
        time.sleep(0.002)
    said = child.communicate(timeout=LONG)[0].decode(errors="replace")
    seconds = time.monotonic() - begun
    if child.returncode not in (0, 1) or start is None:
        sys.exit(f"{' '.join(words)} ends with {child.returncode}: {said}")
    return common.outputs(folder), start, seconds


def live(chance, child, kept, start, share):
    """Waits until a run is to be killed: this share of them some time after they have kept something new, the others
    before that as far as can be foreseen. Returns the seconds until a run has kept something new.
    """
    if chance.random() >= share:
        time.sleep(chance.uniform(0, 0.7 * start))
        return start
    size, begun = kept.size(), time.monotonic()
    while child.poll() is None and kept.size() == size:
        time.sleep(0.001)
    took = time.monotonic() - begun
    time.sleep(chance.uniform(0, 0.2))
    return took if took < start and size is not None else start


def one(program, command, kills, chance):
    """A row of the table: seconds undisturbed, pieces, kills by SIGKILL and others, those behind which something new
    was kept, pieces lost, how often what was kept was less or another, whether the bytes are equal; and whether all is
    right.
    """
    words = ONE[command][0]
    output = words[words.index("--json" if command == "stress" else "-o") + 1]
    with common.new_folder() as folder:
        common.scene(folder)
        if "many.npz" in words:
            many(os.path.join(folder, "many.npz"), chance, TIMES)
        kept = Frames(folder) if command == "turntable" else Journal(folder, output)
        right, start, seconds = undisturbed(program, folder, words, kept)
        common.clear(folder)
        hard = soft = fruitful = lost = shrunk = pieces = 0
        # A turntable does not tell how many frames it begins with.
        of = int(words[words.index("--frames") + 1]) if "--frames" in words else None
        code, before = None, kept.finished()[1]
        while code is None:
            left = kills - hard - soft
            child = begin(program, folder, words)
            if left > 0:
                # So many that some is left for the last run, by what each has kept so far.
                share = (of - pieces) / (2 * left * (pieces + GUESS) / (fruitful + 1)) if of else 0.5
                start = live(chance, child, kept, start, min(share, 0.75))
                name = chance.choice(SIGNALS)
                child.send_signal(common.SIGNALS[name])
            said = child.communicate(timeout=LONG)[0].decode(errors="replace")
            if found := re.search(r"(?:goes on with .*?: |note: )(\d+) of (\d+) (?:blocks|runs|scenes|frames)", said):
                begun_with, of = int(found.group(1)), int(found.group(2))
                lost += max(0, pieces - begun_with) if "goes on with" in found.group(0) else 0
            if child.returncode in (0, 1):
                code = child.returncode
                break
            if left <= 0 or child.returncode not in (-9, -2, -15, 130, 143):
                ends = f"ends with {child.returncode}: {said}"
                return (f"{seconds:.1f}", of, hard, soft, fruitful, lost, shrunk, ends), False
            hard, soft = hard + (name == "SIGKILL"), soft + (name != "SIGKILL")
            shrunk += kept.has_lost(before)
            earlier, (pieces, before) = pieces, kept.finished()
            fruitful += pieces > earlier
        is_equal = common.outputs(folder) == right
        names = common.files(folder)
        left_over = [name for name in names if ".partial" in name or os.path.basename(name).startswith(".raybrook-")]
        is_right = is_equal and not left_over and not lost and not shrunk and hard + soft == kills
        return (f"{seconds:.1f}", of, hard, soft, fruitful, lost, shrunk, "yes" if is_equal else "no"), is_right


def one_of_each(program, wanted, chance):
    print(
        "| command | undisturbed, s | pieces | SIGKILL | SIGINT, SIGTERM | of these with something new | pieces lost "
        "| times that what was kept shrank or changed | same bits |\n|---|--:|--:|--:|--:|--:|--:|--:|---|"
    )
    failures = 0
    for command, kills in wanted:
        row, is_right = one(program, command, kills or ONE[command][1], chance)
        failures += not is_right
        print(f"| `{command}` | " + " | ".join(str(value) for value in row) + " |", flush=True)
    return failures


def again_and_again(program, kills, chance):
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
    return failures


def wanted_of(text):
    """A command, and how often it is killed."""
    command, _, kills = text.partition("=")
    if command not in ONE:
        raise argparse.ArgumentTypeError(f"one of {', '.join(ONE)}, and =KILLS if others than usual")
    return command, int(kills) if kills else None


def main():
    about = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    about.add_argument("program")
    about.add_argument("kills", type=int, nargs="?", default=100, help="of each kind; not with --one")
    about.add_argument("--seed", type=int, default=1)
    about.add_argument("--one", type=wanted_of, nargs="*", metavar="COMMAND[=KILLS]", help="all unless some are named")
    given = about.parse_args()
    program, chance = os.path.abspath(given.program), random.Random(given.seed)
    if given.one is None:
        failures = again_and_again(program, given.kills, chance)
    else:
        failures = one_of_each(program, given.one or [(command, None) for command in ONE], chance)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
