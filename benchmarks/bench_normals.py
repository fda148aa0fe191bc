"""How large are errors of normals near edges, away from edges and on curved surfaces?

The tables have mean, median and 95 % of the angle to the true normal in degrees, and the share
within 10 degrees. They compare least squares (as in Open3D, PCL and pgeof), the paper's form, the
default without borrowed planes, and the default. "Near" is within four spacings of an edge. "True
planes" knows the plane of every face and gives each point the nearest one. With noise, no method
can do better next to an edge.

"fillets" prints the RMSE on and near the round edges of boxes, beside that of a quadric fitted by
least squares.

"smoothing" prints whether rounds of bilateral smoothing of normals pay where noise is heavy.

"curvatures" prints the median error of the mean curvature, as a share of the larger principal one,
and the shares of points whose curvatures are within three standard errors.

"pcpnet" follows PCPNet's benchmark: 5,000 points of each shape, the root mean square of the angle
(RMSE), the share within 5, 10 and 20 degrees (PGP) and beyond 45. It takes a folder of NAME.xyz,
NAME.normals and, if there are any, NAME.pidx. Kinds of noise and density without a file are made.

    python benchmarks/bench_normals.py streets --seeds 3
    python benchmarks/bench_normals.py curved
    python benchmarks/bench_normals.py fillets
    python benchmarks/bench_normals.py smoothing ../shared/data/cad_*/cloud.npz
    python benchmarks/bench_normals.py curvatures --n-neighbors 30 50
    python benchmarks/bench_normals.py clouds ../shared/data/cad_*/cloud.npz --n-neighbors 30 50
    python benchmarks/bench_normals.py clouds ../shared/data/cad_a*/cloud.npz --noise 0.2
    python benchmarks/bench_normals.py pcpnet ../shared/data/pcpnet_bunny --csv angles.csv
"""

import argparse
import csv
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _normal_methods import Errors, errors, estimates, jet_normals, unoriented_angles
from _pcpnet import DENSITIES, BenchmarkError, benchmark_clouds, noise_kind

FORMS = {
    "least squares": {"method": "pca"},
    "paper (literal)": {"reweight": False},
    "own planes": {"neighbor_planes": False},
    "default": {},
    "auto": {"n_neighbors": "auto"},
}
NEAR = 4.0  # spacings


@dataclass
class Scene:
    name: str
    data: np.ndarray
    normals: np.ndarray
    regular: np.ndarray
    near: np.ndarray
    faces: np.ndarray = None  # points without noise, where faces are flat


def streets(options):
    from sklearn_mcmd.datasets import make_street

    for seed in range(options.seeds):
        street = make_street(options.size, outlier_share=options.share, random_state=seed)
        name = f"street {seed}, {options.size:,} points, {100 * options.share:g} % outliers"
        near = street.edge_distance < NEAR * street.spacing
        yield Scene(name, street.data, street.normals, street.target == 1, near, street.true_points)


def clouds(options):
    for path in options.clouds:
        with np.load(path) as arrays:
            X, normals = arrays["xyz"].astype(np.float64), arrays["normals"]
            distance = arrays["edge_dist"]
        spacing = typical_spacing(X)
        everyone = np.ones(len(X), dtype=bool)
        name = f"{Path(path).parent.name}, noise {options.noise:g} spacings"
        noise = np.random.default_rng(0).normal(0, options.noise * spacing, X.shape)
        yield Scene(name, X + noise, normals, everyone, distance < NEAR * spacing, X)


def curved(options):
    n = 5000
    for noise in (0.0, 0.005):
        for make in (ball, pipe, ring):
            rng = np.random.default_rng(0)
            X, normals = make(n, rng)
            X += rng.normal(0, noise, X.shape)
            everyone = np.ones(n, dtype=bool)
            yield Scene(f"{make.__name__}, noise {noise:g}", X, normals, everyone, ~everyone)


