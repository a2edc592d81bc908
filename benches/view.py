#!/usr/bin/env python3
"""How soon `raybrook view` answers: benches/view.py RAYBROOK SCENE [--size WxH] [--device NAME] [--moves N]

Talks HTTP as the page does. First the time from the program's start to the first picture. Then moves by random angles,
each once the picture before was finished: milliseconds to the first picture and to the finished one, of each the median
and the most. Then moves every 16 ms for three seconds, as while somebody drags: pictures a second. Wall clock; a
browser takes some ms more to show each. Nothing else should run meanwhile. Python 3, nothing else.
"""

import argparse
import json
import random
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "faults"))
import pages

LIMIT = 600  # seconds that an answer may take
DRAG_S = 3.0
STEP_S = 0.016


class Page(pages.Page):
    """A page that moves, and sees what comes of it."""

    def __init__(self, address):
        super().__init__(address, LIMIT)
        self.listening, self.version, self.frame = self.connect(), 0, 0

    def move(self, *angles):
        what = {"session": self.session, "moves": [{"orbit": angles}]}
        status, body = self.ask(self.acting, "act", json.dumps(what))
        if status not in (200, 204):
            raise RuntimeError(f"act: {status} {body[:200]}")

    def news(self):
        """What is told next, and whether there is another picture with it."""
        status, told, is_picture = self.next(self.listening, self.session, self.version, self.frame)
        if status == 404:
            raise RuntimeError("next: the page was forgotten")
        if not told:
            return {"is_finished": False}, False
        self.version, self.frame = told["version"], told["frame"]
        return told, is_picture

    def until_finished(self):
        """Seconds until the first picture, and until the finished one."""
        start, first = time.perf_counter(), None
        while True:
            told, is_picture = self.news()
            if is_picture:
                first = first or time.perf_counter() - start
            if first and told["is_finished"]:
                return first, time.perf_counter() - start


def dragged(page, chance):
    """Pictures a second while somebody drags."""
    until = time.perf_counter() + DRAG_S

    def drag():
        while time.perf_counter() < until:
            page.move(chance.uniform(0, 0.02), chance.uniform(-0.01, 0.01))
            time.sleep(STEP_S)

    hand, pictures = threading.Thread(target=drag), 0
    hand.start()
    while time.perf_counter() < until:
        pictures += page.news()[1]
    hand.join()
    return pictures / DRAG_S


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", metavar="RAYBROOK")
    parser.add_argument("scene")
    parser.add_argument("--size", default="1280x720", metavar="WxH")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--moves", type=int, default=25, metavar="N")
    arguments = parser.parse_args()
    words = [arguments.program, "view", arguments.scene, "--no-open"]
    words += ["--size", arguments.size, "--device", arguments.device]
    start = time.perf_counter()
    # What it has to say beside its address is for whoever measures.
    viewer = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        address = viewer.stdout.readline().strip()
        if not address:
            sys.exit(viewer.wait())
        page = Page(address)
        begun = time.perf_counter() - start
        first = begun + page.until_finished()[0]
        chance, times = random.Random(1), []
        for _ in range(arguments.moves):
            page.move(chance.uniform(-0.3, 0.3), chance.uniform(-0.2, 0.2))
            times.append(page.until_finished())
        cells = [f"{1000 * statistics.median(column):.0f}, {1000 * max(column):.0f}" for column in zip(*times)]
        row = [arguments.scene, arguments.size, f"{first:.2f}", *cells, f"{dragged(page, chance):.0f}"]
        print("| scene | size | start to first picture, s | first picture, ms | finished, ms | pictures/s |")
        print("|---|---|--:|--:|--:|--:|")
        print(f"| {' | '.join(row)} |")
    finally:
        viewer.terminate()
        viewer.wait()


if __name__ == "__main__":
    main()
