"""Commands that are killed (kill -9), interrupted (Ctrl-C) or lose power at random moments lose
nothing.

    python benchmarks/kill_runs.py --kills 100 --interrupts 20
    sudo python benchmarks/kill_runs.py --kills 0 --interrupts 0 --power-failures 40

Of each kind of work, so many processes are ended at moments drawn from the time that it takes.
After each, inputs are as they were (of a folder that is replaced in place, each file is the old or
the new one), what has an output's name is whole, the old or the new one, and a following run gives
what an undisturbed one gives. After Ctrl-C no temporary file is left either, and the process has
ended within PROMPT seconds with exit code 130. Processes are forks of one that has all imports and
compiled code.

Where power fails, the files are on an ext4 in a file, and the following run finds what had been
written back of it when the process was killed.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from sklearn_mcmd.__main__ import main as mcmd
from sklearn_mcmd.cli import app
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._formats import supported_extensions

PROMPT = 1.0  # seconds
DISK = 256_000_000  # bytes
N_KILLED = 3_000  # points of inputs
N_WRITTEN = 20_000
VERBS = {
    "denoise": "in.las out.las",
    "normals": "in.las out.ply",
    "segment": "in.las out.csv",
    "edges": "in.las out.npy",
    "plane": "in.las out.las",
    "view": "in.las -o out.html",
}
FOLDERS = {"denoise a folder": "denoise in out", "normals of a folder": "normals in out"}
IN_PLACE = {"denoise in place": "denoise out out"}
WRITING = {f"write {suffix}": f"out{suffix}" for suffix in supported_extensions(written=True)}
KINDS = {**{verb: f"{verb} {words}" for verb, words in VERBS.items()}, **FOLDERS, **IN_PLACE}
KINDS |= WRITING


class Disk:
    """An ext4 in a file below a folder, which loses what was not written back when power fails."""

    def __init__(self, folder, seed):
        self.image, self.place = folder / "disk", folder / "mounted"
        self._rng = np.random.default_rng(seed)
        self.place.mkdir()
        with open(self.image, "wb") as file:
            file.truncate(DISK)
        command("mkfs.ext4", "-q", "-F", self.image)
        self._mount()

    def fail(self):
        """The system writes back all names, and the contents of the files that it likes."""
        for path in [path for path in self.place.rglob("*") if path.is_file()]:
            if self._rng.random() < 0.5:
                with open(path, "rb") as file:
                    os.fsync(file.fileno())
        shutil.copyfile(self.image, other := self.image.with_suffix(".copy"))
        self.close()
        other.replace(self.image)
        self._mount()

    def close(self):
        command("umount", "--lazy", self.place)

    def _mount(self):
        command("mount", "-o", "loop", self.image, self.place)


def command(*words):
    subprocess.run([*map(str, words)], check=True)


class Work:
    """One kind of work in a folder of its own, and what it makes undisturbed."""

    def __init__(self, kind, folder, n_points, disk=None):
        self.kind, self.folder, self.disk = kind, folder, disk
        self.clouds = [street(n_points, seed) for seed in range(2)]
        if kind in WRITING:
            self.clouds = [PointCloud(street(N_WRITTEN, seed).xyz) for seed in range(2)]
        self.begin()
        self.inputs = {path: path.read_bytes() for path in folder.rglob("in/*.*")}
        self.inputs |= {path: path.read_bytes() for path in folder.glob("in.*")}
        self.old = self.outputs()
        self.seconds = np.inf
        for _ in range(3):  # the first times are longer
            self.begin()
            begin = time.monotonic()
            _, code = self.run()
            self.seconds, self.new = min(self.seconds, time.monotonic() - begin), self.outputs()
            if self.seconds > 1:
                break
        if code != 0 or self.new == self.old:
            raise RuntimeError(f"{kind} ended with {code}, or made nothing new")

    def begin(self):
        """Remove everything, make the inputs anew, and an older output."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        if self.kind in FOLDERS | IN_PLACE:
            place = self.folder / KINDS[self.kind].split()[1]
            place.mkdir()
            for name, cloud in zip(("a.las", "b.las"), self.clouds, strict=True):
                write_points(place / name, cloud)
            return
        write_points(self.folder / "in.las", self.clouds[0])
        out = self.folder / KINDS[self.kind].split()[-1]
        if out.suffix == ".html":
            out.write_text("old")
        else:
            write_points(out, PointCloud(self.clouds[1].xyz))

    def run(self, after=None, number=None):
        """Let a fork work, and send it a signal after some seconds.

        Returns how long it took to end from there, and its exit code.
        """
        child = os.fork()
        if child == 0:
            _do(self)
        if after is not None:
            time.sleep(after)
            os.kill(child, number)
        begin = time.monotonic()
        _, status = os.waitpid(child, 0)
        return time.monotonic() - begin, os.waitstatus_to_exitcode(status)

    def outputs(self):
        """What has the name of an output, in a form that is equal for equal contents."""
        outputs = sorted([*self.folder.glob("out.*"), *self.folder.glob("out/*")])
        return {
            path.name: _told(path) for path in outputs if path.is_file() and path.name[0] != "."
        }

    def end(self, after, number):
        """End a run; returns how long it took, its exit code, and all that is wrong then."""
        self.begin()
        if self.disk is not None:
            command("sync", "--file-system", self.disk.place)
        seconds, code = self.run(after, number)
        if self.disk is not None:
            self.disk.fail()
        faults, now = [], self.outputs()
        faults += [
            f"{p.name} has changed" for p, was in self.inputs.items() if p.read_bytes() != was
        ]
        faults += [f"{name} is gone" for name in self.old.keys() - now.keys()]
        for name, told in now.items():
            if told not in (self.new[name], self.old.get(name)):
                faults.append(f"{name} is neither the old nor the new one")
        if number == signal.SIGINT:
            faults += [f"{path.name} is left" for path in self.folder.rglob(".mcmd-*")]
            faults += [f"took {seconds:.1f} s"] if seconds > PROMPT and code else []
            faults += [f"exit code {code}"] if code not in (0, 130) else []
        is_done = now == self.new and not (self.folder / "out.tiles" / "moves.json").exists()
        # Ctrl-C leaves nothing of one file. In place, a run would judge what is left of points.
        alone = number == signal.SIGINT and self.kind in VERBS
        if not (alone or (self.kind in IN_PLACE and is_done)):
            _, code_then = self.run()
            if code_then != 0:
                faults.append(f"the following run ended with {code_then}")
            elif self.outputs() != self.new:
                faults.append("the following run made something else")
        return seconds, code, faults


