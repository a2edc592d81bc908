#!/usr/bin/env python3
"""Has each engine that is installed do what the book prints for many machines (docs/book/src/long.md and many.md), by
two to four workers on this machine: a picture, and then a batch of rays by the same commands. The output must have the
bytes of one run without parts. An engine that is not installed is skipped, and its row says what installs it; with
--all that is a failure.

The commands are read from the book, and run in a folder that has its scenes, of which one has a smaller picture, and
rays. Dask's rows need a Python that has raybrook and Dask: run the script by that one. Slurm's need a Slurm that runs,
or root, who may begin one.
"""

import argparse
import contextlib
import glob
import os
import random
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(ROOT, "tests", "faults"))

import resume  # noqa: E402

BOOK = os.path.join(ROOT, "docs", "book", "src")
# Seconds that a row may take.
LIMIT = 600
# Times 4096 rays: six runs, so that every part has some.
TIMES = 1500
# What makes the book's picture one of a batch of rays.
RAYS = [
    ("raybrook render", "raybrook trace"),
    ("scenes/chess.toml", "scenes/chess.toml rays.npz"),
    ("chess.png", "hits.npz"),
]
# Name, what begins its block in the book, its program, what installs it, and how many workers.
ENGINES = [
    ("parts by hand", "## Parts on many machines", "raybrook", "", 3),
    ("MPI", "**MPI**", "mpirun", "apt-get install openmpi-bin", 4),
    ("GNU parallel", "**GNU parallel**", "parallel", "apt-get install parallel", 2),
    ("Slurm array", "**Slurm**", "sbatch", "apt-get install slurm-wlm", 4),
    ("Open Job Description", "**Open Job Description**", "openjd", "pip install openjd-cli", 3),
]
SLURM = """
ClusterName=raybrook
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/none
CredType=cred/none
SlurmUser=root
SlurmdUser=root
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES State=UP
"""
# A worker is killed once some of a batch's tasks are done, and some not.
KILLED = """
import os, sys, time
import dask, dask.array as da, numpy as np
from dask.distributed import Client, LocalCluster, futures_of
import raybrook, raybrook.dask as lazy

def main(what):
    scene = raybrook.Scene.load("scenes/vase.obj")
    rays = np.random.default_rng(0).random((4_000_000, 6), np.float32) * 2 - 1
    if what == "trace":
        hits = lazy.trace(scene, da.from_array(rays, chunks=(100_000, 6)))
        asked, expected = [hits.t, hits.triangle], scene.closest_hits(rays)
        expected = [expected.t, expected.triangle]
    else:
        view = {"width": 640, "height": 480, "samples": 16}
        asked, expected = [lazy.render(scene, tasks=24, **view)], [scene.render(**view).pixels]
    with LocalCluster(n_workers=3, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        answers = client.persist(asked)
        pieces = futures_of(answers)
        while not any(piece.status == "finished" for piece in pieces):
            time.sleep(0.001)
        workers = client.run(os.getpid)
        busy = [worker for worker, tasks in client.processing().items() if tasks]
        done = sum(piece.status == "finished" for piece in pieces)
        os.kill(workers[busy[0]], 9)
        found = dask.compute(*answers)
        gone = workers[busy[0]] not in client.run(os.getpid).values()
    same = gone and done < len(pieces) and all(a.tobytes() == b.tobytes() for a, b in zip(found, expected))
    print(f"killed when {done} of {len(pieces)} pieces were there")
    sys.exit(0 if same else "other bytes, or the worker was not killed in the middle")

if __name__ == "__main__":
    main(sys.argv[1])
"""