def fillets(options):
    """Print a row for each radius of the round edges of a box, noise and size of neighborhoods."""
    from scipy.spatial import cKDTree

    from sklearn_mcmd import RobustNormalEstimator

    spacing = np.sqrt(6 / options.size)
    print(f"{'RMSE within 4 spacings of a fillet':40}" + "".join(f"{n:>15}" for n in FORMS), end="")
    print(f"{'quadric':>15}")
    for radius in (3, 5, 10):
        for noise in (0.0, 0.1, 0.3, 0.5):
            rng = np.random.default_rng(0)
            X, normals, round_ = rounded_box(options.size, radius * spacing, rng)
            X += rng.normal(0, noise * spacing, X.shape)
            tree = cKDTree(X)
            near = cKDTree(X[round_]).query(X)[0] < NEAR * spacing
            for k in options.n_neighbors:
                row = ""
                for form in FORMS.values():
                    form = {"n_neighbors": k, **form}
                    estimator = RobustNormalEstimator(
                        random_state=0, n_jobs=options.threads, **form
                    )
                    angles = unoriented_angles(estimator.fit(X).normals_[near], normals[near])
                    row += f"{errors(angles).rmse:15.2f}"
                members = X[tree.query(X[near], k)[1]] - X[near][:, None]
                angles = unoriented_angles(jet_normals(members), normals[near])
                name = f"radius {radius}, noise {noise:g} spacings, k = {k}"
                print(f"{name:40}{row}{errors(angles).rmse:15.2f}", flush=True)


def smoothing(options):
    """Print a row for each machined part and noise: with 30 neighbors and "auto", as found and
    smoothed."""
    from sklearn_mcmd import RobustNormalEstimator

    print(f"{'near < 10 degrees / mean elsewhere':40}", end="")
    print("".join(f"{name:>20}" for k in (30, "auto") for name in (f"{k}", f"{k}, smoothed")))
    for noise in (0.5, 1.0, 2.4):
        options.noise = noise
        for scene in clouds(options):
            row = ""
            for k in (30, "auto"):
                estimator = RobustNormalEstimator(k, random_state=0, n_jobs=options.threads)
                found = estimator.fit(scene.data).normals_
                for normals in (found, smoothed(scene.data, found)):
                    angles = unoriented_angles(normals, scene.normals)
                    share = 100 * (angles[scene.near] < 10).mean()
                    row += f"{share:11.0f} % /{angles[~scene.near].mean():5.1f}"
            print(f"{scene.name:40}{row}", flush=True)


def smoothed(X, normals, n_neighbors=30, rounds=5, degrees=25.0):
    """Normals averaged with those around that lean by less than about an angle."""
    from scipy.spatial import cKDTree

    distances, near = cKDTree(X).query(X, n_neighbors)
    closeness = np.square(distances / (0.5 * distances[:, -1].mean()))
    for _ in range(rounds):
        around = normals[near]
        cosines = np.einsum("nkd,nd->nk", around, normals)
        angles = np.degrees(np.arccos(np.minimum(np.abs(cosines), 1.0)))
        weights = np.exp(-0.5 * (closeness + np.square(angles / degrees))) * np.sign(cosines)
        normals = np.einsum("nk,nkd->nd", weights, around)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals


def rounded_box(n, radius, rng):
    """A cube of side 1 with round edges and corners: points, normals, and which are round."""
    side = 1 - 2 * radius
    areas = np.array([6 * side**2, 6 * np.pi * radius * side, 4 * np.pi * radius**2])
    n_round = rng.choice(3, n, p=areas / areas.sum())  # how many axes a normal has, less one
    normals = rng.normal(size=(n, 3))
    axis = rng.integers(0, 3, n)
    for turn, kinds in ((1, (0, 1)), (2, (0,))):
        normals[np.arange(n), (axis + turn) % 3] *= ~np.isin(n_round, kinds)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inner = np.where(normals == 0, rng.uniform(-1, 1, (n, 3)), np.sign(normals)) * side / 2
    return inner + radius * normals, normals, n_round > 0


