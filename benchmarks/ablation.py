"""What does each rule and each constant buy? Switched off and scaled, one at a time.

A part of the package (`growing`; others register theirs in `PARTS`) names its constants, its
rules, and the scenes and real clouds that they are tried on. Printed are the points of 100 that
each change gains on each scene, or loses (-), and how many regions real clouds have then.

    python benchmarks/ablation.py growing --size 20000 --seeds 2 --data ../shared/data

``--cache`` names a folder where prepared clouds (normals) are kept. A constant is replaced in
the module that reads it. A compiled kernel would not notice that of a constant that it imports:
kernels of a part that is tried here take theirs as arguments.
"""

import argparse
import importlib
import warnings
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FACTORS = (0.5, 0.8, 1.25, 2.0)


@dataclass(frozen=True)
class Constant:
    """A constant of a module, and the value that switches its rule off, if there is one."""

    module: str
    name: str
    off: float | None = None

    def variants(self):
        home = importlib.import_module(f"sklearn_mcmd.{self.module}")
        default = getattr(home, self.name)
        for factor in FACTORS:
            value = default * factor
            value = max(1, round(value)) if isinstance(default, int) else value
            yield f"x {factor:g}", lambda value=value: replaced(home, self.name, value), {}
        if self.off is not None:
            yield "off", lambda: replaced(home, self.name, self.off), {}

    def __str__(self):
        return f"{self.module.rpartition('.')[2]}.{self.name}"


@dataclass(frozen=True)
class Parameter:
    """A parameter of the estimator, with the values to try."""

    name: str
    values: tuple

    def variants(self):
        for value in self.values:
            yield f"{value}", nothing, {self.name: value}

    def __str__(self):
        return self.name


@dataclass(frozen=True)
class Part:
    """What is tried: constants and parameters, on clouds, by what measures.

    prepare : (X) -> what `run` takes; slow steps before the part, done once a cloud
    run : (prepared, **parameters) -> result
    measure : (scene, result) -> dict of numbers, 100 being perfect
    count : (result) -> number to print for real clouds
    """

    tried: tuple
    scenes: tuple
    clouds: tuple
    prepare: Callable
    run: Callable
    measure: Callable
    count: Callable


@contextmanager
def replaced(module, name, value):
    kept = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, kept)


@contextmanager
def nothing():
    yield


def columns_of(X):
    from sklearn_mcmd import RobustNormalEstimator

    return RobustNormalEstimator(random_state=0).fit_transform(X)


def regions_of(columns, **parameters):
    from sklearn_mcmd import RegionGrowing

    return RegionGrowing(normals="precomputed", **parameters).fit_predict(columns)


def region_scores(surface, labels):
    from sklearn_mcmd.metrics import segmentation_scores

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # undefined ratios are nan
        scores = segmentation_scores(surface, labels)
    return {"Rand": 100 * scores.adjusted_rand, "IoU": 100 * scores.mean_iou}


PARTS = {
    "growing": Part(
        tried=(
            Constant("segmentation._graph", "CUTOFF"),
            Constant("segmentation._graph", "USUAL", 0.0),
            Constant("segmentation._graph", "N_ERRORS", np.inf),
            Constant("segmentation._graph", "BENT", 0.0),
            Constant("segmentation._claims", "CUTOFF", np.inf),
            Constant("segmentation._joining", "MOST_NOISE", np.inf),
            Constant("segmentation._joining", "MOST_GAP", 1e9),
            Constant("segmentation._narrow_faces", "CUTOFF"),
            Constant("segmentation._narrow_faces", "MOST_NOISE", np.inf),
            Constant("segmentation._narrow_faces", "REACH", np.inf),
            Constant("segmentation._narrow_faces", "MAX_ROUNDS", 1),
            Constant("segmentation._cylinder_parts", "MOST_WIDE", np.inf),
            Constant("segmentation._cylinder_parts", "MOST_NOISE", np.inf),
            Constant("segmentation._cylinder_parts", "CUTOFF"),
            Constant("segmentation._cylinder_parts", "GROWTH"),
            Parameter("n_neighbors", (15, 24, 37, 60)),
            Parameter("max_angle", (7.5, 12, 18.75, 30)),
            Parameter("min_region_size", (1, 5, 8, 12, 20)),
            Parameter("mutual", (False,)),
            Parameter("regrow_rest", (False,)),
            Parameter("join_coplanar", (False,)),
            Parameter("join_curved", (False,)),
            Parameter("assign_rest", (False,)),
        ),
        scenes=("traffic_furniture", "bus_stop", "street", "box", "crown_roof"),
        clouds=("pcl_building_region_growing", "ahn3_amsterdam_2397", "open3d_redwood_fragment"),
        prepare=columns_of,
        run=regions_of,
        measure=region_scores,
        count=lambda labels: int(labels.max()) + 1,
    ),
}


