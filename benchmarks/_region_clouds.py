"""Clouds whose regions `bench_segmentation.py peers` scores, and the scores.

Names are "row" or "row/part": tables show the mean over the parts of a row.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _region_planes import plane_scores

CAMERA = 1.425e-3  # noise of a depth camera at 1 m; it grows with the square of the range
# Noise of clouds in their units. Roofs: their planes' deviations are .03 to .11. Street: between
# its road's (.006) and its facades' (.047).
NOISE = {
    "roof_planes": 0.07,
    "roofs_sparse": 0.07,
    "roofs_dense": 0.035,
    "mobile_street_labelled": 0.02,
}
ROAD, FACADE, UNDETERMINED = 1203, 1400, 1100  # classes of the street; below the last they are none


class Cloud(NamedTuple):
    """Points, the surface of each (-1: unknown), and their noise, one or one for each.

    A street also has a class for each point.
    """

    X: np.ndarray
    surface: np.ndarray
    noise: float | np.ndarray
    classes: np.ndarray | None = None


def loaders(data):
    """Name of each cloud -> function that makes or loads it."""
    return {**simulated(), **real(Path(data))}


def simulated():
    from simulators import ROOFS, make_bus_stop, make_traffic_furniture

    from sklearn_mcmd.datasets import make_crown_roof, make_street

    by_name = {
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
    return by_name | {name: partial(scene, *how) for name, how in scenes.items()}


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
    by_name = {}
    for path in sorted(data.glob("roof_planes/*.npz")):
        by_name[path.stem.replace("roof_", "airborne roof ")] = partial(labeled, path, "plane", 1)
    for name in ("sparse", "dense"):
        by_name |= buildings(name, data / f"roofs_{name}" / "roofs.npz")
    for path in sorted(data.glob("kinect_tables/*.npz")):
        by_name[path.stem.replace("scene_", "table ")] = partial(labeled, path, "label", 1)
    for name in ("angle_block", "featuretype", "plate_holes"):
        by_name[name.replace("_", " ")] = partial(labeled, data / f"cad_{name}/cloud.npz", "patch")
    cube = data / "cad_cube_pointfilter/cloud.npz"
    by_name["cube"] = partial(labeled, cube, "patch", step=5)
    noise = {"points": "xyz_noisy", "noise": 0.005}  # as its publisher tells
    by_name["noisy cube"] = partial(labeled, cube, "patch", step=5, **noise)
    by_name["mobile street"] = partial(street, data / "mobile_street_labelled" / "cloud.npz")
    return {name: load for name, load in by_name.items() if load.args[0].is_file()}


def buildings(name, path):
    """Each roof is a part of a row; those of one plane have a row of their own."""
    if not path.is_file():
        return {}
    with np.load(path) as arrays:
        building, plane = arrays["building"], arrays["plane"]
    by_name = {}
    for number in np.unique(building):
        planes = np.unique(plane[(building == number) & (plane >= 0)])
        row = f"{name} roofs{', one plane' * (len(planes) == 1)}/{number}"
        by_name[row] = partial(one_building, path, number)
    return by_name


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
        surface = arrays[field][::step].astype(int)
    if path.parent.name == "kinect_tables":
        noise = CAMERA * X[:, 2] ** 2
    else:
        noise = NOISE.get(path.parent.name, noise)
    if field == "label":
        surface = np.where(surface == 1, 1, -1)  # the table
    else:
        surface = np.where(surface < least, -1, surface)
    return Cloud(X, surface, noise)


def scores(cloud, labels):
    """Number of regions, share of points in them, and how good they are."""
    figures = {
        "regions": len(np.unique(labels[labels >= 0])),
        "inside": float((labels >= 0).mean()),
        "score": float(agreement(cloud.surface, labels)),
        **plane_scores(cloud.surface, labels),
    }
    if cloud.classes is not None:
        figures |= street_scores(cloud.classes, labels)
    return figures


def street_scores(classes, labels):
    """Shares of the road in its largest region, of the facade in five; points of the main class."""
    inside = labels >= 0
    road, facade = (
        np.sort(np.bincount(labels[inside & (classes == one)])) for one in (ROAD, FACADE)
    )
    judged = inside & (classes >= UNDETERMINED)
    table = np.zeros((labels.max() + 1, classes.max() + 1), dtype=int)
    np.add.at(table, (labels[judged], classes[judged]), 1)
    return {
        "road": float(road[-1:].sum() / (classes == ROAD).sum()),
        "facade": float(facade[-5:].sum() / (classes == FACADE).sum()),
        "of_class": float(table.max(axis=1).sum() / max(judged.sum(), 1)),
    }


def agreement(surface, labels):
    """Adjusted Rand index of the known points; of a table the IoU of its largest region."""
    from sklearn.metrics import adjusted_rand_score

    known_points = surface >= 0
    if len(np.unique(surface[known_points])) > 1:
        return adjusted_rand_score(surface[known_points], labels[known_points])
    inside = labels[known_points & (labels >= 0)]
    if not len(inside):
        return 0.0
    largest = labels == np.bincount(inside).argmax()
    return (largest & known_points).sum() / (largest | known_points).sum()
