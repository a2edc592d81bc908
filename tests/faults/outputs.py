#!/usr/bin/env python3
"""Outputs that cannot be written, or should not be: a full standard output or error, a closed pipe, a full disk, \
a limit of file
size, a folder that is read-only, and outputs that are inputs. What the user has stays, and the exit code \
tells what happened.
"""

import os
import signal
import subprocess

import common

SMALL = ["--device", "reference"]
RENDER = ["render", "model.obj", "--size", "24x16", "--samples", "1", *SMALL]
TRACE = ["trace", "model.obj", "rays.npz", *SMALL]
# What prints a result.
PRINTS = [
    ["info", "model.obj"],
    ["info", "model.obj", "--json"],
    ["methods"],
    ["methods", "--json"],
    ["devices"],
    ["devices", "--json"],
    ["stress", "edges", "--rays", "20", *SMALL],
    ["stress", "--list"],
    ["study", "--list"],
    ["tune", "model.obj", "--rays", "64", "--structure", "bvh2", "--json", *SMALL],
    ["--help"],
    ["--version"],
    [*RENDER, "-o", "out.png"],
    [*TRACE, "-o", "out.npz"],
]
# Arguments and the file that they would overwrite.
OVERWRITES = [
    ([*RENDER, "-o", "model.png"], "model.png"),
    ([*RENDER, "-o", "../{here}/./model.png"], "model.png"),
    ([*RENDER, "-o", "link.png"], "model.png"),
    ([*RENDER, "-o", "hard.png"], "model.png"),
    ([*RENDER, "-o", "bump.png"], "bump.png"),
    ([*RENDER, "-o", "out.png", "--stats", "model.obj"], "model.obj"),
    ([*RENDER, "-o", "out.png", "--stats", "model.mtl"], "model.mtl"),
    ([*RENDER, "-o", "out.png", "--stats", "model.png"], "model.png"),
    ([*RENDER, "-o", "out.png", "--stats", "out.png"], None),
    ([*RENDER, "-o", "out.png", "--aov", "steps", "--stats", "out-steps.png"], None),
    (["render", "scene.toml", "--size", "8x8", "-o", "floor.png", *SMALL], "floor.png"),
    (["render", "scene.toml", "--size", "8x8", "-o", "heights.png", *SMALL], "heights.png"),
    (["render", "scene.toml", "--size", "8x8", "-o", "model.png", *SMALL], "model.png"),
    (["render", "scene.toml", "--size", "8x8", "-o", "out.png", "--stats", "model.obj", *SMALL], "model.obj"),
    ([*TRACE, "-o", "rays.npz"], "rays.npz"),
    ([*TRACE, "-o", "model.obj"], "model.obj"),
    ([*TRACE, "-o", "out.npz", "--stats", "rays.npz"], "rays.npz"),
    ([*TRACE, "-o", "out.npz", "--stats", "./out.npz"], None),
    (["stress", "--replay", "model.obj", "rays.npz", "--json", "model.mtl", *SMALL], "model.mtl"),
    (["stress", "--replay", "model.obj", "rays.npz", "--json", "rays.npz", *SMALL], "rays.npz"),
    (["stress", "--closed", "model.obj", "--rays", "100", "--json", "model.obj", *SMALL], "model.obj"),
    (["study", "layout", "--quick", "--scene", "model.obj", "--markdown", "model.mtl", *SMALL], "model.mtl"),
    (["study", "layout", "--quick", "-o", "site", *SMALL], "site/index.html"),
    (["study", "layout", "--quick", "-o", "other", *SMALL], "other/data/layout.json"),
]


def prepare(folder):
    common.scene(folder)
    os.symlink("model.png", os.path.join(folder, "link.png"))
    os.link(os.path.join(folder, "model.png"), os.path.join(folder, "hard.png"))
    os.symlink("/dev/full", os.path.join(folder, "full.png"))
    common.write(folder, "site/index.html", "<html><title>mine</title></html>")
    common.write(folder, "other/data/layout.json", '{"layout": "mine"}')


