"""What do tiles cost? ``mcmd`` on one street, in memory and with little memory, and whether equal.

A street with 1 % of outliers is written to a LAZ file, in millimeters far from the origin. Each
verb runs in memory and by tiles, alone on the machine. Seconds are of the clock and of processors.

    python benchmarks/bench_tiling.py
    python benchmarks/bench_tiling.py --points 20_000_000 --memory 2GiB --verbs normals --only-tiles
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ORIGIN = [362_000, 5_157_000, 100]  # meters
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
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "street.laz"
        write_street(source, options.points)
        for verb in options.verbs:
            outputs = []
            kinds = {"memory": "1TB", "tiles": options.memory}
            for kind in list(kinds)[options.only_tiles :]:
                outputs.append(Path(folder) / f"{verb}-{kind}.laz")
                command = [*COMMANDS[verb], source, outputs[-1], "--memory", kinds[kind]]
                print(f"{verb}, {kind}: {timed([*command, '--n-jobs', options.processes])}")
            if len(outputs) == 2:
                print(f"{verb}: outputs are {'equal' if equal(*outputs) else 'DIFFERENT'}")


def write_street(path, n):
    """In a process of its own, whose memory is then free."""
    code = (
        "import sys, numpy as np\n"
        "from sklearn_mcmd.datasets import make_street\n"
        "from sklearn_mcmd.io import PointCloud, write_points\n"
        "xyz = make_street(int(sys.argv[2]), outlier_share=0.01, random_state=0).data\n"
        f"write_points(sys.argv[1], PointCloud(np.round(xyz + {ORIGIN}, 3)))\n"
    )
    subprocess.run([sys.executable, "-c", code, str(path), str(n)], check=True)


def timed(command):
    """Run mcmd; its summary in one line, and seconds."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "sklearn_mcmd", *map(str, command)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    wall = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    said = "; ".join(" ".join(line.split()) for line in done.stdout.splitlines()[1:])
    return f"{wall:.1f} s, {cpu:.1f} s of processors ({said})"


def equal(first, second):
    """Whether points and attributes of two files are the same."""
    from sklearn_mcmd.io import read_points

    a, b = read_points(first), read_points(second)
    names = set(a.attributes) | set(b.attributes)
    return np.array_equal(a.xyz, b.xyz) and all(
        np.array_equal(a.attributes[name], b.attributes[name], equal_nan=True) for name in names
    )


if __name__ == "__main__":
    main()
