#!/usr/bin/env python3
"""What a thousand machines make of one picture, before anybody has them: a simulation with the program's own
sizes of blocks and with rates that were measured.

Machines of uneven speed take parts (`--part I/N`) from a queue, as Slurm or GNU parallel deal them out; now and
then one fails, and its part goes on from its journal, there or elsewhere. Then one machine merges. Printed is a
row for each number of parts:

    benches/scale.py                                  # the tables of the book's chapter
    benches/scale.py --machines 100 --pixels-per-s 5e7

Everything random comes from --seed. What it does not know: a network that is full, and a scheduler that is
slow.
"""

import argparse
import heapq
import math
import random
import statistics

# Of the program: src/blocks.rs, src/renderer/blocks.rs, src/renderer/stored.rs, src/runs.rs, src/io/journal.rs.
AREA_SIDE = 2048
PATCH_SIDE = 32
LARGEST_PATCH = 128
BLOCK_PIXELS = 1 << 17
BAND_PIXELS = 1 << 17
BAND_RAYS = 1 << 20
TILE_SIDE = 8
ENOUGH_AREAS = 4
PIXEL_BYTES = 12
MOST_OPEN = 1 << 16
GROUP_BYTES = 128 << 20
RUN_RAYS = 1 << 20
HIT_BYTES = 16
RAY_BYTES = 24
SYNC_EVERY_S = 1

# Measured, processor time of one core: docs/record/2026-11-26-host-merging-a-thousand-parts.md
MERGE_S_PER_GIB = 8.0

GIB = 1 << 30