def _do(work):
    """The work itself, in a process of its own, silently; it never returns."""
    null, code = os.open(os.devnull, os.O_RDWR), 1
    for stream in (1, 2):
        os.dup2(null, stream)
    os.chdir(work.folder)
    try:
        if work.kind in WRITING:
            write_points(KINDS[work.kind], work.clouds[0])
            code = 0
        else:
            sys.argv = ["mcmd", *KINDS[work.kind].split(), "--quiet"]
            mcmd()
    except SystemExit as end:
        code = end.code or 0
    except KeyboardInterrupt:  # before the command has begun
        code = 130
    finally:
        os._exit(code)


def _told(path):
    if path.suffix == ".html":
        return path.read_bytes()
    try:
        cloud = read_points(path)
    except ValueError as err:
        return str(err)
    return cloud.xyz.tobytes(), {name: a.tobytes() for name, a in cloud.attributes.items()}


def street(n, seed):
    xyz = make_street(n, outlier_share=0.03, random_state=seed).data
    return PointCloud(np.round(xyz, 3), {"intensity": np.arange(n).astype(np.uint16)})


def warm_up(folder):
    """Load libraries and compiled code, but not lazrs, whose threads would not be in forks."""
    write_points(folder / "in.las", street(N_KILLED, 0))
    before = os.getcwd()
    os.chdir(folder)
    try:
        for verb in VERBS:
            CliRunner().invoke(app, [*KINDS[verb].split(), "--quiet"])
    finally:
        os.chdir(before)


def measure(kind, n, number, folder, n_points=N_KILLED, seed=0, disk=None):
    """Print a row for a kind of work; returns all that was wrong."""
    rng = np.random.default_rng(seed)
    work, late, n_ended, faults = Work(kind, folder / "work", n_points, disk), 0.0, 0, []
    for _ in range(n):
        seconds, code, wrong = work.end(rng.uniform(0, work.seconds), number)
        if code != 0:
            n_ended, late = n_ended + 1, max(late, seconds)
        faults += wrong
    how = "power" if disk else number.name
    row = f"{how:8} {kind:20} {work.seconds:7.2f} s {n_ended:4} of {n:4} ended"
    print(f"{row}, the latest after {late:.2f} s; {len(faults)} faults", flush=True)
    for fault, times in Counter(faults).items():
        print(f"    {times} times: {fault}")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=100, help="of each kind of work")
    parser.add_argument("--interrupts", type=int, default=20, help="of each verb")
    parser.add_argument("--power-failures", type=int, default=0, help="of each run on a folder")
    parser.add_argument("--points", type=int, default=100_000, help="of what is interrupted")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=KINDS, action="append")
    args = parser.parse_args()
    kinds, faults = args.kind or [*KINDS], []
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which the background ignores
    with tempfile.TemporaryDirectory() as folder:
        warm_up(Path(folder))
        for kind in kinds if args.kills else ():
            faults += measure(kind, args.kills, signal.SIGKILL, Path(folder), seed=args.seed)
        for kind in [kind for kind in kinds if kind not in WRITING] if args.interrupts else ():
            options = {"n_points": args.points, "seed": args.seed}
            faults += measure(kind, args.interrupts, signal.SIGINT, Path(folder), **options)
        if args.power_failures:
            disk = Disk(Path(folder), args.seed)
            try:
                for kind in [kind for kind in kinds if kind in FOLDERS | IN_PLACE]:
                    options = {"seed": args.seed, "disk": disk}
                    n, place = args.power_failures, disk.place
                    faults += measure(kind, n, signal.SIGKILL, place, **options)
            finally:
                disk.close()
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