def curvatures(options):
    """Print a row for each shape, noise in spacings and size of neighborhoods."""
    from sklearn_mcmd import RobustNormalEstimator

    names = [f"{name}_curvature{end}" for end in ("", "_error") for name in ("mean", "max", "min")]
    columns = ("median error", "mean within 3", "larger", "smaller")
    print(f"{'':24}" + "".join(f"{column:>15}" for column in columns))
    for make, area in ((ball, 4 * np.pi), (pipe, 12 * np.pi), (ring, 1.2 * np.pi**2)):
        for noise in (0.0, 0.1, 0.3):
            rng = np.random.default_rng(0)
            X, normals = make(options.size, rng)
            most, least = true_curvatures(make, X)
            inside = np.abs(X[:, 2] - 3) < 2.5 if make is pipe else np.ones(len(X), dtype=bool)
            X = X + rng.normal(0, noise * np.sqrt(area / len(X)), X.shape)
            for n_neighbors in options.n_neighbors:
                estimator = RobustNormalEstimator(
                    n_neighbors, features=names, random_state=0, n_jobs=options.threads
                ).fit(X)
                inward = (np.einsum("nd,nd->n", estimator.normals_, normals) < 0)[:, None]
                found, errors = np.hsplit(estimator.features_, 2)
                found = np.where(inward, found, -found[:, [0, 2, 1]])
                errors = np.where(inward, errors, errors[:, [0, 2, 1]])
                gaps = np.abs(found - np.column_stack([(most + least) / 2, most, least]))[inside]
                within = 100 * (gaps <= 3 * errors[inside]).mean(axis=0)
                median = 100 * np.median(gaps[:, 0] / most[inside])
                row = f"{median:13.1f} %" + "".join(f"{share:13.1f} %" for share in within)
                print(f"{make.__name__}, {noise:g}, k = {n_neighbors:<8}{row}", flush=True)


def true_curvatures(make, X):
    """Principal curvatures from within; of the ring 1 / 0.3 and cos v / (1 + 0.3 cos v)."""
    if make is not ring:
        return np.ones(len(X)), np.full(len(X), 1.0 if make is ball else 0.0)
    center_distance = np.linalg.norm(X[:, :2], axis=1)
    return np.full(len(X), 1 / 0.3), (center_distance - 1) / 0.3 / center_distance


def ball(n, rng):
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals.copy(), normals


def pipe(n, rng):
    angle = rng.uniform(0, 2 * np.pi, n)
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    return normals + np.column_stack([np.zeros((n, 2)), rng.uniform(0, 6, n)]), normals


def ring(n, rng):
    u, v = rng.uniform(0, 2 * np.pi, (2, n))
    normals = np.column_stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    return 0.3 * normals + np.column_stack([np.cos(u), np.sin(u), np.zeros(n)]), normals