def kept(before, after):
    """What is wrong with the files that were there."""
    lost = [file for file in before if after.get(file) != before[file]]
    left = [file for file in after if os.path.basename(file).startswith(".raybrook-")]
    return f"lost or changed: {lost}" if lost else f"left behind: {left}" if left else None


def check(program, words, codes, expected=(), **more):
    """What is wrong with a run in a folder of its own, or None: its exit code, the files before, and those that must be
    there after.
    """
    with common.new_folder() as folder:
        prepare(folder)
        before = common.files(folder)
        words = [word.replace("{here}", os.path.basename(folder)) for word in words]
        code, _, said = common.run(program, folder, words, **more)
        after = common.files(folder)
        told = (said or b"").decode(errors="replace")
        if code not in codes:
            return f"{' '.join(words)}: exit code {code}, not {codes}: {told}"
        if (
            code not in (0, 1)
            and said is not None
            and not any(line.startswith(("raybrook: ", "error: ")) for line in told.splitlines())
        ):
            return f"{' '.join(words)}: no message: {told}"
        missing = [file for file in expected if file not in after]
        return f"{' '.join(words)}: missing: {missing}" if missing else kept(before, after)


def outputs_of(words):
    return [word for word in words if word.startswith("out.")]


def full(table, program):
    for words in PRINTS:
        with open("/dev/full", "wb") as sink:
            # A picture is there although nobody can be told so.
            table.add("standard output full", check(program, words, [5], outputs_of(words), stdout=sink))
        with open("/dev/full", "wb") as sink:
            table.add("standard error full", check(program, words, [0, 1], outputs_of(words), stderr=sink))
        reader, writer = os.pipe()
        os.close(reader)
        table.add("closed pipe", check(program, words, [0, 1], outputs_of(words), stdout=writer, stderr=writer))
        os.close(writer)
    for words, code in [
        (["render", "none.obj"], 3),
        (["render", "model.obj", "--size", "x"], 2),
        (["info", "model.mtl"], 3),
    ]:
        with open("/dev/full", "wb") as sink:
            table.add("standard error full", check(program, words, [code], stderr=sink))


def limits(table, program):
    def one_block():
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (512, 512))

    size = ["--size", "128x96"]
    for words in [
        [*RENDER[:2], *size, *RENDER[4:], "-o", "out.png"],
        [*TRACE, "-o", "out.npz"],
        ["stress", "edges", "slivers", "--rays", "50", "--intersector", "thesis", "--write", "wrong", *SMALL],
    ]:
        table.add("limit of file size", check(program, words, [5], preexec_fn=one_block))
    for words in [
        [*RENDER, "-o", "full.png"],
        [*TRACE, "-o", "full.png"],
        [*RENDER, "-o", "out.png", "--stats", "full.png"],
    ]:
        table.add("full disk", check(program, words, [5]))


def read_only(table, program):
    with common.new_folder() as folder:
        prepare(folder)
        os.mkdir(os.path.join(folder, "closed"), 0o555)
        try:
            with open(os.path.join(folder, "closed", "probe"), "wb"):
                return  # root may write anywhere
        except OSError:
            pass
        for words in [[*RENDER, "-o", "closed/out.png"], [*TRACE, "-o", "closed/out.npz"]]:
            code, _, said = common.run(program, folder, words)
            table.add("read-only folder", None if code == 5 else f"exit code {code}: {said.decode(errors='replace')}")


def main():
    program, count = common.arguments(__doc__)
    table = common.Table()
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    for _ in range(count):
        for words, _ in OVERWRITES:
            table.add("output is input", check(program, words, [2]))
        # The picture has another name, and the texture is what it was.
        default = check(program, RENDER, [0], ["model-render.png"])
        table.add("output without a name", default)
        full(table, program)
        limits(table, program)
        read_only(table, program)
    table.end()


main()
