#!/usr/bin/env python3
"""Moves about in `raybrook view` at random for a while, as several pages do that come and go, and tells how much memory
the program has: it may not grow, and every answer must be one that is expected.
"""

import json
import os
import random
import statistics
import subprocess
import sys
import threading
import time

import common
import pages

WORDS = ["view", "scene.toml", "--no-open", "--size", "640x480", "--error", "4", "--watch", "--device"]
LAYERS = ["picture", "picture", "picture", "wrong", "steps", "tests", "leaves"]
# Structure, traversal and triangle test; what does not go together is told, and nothing changes.
METHODS = [
    ("auto", "auto", "auto"),
    ("kd", "ropes", "auto"),
    ("grid", "auto", "moller-trumbore"),
    ("bvh8", "ropes", "auto"),
]
PAGES = 3
# Every method has been there after so many seconds.
WARM_S = 30
# Of the second quarter's median the last quarter's has at most so much: allocators give back what they like.
GROWTH = 1.15


def resident_mib(pid):
    with open(f"/proc/{pid}/status", encoding="utf-8") as status:
        return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS"))


class Page(pages.Page):
    """A page that does anything at random."""

    def __init__(self, address, chance, counts):
        super().__init__(address, common.LIMIT)
        self.chance, self.counts = chance, counts

    def post(self, name, what):
        status, body = self.ask(self.acting, name, json.dumps(what))
        # A scene that is not built, a pixel that is none, and a page that slept for too long are no faults.
        if status not in (200, 204, 404, 409):
            raise RuntimeError(f"{name} {what}: {status} {body[:200]}")
        if status == 404:
            self.begin()

    def moves(self):
        number, chance = self.chance.uniform, self.chance
        kinds = [
            {"orbit": [number(-0.3, 0.3), number(-0.2, 0.2)]},
            {"pan": [number(-0.1, 0.1), number(-0.1, 0.1)]},
            {"fly": [number(-0.02, 0.02) for _ in range(3)]},
            {"look": [number(-0.1, 0.1), number(-0.1, 0.1)]},
            {"zoom": number(-0.2, 0.2)},
            "reset",
        ]
        return chance.choices(kinds, weights=[6, 2, 2, 1, 2, 1], k=chance.randint(1, 4))

    def act(self):
        chance, kind = self.chance, self.chance.random()
        if kind < 0.80:
            self.post("act", {"session": self.session, "moves": self.moves()})
        elif kind < 0.88:
            self.post("pick", {"session": self.session, "x": chance.uniform(0, 639), "y": chance.uniform(0, 479)})
        elif kind < 0.95:
            self.post("act", {"session": self.session, "layer": chance.choice(LAYERS)})
        elif kind < 0.98:
            self.post("act", {"session": self.session, "exposure": chance.uniform(-4, 4)})
        elif kind < 0.99:
            self.post("method", dict(zip(("structure", "traversal", "intersector"), chance.choice(METHODS))))
        else:
            self.post("end", self.session)
            self.begin()
        # Now and then it rests, so that a picture is finished.
        time.sleep(chance.choice([0.01, 0.03, 0.03, 0.1, 0.1, 1.5]))

    def listen(self, until):
        connection, version, frame, of = self.connect(), 0, 0, None
        while time.monotonic() < until:
            session = self.session
            if of != session:
                version, frame, of = 0, 0, session
            status, told, is_picture = self.next(connection, session, version, frame)
            if status == 404 and self.session == session:
                time.sleep(0.1)  # it was forgotten, and whoever acts will notice
            if told:
                version, frame = told["version"], told["frame"]
                self.counts["pictures"] += is_picture
                self.counts["finished"] += told["is_finished"]


def parts(seen, count):
    """`seen` in so many parts, one after the other; none where it has fewer numbers."""
    size = len(seen) // count
    return [seen[i * size : (i + 1) * size] for i in range(count)] if size else []


def noted(work, faults):
    """A thread that notes what goes wrong."""
    def noting():
        try:
            work()
        except Exception as fault:  # whatever it is, it is one
            faults.append(repr(fault))

    thread = threading.Thread(target=noting)
    thread.start()
    return thread


def soak(program, device, seconds, seed):
    """What went wrong, or None; memory in each quarter of the time, MiB; what was counted."""
    with common.new_folder() as folder:
        common.scene(folder)
        child = subprocess.Popen(
            [program, *WORDS, device],
            cwd=folder,
            env=common.environment(folder),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            address = child.stdout.readline().strip()
            counts, faults = {"moves": 0, "pictures": 0, "finished": 0}, []
            until = time.monotonic() + WARM_S + seconds
            opened = [Page(address, random.Random(seed + i), counts) for i in range(PAGES)]

            def act(page):
                while time.monotonic() < until and not faults:
                    page.act()
                    counts["moves"] += 1

            threads = [noted(lambda page=page: page.listen(until), faults) for page in opened]
            threads += [noted(lambda page=page: act(page), faults) for page in opened]
            saved = time.monotonic()
            seen = []
            while time.monotonic() < until and child.poll() is None and not faults:
                time.sleep(1)
                if time.monotonic() > until - seconds:
                    seen.append(resident_mib(child.pid))
                # Files are saved again, too.
                if time.monotonic() > saved + 20:
                    os.utime(os.path.join(folder, "model.obj"))
                    saved = time.monotonic()
            for thread in threads:
                thread.join()
            if child.poll() is not None:
                faults.insert(0, f"it ended with {child.returncode}")
            quarters = [statistics.median(part) for part in parts(seen, 4)]
            if not faults and quarters[-1] > GROWTH * quarters[1]:
                faults.append("memory grows")
            return "; ".join(faults[:3]) or None, quarters, counts
        finally:
            child.kill()
            child.wait()


def main():
    if len(sys.argv) not in (3, 4, 5):
        sys.exit(f"usage: {sys.argv[0]} RAYBROOK SECONDS [DEVICE] [SEED]")
    program, seconds = os.path.abspath(sys.argv[1]), int(sys.argv[2])
    device = sys.argv[3] if len(sys.argv) > 3 else "reference"
    fault, memory, counts = soak(program, device, seconds, int(sys.argv[4]) if len(sys.argv) > 4 else 1)
    print("| device | seconds | moves | pictures | finished | MiB in each quarter | what was wrong |")
    print("|---|--:|--:|--:|--:|--:|---|")
    numbers = " | ".join(str(counts[name]) for name in ("moves", "pictures", "finished"))
    print(f"| {device} | {seconds} | {numbers} | {', '.join(f'{mib:.0f}' for mib in memory)} | {fault or 'nothing'} |")
    sys.exit(1 if fault else 0)


if __name__ == "__main__":
    main()