def block(page, begin, language):
    """The first block of code behind a line of the book that begins so."""
    with open(os.path.join(BOOK, page)) as file:
        text = file.read()
    found = re.search(rf"^{re.escape(begin)}.*?^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return found.group(1) if found else sys.exit(f"{page} has no block behind '{begin}'")


def of_rays(words):
    """The commands of a picture as those of a batch of rays."""
    for old, new in RAYS:
        words = words.replace(old, new)
    # The template is told what it is to run; the options of a picture are none of rays.
    words = words.replace("-p Scene=scenes/chess.toml rays.npz", "-p Scene=scenes/chess.toml -p Command=trace")
    words = words.replace('"Options=--error 1"', '"Options=$PWD/rays.npz"')
    return re.sub(r" --error \S+", "", words)


class Work:
    """The folder that commands run in, and what they find in their environment."""

    def __init__(self, folder, program):
        self.folder = folder
        scenes = os.path.join(folder, "scenes")
        shutil.copytree(os.path.join(ROOT, "scenes"), scenes)
        shutil.copytree(os.path.join(ROOT, "examples", "openjd"), os.path.join(folder, "examples", "openjd"))
        chess = os.path.join(scenes, "chess.toml")
        with open(chess) as file:
            text = file.read()
        small = text.replace("width = 1280", "width = 320").replace("height = 720", "height = 180")
        with open(chess, "w") as file:
            file.write(small)
        resume.many(os.path.join(folder, "rays.npz"), random.Random(1), TIMES)
        programs = os.path.join(folder, "bin")
        os.mkdir(programs)
        os.symlink(program, os.path.join(programs, "raybrook"))
        path = os.pathsep.join([programs, os.path.dirname(sys.executable), os.environ["PATH"], "/usr/sbin"])
        self.variables = {"RAYBROOK_DEVICE": "reference", **os.environ, "PATH": path}
        self.variables["RAYBROOK_CACHE_DIR"] = os.path.join(folder, "cache")
        # More workers than cores, and by root: mpirun wants to be told.
        for name in ("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "OMPI_MCA_rmaps_base_oversubscribe"):
            self.variables[name] = "1"
        self.variables["PRTE_MCA_rmaps_default_mapping_policy"] = ":oversubscribe"
        self.right = {}

    def has(self, name):
        return shutil.which(name, path=self.variables["PATH"]) is not None

    def run(self, words):
        """The seconds that a script of bash takes, and what it says if it fails."""
        begun = time.monotonic()
        try:
            given = {"cwd": self.folder, "env": self.variables, "stdin": subprocess.DEVNULL, "timeout": LIMIT}
            ended = subprocess.run(["bash", "-euc", words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **given)
        except subprocess.TimeoutExpired:
            return LIMIT, f"takes longer than {LIMIT} s"
        said = ended.stdout.decode(errors="replace")
        self.said = said
        return time.monotonic() - begun, said if ended.returncode else None

    def output(self, name):
        """Takes the file that was written away."""
        path = os.path.join(self.folder, name)
        try:
            with open(path, "rb") as file:
                return file.read()
        except FileNotFoundError:
            return None
        finally:
            for left in glob.glob(path + "*"):
                os.remove(left)

    def whole(self, name, options):
        """What one run without parts writes."""
        if (name, options) not in self.right:
            words = f"raybrook render scenes/chess.toml {options} -o chess.png"
            _, fault = self.run(words if name == "chess.png" else of_rays(words))
            self.right[name, options] = self.output(name) or sys.exit(f"{words}: {fault}")
        return self.right[name, options]


@contextlib.contextmanager
def slurm(work):
    """A Slurm of this machine alone, unless there is one; yields why there is none."""
    given = {"env": work.variables, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    if subprocess.run(["sinfo"], **given).returncode == 0:
        yield None
        return
    if os.geteuid() != 0 or not work.has("slurmd"):
        yield "no Slurm runs here, and only root can begin one"
        return
    folder = os.path.join(work.folder, "slurm")
    for name in ("state", "spool"):
        os.makedirs(os.path.join(folder, name))
    ports = []
    for _ in range(2):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            ports.append(free.getsockname()[1])
    work.variables["SLURM_CONF"] = os.path.join(folder, "slurm.conf")
    with open(work.variables["SLURM_CONF"], "w") as file:
        host = socket.gethostname().partition(".")[0]
        file.write(SLURM.format(folder=folder, host=host, ports=ports, cpus=os.cpu_count()))
    daemons = [subprocess.Popen([name, "-D"], **given) for name in ("slurmctld", "slurmd")]
    try:
        until = time.monotonic() + 60
        ask = ["sinfo", "-h", "-o", "%T"]
        while b"idle" not in subprocess.run(ask, env=work.variables, capture_output=True).stdout:
            if time.monotonic() > until:
                yield f"Slurm does not begin; {folder} had its logs"
                return
            time.sleep(0.2)
        yield None
    finally:
        for daemon in daemons:
            daemon.terminate()
            daemon.wait()


class Table:
    def __init__(self):
        self.failures = self.skipped = 0
        print("| engine | command | workers | seconds | same bytes as one run |\n|---|---|--:|--:|---|", flush=True)

    def add(self, engine, command, workers, seconds, fault):
        self.failures += fault is not None
        if fault is not None:
            print(f"{engine}, {command}: {fault}", file=sys.stderr)
        print(f"| {engine} | {command} | {workers} | {seconds:.1f} | {'no' if fault else 'yes'} |", flush=True)

    def skip(self, engine, why):
        self.skipped += 1
        print(f"| {engine} | SKIPPED: {why} | | | |", flush=True)


def with_parts(table, work, engine, begin, workers):
    words = block("long.md", begin, "sh")
    option = re.search(r"--error [0-9.]+", words)
    for command, name in (("render", "chess.png"), ("trace", "hits.npz")):
        right = work.whole(name, option.group(0) if option and command == "render" else "")
        seconds, fault = work.run(words if command == "render" else of_rays(words))
        found = work.output(name)
        table.add(engine, f"`{command}`", workers, seconds, fault or (None if found == right else "other bytes"))


def with_dask(table, work):
    if subprocess.run([sys.executable, "-c", "import raybrook.dask, dask.distributed"], capture_output=True).returncode:
        table.skip("Dask", "pip install '.[dask]', and run this script by that Python")
        return
    programs = {"book.py": block("many.md", "## Dask", "python"), "killed.py": KILLED}
    for name, text in programs.items():
        with open(os.path.join(work.folder, name), "w") as file:
            file.write(text)
    table.add("Dask", "the book's program", 2, *work.run(f"'{sys.executable}' book.py"))
    for command in ("trace", "render"):
        seconds, fault = work.run(f"'{sys.executable}' killed.py {command}")
        when = re.search(r"killed when .*", work.said)
        table.add("Dask", f"`{command}`, a worker {when.group(0) if when else 'killed'}", 3, seconds, fault)


def main():
    names = [name for name, *_ in ENGINES] + ["Dask"]
    about = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    about.add_argument("program")
    about.add_argument("engines", nargs="*", metavar="ENGINE", help=f"of {', '.join(names)}; else all")
    about.add_argument("--all", action="store_true", help="fail where one is not installed")
    given = about.parse_args()
    if unknown := set(given.engines) - set(names):
        about.error(f"no engine: {', '.join(unknown)}")
    with tempfile.TemporaryDirectory(prefix="raybrook-engines-") as folder:
        work, table = Work(folder, os.path.abspath(given.program)), Table()
        for engine, begin, program, install, workers in ENGINES:
            if given.engines and engine not in given.engines:
                continue
            if not work.has(program):
                table.skip(engine, install)
                continue
            with slurm(work) if program == "sbatch" else contextlib.nullcontext() as why:
                if why:
                    table.skip(engine, why)
                else:
                    with_parts(table, work, engine, begin, workers)
        if not given.engines or "Dask" in given.engines:
            with_dask(table, work)
    sys.exit(1 if table.failures or given.all and table.skipped else 0)


if __name__ == "__main__":
    main()