def divide_up(a, b):
    return -(-a // b)


class Picture:
    """How a picture is cut, as the program cuts it."""

    def __init__(self, side, samples):
        self.pixels = side * side
        if samples:
            rows = min(BAND_RAYS // samples, BAND_PIXELS) // side // TILE_SIDE * TILE_SIDE
            rows = max(rows, TILE_SIDE)
            self.areas, self.blocks = None, divide_up(side, rows)
            # A band is read in one go.
            self.strips = self.blocks
        else:
            areas = max((side + AREA_SIDE // 2) // AREA_SIDE, 1)
            area = divide_up(divide_up(side, areas), LARGEST_PATCH) * LARGEST_PATCH
            across = divide_up(side, area)
            per_area = max((min(area, side) ** 2 + BLOCK_PIXELS // 2) // BLOCK_PIXELS, 1)
            self.areas, self.blocks = across * across, across * across * per_area
            self.blocks_across = across * per_area
            rows = max(GROUP_BYTES // (PIXEL_BYTES * side) // PATCH_SIDE * PATCH_SIDE, PATCH_SIDE)
            self.strips = across * divide_up(min(area, side), rows)

    def part(self, count):
        """Blocks of the largest part."""
        if self.areas and self.areas >= ENOUGH_AREAS * count:
            return divide_up(self.areas, count) * self.blocks // self.areas
        together = max(self.blocks // (ENOUGH_AREAS * count), 1) if self.areas is None else 1
        return divide_up(divide_up(self.blocks, together), count) * together

    def opens(self, parts, most_open):
        """How often `merge` opens a journal: once for its header, once for its blocks, and then for its pixels."""
        if parts <= most_open:
            return 3 * parts
        # A strip of bands is one block's; rows of patches have some of all blocks of the areas beside each other.
        of_strip = 1 if self.areas is None else min(parts, self.blocks_across)
        return 2 * parts + self.strips * of_strip


def speeds(count, chance):
    """Of machines: a factor of 1.35 up or down is usual, and one in twenty is half as fast for a reason of its own."""
    return [math.exp(chance.gauss(0, 0.3)) * (0.5 if chance.random() < 0.05 else 1) for _ in range(count)]


def run_parts(machines, parts, blocks_of_part, block_s, given, chance):
    """When the last part is finished, and the machine-seconds of work, of starts, and lost to failures."""
    free = [(0.0, number, speed) for number, speed in enumerate(speeds(machines, chance))]
    heapq.heapify(free)
    ends, worked, started, lost = [], 0.0, 0.0, 0.0
    for _ in range(parts):
        now, number, speed = heapq.heappop(free)
        left = blocks_of_part * block_s / speed
        worked += left
        while True:
            started += given.start_s
            until_failure = chance.expovariate(1 / (given.mtbf_h * 3600))
            if until_failure >= given.start_s + left:
                now += given.start_s + left
                break
            # What is finished is kept, but for a second of work and what was not on the disk yet.
            done = max(0.0, until_failure - given.start_s - 2 * SYNC_EVERY_S)
            lost += until_failure - given.start_s - done if until_failure > given.start_s else 0.0
            left -= done
            now += until_failure + given.restart_s
        ends.append(now)
        heapq.heappush(free, (now, number, speed))
    return max(ends), worked, started, lost


def merge_s(picture, opens, open_s):
    return PIXEL_BYTES * picture.pixels / GIB * MERGE_S_PER_GIB + opens * open_s


def clock(seconds):
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def picture_table(title, side, samples, given):
    picture = Picture(side, samples)
    size = PIXEL_BYTES * picture.pixels / GIB
    print(f"{title}: {side}x{side}, {picture.blocks} blocks, journals {size:.0f} GiB in all\n")
    print("| parts | blocks of a part | journal | duration | ideal | idle | starts | merge | opens | fsyncs a second |")
    print("|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    block_s = picture.pixels / picture.blocks / given.pixels_per_s
    for parts in given.parts:
        runs = []
        blocks = picture.part(parts)
        # The largest part stands for all but those that have nothing to do.
        busy = min(parts, divide_up(picture.blocks, blocks))
        for run in range(given.runs):
            chance = random.Random(f"{given.seed} {parts} {run}")
            runs.append(run_parts(given.machines, busy, picture.blocks / busy, block_s, given, chance))
        end, worked, started, lost = (statistics.median(values) for values in zip(*runs))
        ideal = worked / given.machines
        idle = 1 - (worked + started + lost) / (end * given.machines)
        journal = PIXEL_BYTES * picture.pixels / busy / (1 << 20)
        cells = [parts, blocks, f"{journal:.1f} MiB", clock(end), clock(ideal), f"{idle:.0%}"]
        opens = picture.opens(parts, given.most_open)
        cells += [f"{started / (end * given.machines):.0%}", clock(merge_s(picture, opens, given.open_s)), opens]
        cells += [min(given.machines, busy) // SYNC_EVERY_S]
        print("| " + " | ".join(map(str, cells)) + " |")
    print()


def rays_table(rays, given):
    runs = divide_up(rays, RUN_RAYS)
    answers, asked = HIT_BYTES * rays, RAY_BYTES * rays
    print(f"{rays:.0e} rays in one batch: {runs} runs\n")
    print("| what | how much |")
    print("|---|--:|")
    print(f"| file of rays, which every machine reads whole and holds in memory | {asked / GIB:.0f} GiB |")
    print(f"| read by {given.machines} machines together | {asked * given.machines / GIB / 1024:.0f} TiB |")
    print(f"| journals | {answers / GIB:.0f} GiB |")
    print(f"| memory of `merge` | {2 * answers / GIB:.0f} GiB |")
    print(f"| largest part of {given.machines} | {divide_up(runs, given.machines)} runs |")
    print()


def main():
    about = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    about.add_argument("--machines", type=int, default=1000)
    about.add_argument("--pixels-per-s", type=float, default=2e4, help="of a usual machine (default: hard pixels)")
    about.add_argument("--start-s", type=float, default=5, help="until a part traces: scene, structure, kernels")
    about.add_argument("--mtbf-h", type=float, default=500, help="hours from failure to failure of a machine")
    about.add_argument("--restart-s", type=float, default=120, help="until a part that failed goes on")
    about.add_argument("--open-s", type=float, default=1e-3, help="to open a file on a folder of a network")
    about.add_argument("--most-open", type=int, default=MOST_OPEN, help="files that merge may have open")
    about.add_argument("--parts", type=int, nargs="+", default=[1000, 2000, 4000, 8000, 16000])
    about.add_argument("--runs", type=int, default=5, help="simulations of each row, of which the median is printed")
    about.add_argument("--seed", type=int, default=1)
    given = about.parse_args()
    picture_table("By its error, the largest picture", 65_535, None, given)
    picture_table("By samples, 16, the largest picture", 65_535, 16, given)
    picture_table("By its error, if 10^10 pixels were one picture", 100_000, None, given)
    rays_table(10**9, given)
    rays_table(10**12, given)


if __name__ == "__main__":
    main()
