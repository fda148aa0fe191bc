"""Clouds whose regions `bench_segmentation.py peers` scores, and the scores, with truth or without.

Names are "row" or "row/part": tables show the mean over the parts of a row.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _region_planes import plane_scores

CAMERA = 1.425e-3  # noise of a depth camera at 1 m; it grows with the square of the range
# Noise of clouds in their units. Roofs: their planes' deviations are .03 to .11. Fragment: a third
# of the distance of Open3D's tutorial, which segments planes of such fragments. Facade: median
# deviation of planes of 30 neighbors. Street: between its road's (.006) and its facades' (.047).
NOISE = {
    "roof_planes": 0.07,
    "roofs_sparse": 0.07,
    "roofs_dense": 0.035,
    "mobile_street_labelled": 0.02,
    "open3d_redwood_fragment": 0.01 / 3,
    "pcl_building_region_growing": 3.0,
}
UNLABELED = {
    "office frame": "pcl_office1",
    "redwood fragment": "open3d_redwood_fragment",
    "building facade": "pcl_building_region_growing",
}
ROAD, FACADE, UNDETERMINED = 1203, 1400, 1100  # classes of the street; below the last they are none
N_TRIES = 500
N_JUDGES = 1000


class Cloud(NamedTuple):
    """Points, the surface of each (-1: unknown; or None), and their noise, one or one for each.

    A street also has a class for each point.
    """

    X: np.ndarray
    surface: np.ndarray | None
    noise: float | np.ndarray
    classes: np.ndarray | None = None


def loaders(data):
    """Name of each cloud -> function that makes or loads it."""
    return {**simulated(), **real(Path(data))}


def simulated():
    from simulators import ROOFS, make_bus_stop, make_traffic_furniture

    from sklearn_mcmd.datasets import make_crown_roof, make_street

    found = {
        f"simulated roofs/{kind} {n}": partial(simulated_roof, kind, n)
        for kind in ROOFS[:3]
        for n in (1000, 5000)
    }
    scenes = {
        "crown roof 3,000": (make_crown_roof, 3000, 0.002),
        "crown roof 20,000": (make_crown_roof, 20_000, 0.002),
        "street": (make_street, 40_000, 0.005),
        "furniture": (make_traffic_furniture, 40_000, 0.005),
        "bus stop": (make_bus_stop, 33_719, 0.005),
    }
    return found | {name: partial(scene, *how) for name, how in scenes.items()}


def simulated_roof(kind, n):
    """Creases of 20 degrees; noise of a fifth of the spacing."""
    from simulators import make_roof

    X, surface = make_roof(kind, n, 20, 0.2)
    return Cloud(X, surface, 0.2 * np.sqrt((6 if kind == "hip" else 4) / n))


def scene(make, n, noise):
    made = make(n, noise=noise, outlier_share=0.0, random_state=0)
    return Cloud(made.data, made.surface, noise)


def real(data):
    """Those of the folder, of the cubes each fifth point."""
    found = {}
    for path in sorted(data.glob("roof_planes/*.npz")):
        found[path.stem.replace("roof_", "airborne roof ")] = partial(labeled, path, "plane", 1)
    for name in ("sparse", "dense"):
        found |= buildings(name, data / f"roofs_{name}" / "roofs.npz")
    for path in sorted(data.glob("kinect_tables/*.npz")):
        found[path.stem.replace("scene_", "table ")] = partial(labeled, path, "label", 1)
    for name in ("angle_block", "featuretype", "plate_holes"):
        found[name.replace("_", " ")] = partial(labeled, data / f"cad_{name}/cloud.npz", "patch")
    cube = data / "cad_cube_pointfilter/cloud.npz"
    found["cube"] = partial(labeled, cube, "patch", step=5)
    noise = {"points": "xyz_noisy", "noise": 0.005}  # as its publisher tells
    found["noisy cube"] = partial(labeled, cube, "patch", step=5, **noise)
    found["mobile street"] = partial(street, data / "mobile_street_labelled" / "cloud.npz")
    for name, folder in UNLABELED.items():
        found[name] = partial(labeled, data / folder / "cloud.npz", None)
    return {name: load for name, load in found.items() if load.args[0].is_file()}


def buildings(name, path):
    """Each roof is a part of a row; those of one plane have a row of their own."""
    if not path.is_file():
        return {}
    with np.load(path) as arrays:
        building, plane = arrays["building"], arrays["plane"]
    found = {}
    for number in np.unique(building):
        planes = np.unique(plane[(building == number) & (plane >= 0)])
        row = f"{name} roofs{', one plane' * (len(planes) == 1)}/{number}"
        found[row] = partial(one_building, path, number)
    return found


def one_building(path, number):
    with np.load(path) as arrays:
        mine = arrays["building"] == number
        return Cloud(
            arrays["xyz"][mine], arrays["plane"][mine].astype(int), NOISE[path.parent.name]
        )


def street(path):
    """Road and facade are the known surfaces."""
    with np.load(path) as arrays:
        X, classes = arrays["xyz"], arrays["label"].astype(int)
    surface = np.select([classes == ROAD, classes == FACADE], [0, 1], -1)
    return Cloud(X, surface, NOISE[path.parent.name], classes)


def labeled(path, field, least=0, *, step=1, points="xyz", noise=0.0):
    with np.load(path) as arrays:
        X = arrays[points][::step].astype(np.float64)
        surface = None if field is None else arrays[field][::step].astype(int)
    if path.parent.name in ("kinect_tables", "pcl_office1"):
        noise = CAMERA * X[:, 2] ** 2
    else:
        noise = NOISE.get(path.parent.name, noise)
    if field == "label":
        surface = np.where(surface == 1, 1, -1)  # the table
    elif field is not None:
        surface = np.where(surface < least, -1, surface)
    return Cloud(X, surface, noise)


def scores(cloud, labels):
    """Number of regions, share of points in them, regions for 80 % of all points, and how good."""
    sizes = np.sort(np.bincount(labels[labels >= 0]))[::-1]
    covered = np.cumsum(sizes) >= 0.8 * len(labels)
    figures = {
        "regions": int((sizes > 0).sum()),
        "inside": float((labels >= 0).mean()),
        "for_80": int(covered.argmax()) + 1 if covered.any() else None,
    }
    if cloud.classes is not None:
        figures |= street_scores(cloud.classes, labels)
    if cloud.surface is not None:
        score = float(agreement(cloud.surface, labels))
        return {**figures, "score": score, **plane_scores(cloud.surface, labels)}
    return {
        **figures,
        "purity": purity(cloud.X, labels, 3 * cloud.noise),
        "purity_of_twice": purity(cloud.X, labels, 6 * cloud.noise),
    }


def street_scores(classes, labels):
    """Shares of the road in its largest region, of the facade in five; points of the main class."""
    found = labels >= 0
    road, facade = (
        np.sort(np.bincount(labels[found & (classes == one)])) for one in (ROAD, FACADE)
    )
    known = found & (classes >= UNDETERMINED)
    table = np.zeros((labels.max() + 1, classes.max() + 1), dtype=int)
    np.add.at(table, (labels[known], classes[known]), 1)
    return {
        "road": float(road[-1:].sum() / (classes == ROAD).sum()),
        "facade": float(facade[-5:].sum() / (classes == FACADE).sum()),
        "of_class": float(table.max(axis=1).sum() / max(known.sum(), 1)),
    }


def agreement(surface, labels):
    """Adjusted Rand index of the known points; of a table the IoU of its largest region."""
    from sklearn.metrics import adjusted_rand_score

    known = surface >= 0
    if len(np.unique(surface[known])) > 1:
        return adjusted_rand_score(surface[known], labels[known])
    inside = labels[known & (labels >= 0)]
    if not len(inside):
        return 0.0
    largest = labels == np.bincount(inside).argmax()
    return (largest & known).sum() / (largest | known).sum()


def purity(X, labels, tolerance):
    """Share of the points of regions that lie on the plane that most of their region lies on."""
    tolerance = np.broadcast_to(tolerance, len(X))
    rng, found = np.random.default_rng(0), labels >= 0
    rows = np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels + 1))[:-1])
    flat = sum(on_one_plane(X[region], tolerance[region], rng) for region in rows[1:])
    return float(flat / found.sum()) if found.any() else None


def on_one_plane(X, tolerance, rng):
    """How many points are within their tolerance of the plane with most of them."""
    n = len(X)
    if n <= 3:
        return n
    a, b, c = np.moveaxis(X[rng.integers(n, size=(N_TRIES, 3))], 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    if not length.any():
        return n  # they are on a line
    a, normals = a[length > 0], normals[length > 0] / length[length > 0, None]
    judges = rng.permutation(n)[:N_JUDGES]
    distances = X[judges] @ normals.T - np.einsum("nd,nd->n", a, normals)
    best = (np.abs(distances) <= tolerance[judges, None]).sum(axis=0).argmax()
    inside = np.abs((X - a[best]) @ normals[best]) <= tolerance
    most = inside.sum()
    for _ in range(5):  # fitted again, to what it holds
        center = X[inside].mean(axis=0)
        normal = np.linalg.svd(X[inside] - center, full_matrices=False)[2][-1]
        inside = np.abs((X - center) @ normal) <= tolerance
        if inside.sum() <= most:
            break
        most = inside.sum()
    return int(most)
