#!/usr/bin/env python3
"""Traces the rays that `raybrook study pareto --export-rays RAYS` wrote with Embree and CGAL, and writes OUT/NAME.json
with the answers beside it, for `raybrook study pareto --peer OUT/*.json`. README.md tells more."""
import argparse, json, os, shutil, subprocess, sys, time
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGES = {"embree": ["libembree-dev"], "cgal": ["libcgal-dev"]}
HEADERS = {"embree": "embree3/rtcore.h", "cgal": "CGAL/AABB_tree.h"}
FLAGS = {"embree": ["-lembree3"], "cgal": ["-frounding-math", "-DCGAL_NDEBUG", "-lgmp", "-lmpfr"]}
# Program, its mode, the tracer's name and mode as charts have them, and its function for closest and for any hits.
WAYS = [
    ("embree", "default1", "Embree", "", ("rtcIntersect1", "rtcOccluded1")),
    ("embree", "robust1", "Embree", "ROBUST", ("rtcIntersect1", "rtcOccluded1")),
    ("embree", "default16", "Embree", "packets", ("rtcIntersect16, coherent", "rtcOccluded16, coherent")),
    ("embree", "robust16", "Embree", "ROBUST packets", ("rtcIntersect16, coherent", "rtcOccluded16, coherent")),
    ("cgal", "exact", "CGAL", "exact predicates", ("first_intersected_primitive", "do_intersect of a segment")),
    ("cgal", "double", "CGAL", "doubles", ("first_intersected_primitive", "do_intersect of a segment")),
]


def cores():
    return len(os.sched_getaffinity(0))


def machine():
    for line in open("/proc/cpuinfo"):
        if line.startswith("model name"):
            return f"{line.split(':', 1)[1].strip()}, {cores()} cores"
    return f"unknown, {cores()} cores"


def build(program, folder):
    """The compiled program, or None where its library cannot be had."""
    preprocess = ["g++", "-E", "-include", HEADERS[program], "-x", "c++", "/dev/null"]
    is_there = lambda: subprocess.run(preprocess, capture_output=True).returncode == 0
    if not (shutil.which("g++") and is_there()):
        install = ["apt-get", "install", "-y", "--no-install-recommends", "g++", *PACKAGES[program]]
        if os.geteuid() == 0 and shutil.which("apt-get"):
            subprocess.run(install)
        if not (shutil.which("g++") and is_there()):
            print(f"{program} is left out: its library is missing; try: {' '.join(install)}", file=sys.stderr)
            return None
    made, source = folder / program, HERE / f"{program}.cpp"
    if not made.exists() or made.stat().st_mtime < max(source.stat().st_mtime, (HERE / "tracer.h").stat().st_mtime):
        print(f"building {program}", file=sys.stderr)
        command = ["g++", "-std=c++20", "-O3", "-march=native", "-DNDEBUG", source, "-o", made]
        subprocess.run([*command, *FLAGS[program], "-lpthread"], check=True)
    return made


class Run:
    """A way of tracing one set: a program that waits for the word."""

    def __init__(self, peer, entry, rays, out):
        self.peer, self.entry = peer, entry
        self.answers = f"{peer['file']}/{entry['name']}.hits.bin"
        (out / peer["file"]).mkdir(exist_ok=True)
        # Which triangle it is matters for stress rays, which functions for any hits do not tell.
        query = "closest" if "mode" in entry else entry["query"]
        self.call = peer["calls"][query == "any"]
        mode = peer["mode_of_program"]
        if mode.endswith("16") and entry.get("rays_of") == "diffuse":
            # Rays that go different ways are traced one by one: packets are for coherent ones.
            mode, self.call = mode.replace("16", "1"), "rtcIntersect1"
        if entry["second_rays"]:
            self.call += "; secondary rays by the same or rtcIntersect1, without the triangle that they leave"
        files = [rays / entry["mesh_bin"], rays / entry["rays_bin"], out / self.answers]
        command = [peer["made"], *files, query, str(peer["threads"]), mode]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.seconds = []
        ready = self.process.stdout.readline().split()
        if ready[:1] != ["ready"]:
            sys.exit(f"{peer['file']} failed on {entry['name']}: {self.process.wait()}")
        peer["version"] = ready[1]

    def trace(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        self.seconds.append(float(self.process.stdout.readline()))

    def finish(self):
        self.process.communicate()
        entry = {"set": self.entry["name"], "checksum": self.entry["checksum"], "rays": self.entry["rays"]}
        self.peer["sets"].append({**entry, "call": self.call, "seconds": self.seconds, "answers": self.answers})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rays", type=Path, help="folder of --export-rays")
    parser.add_argument("out", type=Path, help="folder for results")
    parser.add_argument("--passes", type=int, default=7, help="timed passes, after one to warm up [default: 7]")
    parser.add_argument("--threads", type=int, nargs="+", help="numbers of threads [default: 1 and all cores]")
    parser.add_argument("--only", help="programs whose name of file has this in it, such as cgal or robust")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    manifest = json.load(open(options.rays / "manifest.json"))
    peers = []
    for threads in options.threads or sorted({1, cores()}):
        for program, mode, name, words, calls in WAYS:
            file = f"{program}-{mode}-{threads}"
            if not options.only or options.only in file:
                peer = dict(file=file, program=program, mode_of_program=mode, name=name, mode=words, calls=calls)
                peers.append({**peer, "threads": threads, "sets": []})
    made = {program: build(program, options.out) for program in sorted({peer["program"] for peer in peers})}
    peers = [{**peer, "made": made[peer["program"]]} for peer in peers if made[peer["program"]]]
    for entry in manifest["sets"]:
        start = time.time()
        runs = [Run(peer, entry, options.rays, options.out) for peer in peers]
        # Stress rays are for answers alone. All ways take turns, each time another one begins.
        for turn in range(options.passes if "rays_of" in entry else 0):
            for i in range(len(runs)):
                runs[(i + turn) % len(runs)].trace()
        for run in runs:
            run.finish()
        print(f"{entry['name']}: {time.time() - start:.1f} s", file=sys.stderr)
    rays = {key: manifest[key] for key in ("checksum", "version", "seed", "quick", "side")}
    for peer in peers:
        told = {key: peer[key] for key in ("name", "version", "mode", "threads", "sets")}
        result = {"format": "raybrook peer 1", "rays": rays, "machine": machine(), "clock": "wall clock", **told}
        with open(options.out / f"{peer['file']}.json", "w") as file:
            json.dump(result, file, indent=1)
        print(options.out / f"{peer['file']}.json")


if __name__ == "__main__":
    main()
