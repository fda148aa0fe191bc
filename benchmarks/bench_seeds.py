"""How many flags and normals does another seed change?

Clouds of a folder are cropped, the first of each data set. Flags are those of either seed, in
percent; normals count if they turn by more than 5 degrees. Means are of the clouds with 50 flags
or more, and of all for normals.

    python benchmarks/bench_seeds.py --data ../shared/data
"""

import argparse

import numpy as np
from _real_clouds import cloud_paths, cropped, read_cloud
from _tables import print_table

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator

FEWEST_FLAGS = 50
TURNED = np.cos(np.radians(5))
FIRST_SEED = 7101


def changes(points, pairs):
    """Flags on average, and means of the shares of flags and normals that change, in percent."""
    seen = []
    for pair in pairs:
        flags = [MCMDOutlierDetector(random_state=s).fit_predict(points) == -1 for s in pair]
        normals = [RobustNormalEstimator(random_state=s).fit(points).normals_ for s in pair]
        either = max((flags[0] | flags[1]).sum(), 1)
        cosines = np.abs(np.einsum("nd,nd->n", *normals))
        changed = 100 * (flags[0] != flags[1]).sum() / either
        seen.append((np.sum(flags) / 2, changed, 100 * (cosines < TURNED).mean()))
    return np.mean(seen, axis=0)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--clouds", nargs="+", help="names of folders; all by default")
    parser.add_argument("--most", type=int, default=15_000, help="points of a cloud")
    parser.add_argument("--pairs", type=int, default=3, help="pairs of seeds")
    options = parser.parse_args(arguments)
    pairs = [(FIRST_SEED + 2 * i, FIRST_SEED + 2 * i + 1) for i in range(options.pairs)]
    found = {}
    for name, path in cloud_paths(options.data).items():
        home = name.split("/")[0]
        if home not in found and home in (options.clouds or [home]):
            cloud = cropped(read_cloud(name, path), options.most, 0)
            found[home] = changes(cloud.points, pairs)
    rows = [(name, *map(float, values)) for name, values in found.items()]
    print_table("", ("cloud", "flags", "flags changed", "normals turned"), rows)
    values = np.array(list(found.values()))
    for name, column in (
        ("flags", values[values[:, 0] >= FEWEST_FLAGS, 1]),
        ("normals", values[:, 2]),
    ):
        if len(column):
            mean, worst = column.mean(), column.max()
            print(f"{name}: mean {mean:.1f}, worst {worst:.1f} of {len(column)} clouds")


if __name__ == "__main__":
    main()