def scenes_of(part, options):
    """Name, prepared cloud and truth of each scene."""
    from sklearn_mcmd import datasets

    for name in part.scenes:
        for seed in range(options.seeds):
            make = getattr(datasets, f"make_{name}")
            scene = make(options.size, outlier_share=0.0, random_state=seed)
            key = f"{options.part}_{name}_{options.size}_{seed}"
            yield name, kept(options.cache, key, part, scene.data), scene.surface


def clouds_of(part, options):
    """Name and prepared cloud of each real cloud that is there."""
    for name in part.clouds:
        path = Path(options.data) / name / "cloud.npz"
        if path.is_file():
            X = np.load(path)["xyz"].astype(np.float64)
            yield name, kept(options.cache, f"{options.part}_{name}", part, X)


def kept(folder, key, part, X):
    if folder is None:
        return part.prepare(X)
    path = Path(folder) / f"{key}.npy"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, part.prepare(X))
    return np.load(path)


def evaluate(part, scenes, clouds, parameters):
    """Means over the seeds, (measure, scene) -> number; and counts of real clouds."""
    found = {}
    for name, prepared, truth in scenes:
        for measure, value in part.measure(truth, part.run(prepared, **parameters)).items():
            found.setdefault((measure, name), []).append(value)
    counts = [part.count(part.run(prepared, **parameters)) for _, prepared in clouds]
    return {key: float(np.mean(values)) for key, values in found.items()}, counts


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=list(PARTS))
    parser.add_argument("--size", type=int, default=20_000, help="points of a scene")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--cache", help="folder for prepared clouds")
    parser.add_argument("--only", help="try only what has this in its name")
    options = parser.parse_args()
    part = PARTS[options.part]
    scenes, clouds = list(scenes_of(part, options)), list(clouds_of(part, options))
    default, counts = evaluate(part, scenes, clouds, {})
    names = list(part.scenes)
    for (measure, name), value in default.items():
        print(f"default: {name:20} {measure:6} {value:7.2f}")
    measures = list(dict.fromkeys(measure for measure, _ in default))
    print(f"\npoints gained (lost: -), by scene, for {' and '.join(measures)}")
    head = "".join(f"{name[:9]:>14}" for name in names)
    print(f"{'':40}{head}  " + "  ".join(name[:8] for name, _ in clouds))
    print(f"{'default':40}{'':{14 * len(names)}}  " + "  ".join(f"{c:8}" for c in counts))
    for tried in part.tried:
        if options.only and options.only not in str(tried):
            continue
        for label, context, parameters in tried.variants():
            with context():
                values, counts = evaluate(part, scenes, clouds, parameters)
            gained = [[values[m, name] - default[m, name] for m in measures] for name in names]
            row = "".join("".join(f"{g:7.2f}" for g in pair) for pair in gained)
            print(
                f"{tried!s:30}{label:10}{row}  " + "  ".join(f"{c:8}" for c in counts), flush=True
            )


if __name__ == "__main__":
    main()
