"""What do tiles cost? ``mcmd`` on one street, in memory and with little memory, and what differs.

A street with 1 % of outliers is written to a LAZ file, in millimeters far from the origin; or a
road of streets one after the other, as large as you like. Each verb runs in memory and by tiles,
alone on the machine. Seconds are of the clock and of processors. The memory is the peak of all
processes together, as proportional set sizes (Linux), the disk that of temporary files.

    python benchmarks/bench_tiling.py
    python benchmarks/bench_tiling.py --points 100_000_000 --street 100_000 --memory 6GB \\
        --verbs normals denoise segment --only-tiles --folder /large/disk
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

ORIGIN = [362_000, 5_157_000, 100]  # meters
LENGTH = 5.0  # of a street, in meters
STREETS = 10  # with seeds of their own, which a longer road repeats
SAMPLED = 0.5  # seconds between two looks at memory and disk
COMMANDS = {
    "normals": ["normals"],
    "auto": ["normals", "--n-neighbors", "auto"],
    "denoise": ["denoise"],
    "segment": ["segment"],
    "edges": ["edges"],
}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--memory", default="2GB", help="of the run by tiles")
    parser.add_argument("--verbs", nargs="+", choices=list(COMMANDS), default=["normals"])
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only-tiles", action="store_true", help="leave out the run in memory")
    parser.add_argument("--street", type=int, help="points of each street of a road; all of one")
    parser.add_argument("--folder", help="where all files are, until the end")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        source = Path(folder) / "street.laz"
        write_road(source, options.points, options.street or options.points)
        for verb in options.verbs:
            outputs = []
            kinds = {"memory": "1TB", "tiles": options.memory}
            for kind in list(kinds)[options.only_tiles :]:
                outputs.append(Path(folder) / f"{verb}-{kind}.laz")
                command = [*COMMANDS[verb], source, outputs[-1], "--memory", kinds[kind]]
                command += ["--n-jobs", options.processes]
                said = timed(command, Path(f"{outputs[-1]}.tiles"), options.points)
                print(f"{verb}, {kind}: {said}", flush=True)
            if options.only_tiles:
                outputs.pop().unlink()  # the disk is for the next
            if len(outputs) == 2:
                print(f"{verb}: {differing(*outputs)}")


def write_road(path, n, n_street):
    """In a process of its own, whose memory is then free: that of some streets."""
    code = (
        "import sys, laspy, numpy as np\n"
        "from sklearn_mcmd.datasets import make_street\n"
        "path, n, n_street = sys.argv[1], *map(int, sys.argv[2:])\n"
        "header = laspy.LasHeader(point_format=6, version='1.4')\n"
        f"header.scales, header.offsets = [0.001] * 3, {ORIGIN}\n"
        f"seeds, share = range(min({STREETS}, -(-n // n_street))), 0.01\n"
        "made = (make_street(n_street, outlier_share=share, random_state=i) for i in seeds)\n"
        "streets = [street.data for street in made]\n"
        "with laspy.open(path, 'w', header=header) as writer:\n"
        "    for i, first in enumerate(range(0, n, n_street)):\n"
        "        xyz = streets[i % len(streets)][: n - first]\n"
        f"        xyz = xyz + np.array({ORIGIN}) + [i * {LENGTH}, 0, 0]\n"
        "        points = laspy.ScaleAwarePointRecord.zeros(len(xyz), header=header)\n"
        "        points.x, points.y, points.z = xyz.T\n"
        "        writer.write_points(points)\n"
    )
    command = [sys.executable, "-c", code, *map(str, (path, n, n_street))]
    subprocess.run(command, check=True)


def timed(command, temporary, n):
    """Run mcmd; its summary in one line, seconds, memory, and bytes of temporary files a point."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "sklearn_mcmd", *map(str, command)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    peaks, done = [0, 0], threading.Event()

    def watch():
        while not done.wait(SAMPLED):
            now = memory_of(process.pid), size_of(temporary)
            peaks[:] = map(max, peaks, now)

    thread = threading.Thread(target=watch)
    thread.start()
    said, _ = process.communicate()
    done.set()
    thread.join()
    if process.returncode:
        raise SystemExit(f"mcmd ended with {process.returncode}")
    wall = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    said = "; ".join(" ".join(line.split()) for line in said.splitlines()[1:])
    taken = f"{peaks[0] / 1e6:.0f} MB, {peaks[1] / n:.0f} bytes of disk a point"
    return f"{wall:.1f} s, {cpu:.1f} s of processors, {taken} ({said})"


def memory_of(pid):
    """Bytes of a process and all that it began: what is shared counts once."""
    parents, total = {}, 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it may have ended
            parents[int(path.parent.name)] = int(path.read_text().rpartition(")")[2].split()[1])
    for one in parents:
        above = one
        while above not in (pid, 0, None):
            above = parents.get(above)
        with suppress(OSError, StopIteration):
            if above == pid:
                lines = Path(f"/proc/{one}/smaps_rollup").read_text().splitlines()
                total += next(1024 * int(line.split()[1]) for line in lines if line[:4] == "Pss:")
    return total


def size_of(folder):
    """Bytes on disk of the files of a folder."""
    total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):  # it may be gone
            total += 512 * path.lstat().st_blocks
    return total


def differing(first, second):
    """In words, of how many points attributes of two files differ."""
    from sklearn_mcmd.io import read_points

    a, b = read_points(first), read_points(second)
    if len(a) != len(b):
        return f"{len(a):,} and {len(b):,} points are kept"
    counts = {
        name: np.count_nonzero(~np.isclose(values, b.attributes[name], atol=1e-3, equal_nan=True))
        for name, values in a.attributes.items()
    }
    told = [f"{name} of {count:,}" for name, count in counts.items() if count]
    return f"differ: {', '.join(told)}" if told else "outputs are equal"


if __name__ == "__main__":
    main()