def typical_spacing(X):
    """Side of the square that one point takes."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(X).query(X[::17], k=20)
    return float(np.sqrt(np.median(np.pi * distances[:, -1] ** 2 / 20)))


def nearest_true_planes(scene, n_neighbors):
    """Normals of the true planes around that are nearest to each point."""
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(scene.regular)
    _, found = cKDTree(scene.data[rows]).query(scene.data, n_neighbors)
    found = rows[found]
    gaps = scene.data[:, None] - scene.faces[found]
    heights = np.abs(np.einsum("nkd,nkd->nk", gaps, scene.normals[found]))
    return scene.normals[found[np.arange(len(found)), heights.argmin(axis=1)]]


def compare(scene, n_neighbors, options):
    from sklearn_mcmd import RobustNormalEstimator

    parts = {"near edges": scene.regular & scene.near, "elsewhere": scene.regular & ~scene.near}
    print(f"\n{scene.name}, n_neighbors={n_neighbors}")
    title = "".join(f"{part:>38}" for part in parts)
    print(f"{'degrees':16}{title}")
    normals = {}
    for name, form in FORMS.items():
        form = {"n_neighbors": n_neighbors, **form}
        estimator = RobustNormalEstimator(random_state=0, n_jobs=options.threads, **form)
        normals[name] = estimator.fit(scene.data).normals_
    if scene.faces is not None:
        normals["true planes"] = nearest_true_planes(scene, n_neighbors)
    for name, found in normals.items():
        cosine = np.abs(np.einsum("nd,nd->n", found, scene.normals))
        angle = np.degrees(np.arccos(np.minimum(cosine, 1.0)))
        row = ""
        for part in parts.values():
            if part.any():
                a = angle[part]
                row += f"{a.mean():9.2f}{np.median(a):8.2f}{np.quantile(a, 0.95):9.1f}"
                row += f"{100 * (a < 10).mean():10.2f} %"
            else:
                row += f"{'-':>38}"
        print(f"{name:16}{row}", flush=True)


class Result(NamedTuple):
    """How one method does on one cloud: a line of the file that --csv names."""

    shape: str
    kind: str
    made: bool
    points: int
    judged: int
    method: str
    n_neighbors: int | None
    errors: Errors


def compare_scenes(options):
    for scene in options.make(options):
        for n_neighbors in options.n_neighbors:
            compare(scene, n_neighbors, options)


def compare_pcpnet(options):
    kinds = list(dict.fromkeys([*map(noise_kind, options.noise), *options.density]))
    names = None if options.list is None else Path(options.list).read_text().split()
    results = []
    for cloud in benchmark_clouds(options.folder, kinds, options.points, names):
        n, m = len(cloud.points), len(cloud.rows)
        origin = "made" if cloud.made else "as it is"
        print(f"{cloud.shape}, {cloud.kind} ({origin}): {m:,} of {n:,} points", flush=True)
        for found in estimates(cloud.points, cloud.normals, cloud.rows, options.threads):
            about = cloud.shape, cloud.kind, cloud.made, n, m
            results.append(Result(*about, found.method, found.n_neighbors, errors(found.angles)))
    if not results:
        raise BenchmarkError(
            f"{options.folder} has no cloud of these kinds, nor one without noise."
        )
    kinds = [kind for kind in kinds if any(result.kind == kind for result in results)]
    for kind in kinds:
        print_kind([result for result in results if result.kind == kind])
    print_averages(results, kinds)
    if options.csv is not None:
        write_results(results, options.csv)


def write_results(results, path):
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([*Result._fields[:-1], *Errors._fields])
        for result in results:
            table.writerow([*result[:-1], *(f"{value:.4f}" for value in result.errors)])


def print_kind(results):
    """All measures of each method, averaged over the shapes, and its numbers of neighbors."""
    print(f"\n{results[0].kind:27}     RMSE     PGP5    PGP10    PGP20      >45    k")
    for method, group in by_method(results).items():
        means = np.mean([result.errors for result in group], axis=0)
        sizes = sorted({result.n_neighbors for result in group if result.n_neighbors is not None})
        row = "".join(f"{mean:9.2f}" for mean in means)
        print(f"{method:27}{row}    {', '.join(map(str, sizes))}")


def print_averages(results, kinds):
    """RMSE of each method, averaged over the shapes, and over the kinds of clouds."""
    title = "".join(f"{kind:>10}" for kind in (*kinds, "average"))
    print(f"\n{'RMSE':27}{title}")
    for method, group in by_method(results).items():
        means = [
            np.mean([result.errors.rmse for result in group if result.kind == kind])
            for kind in kinds
        ]
        print(f"{method:27}" + "".join(f"{mean:10.2f}" for mean in (*means, np.mean(means))))


def by_method(results):
    groups = {}
    for result in results:
        groups.setdefault(result.method, []).append(result)
    return groups


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    for make in (streets, curved, clouds, fillets, smoothing, curvatures):
        part = kinds.add_parser(make.__name__)
        own = make in (fillets, smoothing, curvatures)
        part.set_defaults(run=make if own else compare_scenes, make=make)
        if make is not smoothing:
            part.add_argument("--n-neighbors", type=int, nargs="+", default=[50])
        part.add_argument("--threads", type=int, default=2)
        if make is streets:
            part.add_argument("--size", type=int, default=100_000)
            part.add_argument("--share", type=float, default=0.1)
            part.add_argument("--seeds", type=int, default=3)
        if make in (fillets, curvatures):
            size = 5000 if make is curvatures else 30_000
            part.add_argument("--size", type=int, default=size)
        if make in (clouds, smoothing):
            part.add_argument("clouds", nargs="+", help="npz files with xyz, normals, edge_dist")
        if make is clouds:
            part.add_argument("--noise", type=float, default=0.0, help="in spacings")
    part = kinds.add_parser("pcpnet")
    part.set_defaults(run=compare_pcpnet)
    part.add_argument("folder", help="folder of NAME.xyz and NAME.normals")
    part.add_argument("--points", type=count, default=5000, help="that are judged, per cloud")
    noise = {"type": percent, "nargs": "*", "default": [0, 0.12, 0.6, 1.2]}
    part.add_argument("--noise", **noise, help="in %% of the diagonal of the bounding box")
    part.add_argument("--density", nargs="*", choices=list(DENSITIES), default=list(DENSITIES))
    part.add_argument("--list", help="file of names to take, such as testset_all.txt")
    part.add_argument("--csv", help="file for the errors of each method on each cloud")
    part.add_argument("--threads", type=int, default=2)
    options = parser.parse_args(arguments)
    try:
        options.run(options)
    except (BenchmarkError, OSError) as error:
        parser.error(str(error))


def count(text):
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return number


def percent(text):
    number = float(text)
    if not 0 <= number < 100:
        raise argparse.ArgumentTypeError(f"{text} is no noise from 0 to 100")
    return number


if __name__ == "__main__":
    main()
