"""Real clouds, outliers put into them, and what a detector takes from and finds in them."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import rankdata
from sklearn.metrics import average_precision_score

N_SNOW_TURNS = 2  # of six that are alike
# Names of clouds that were taken from their origin begin like this.
FROM_ORIGIN = ("fast_gicp_velodyne", "kinect_tables", "pcl_office1", "snow_", "spinning_turns")
LAS_NOISE = 7
LAS_CLASSES = {
    1: "other",
    2: "ground",
    3: "vegetation",
    4: "vegetation",
    5: "vegetation",
    6: "building",
    LAS_NOISE: "noise",
    64: "hanging things",
}
# Labels by hand of turns of lidars, and of a street from a vehicle.
NAMES = {1: "outlier", 10: "car", 13: "vehicle", 18: "truck", 40: "road", 44: "parking"}
NAMES |= {48: "sidewalk", 49: "ground", 50: "building", 51: "fence", 70: "vegetation", 71: "trunk"}
NAMES |= {72: "terrain", 80: "pole", 81: "sign", 110: "flake", 111: "lying snow"}
NAMES |= {1101: "wires", 1102: "single wire", 1103: "utility pole", 1104: "crossarm"}
NAMES |= {1107: "lamp support", 1110: "post", 1111: "sign", 1114: "lamp", 1115: "traffic light"}
NAMES |= {1116: "traffic light support", 1200: "ground", 1203: "road", 1300: "foliage"}
NAMES |= {1302: "small trunk", 1400: "facade", 1401: "wall", 1410: "ceiling", 1501: "vehicle"}
N_SPACING = 8  # neighbors whose mean distance is the spacing
OUT_OF_REACH = 3.0  # spacings: nobody can tell an outlier that is nearer to a real point
# Points spread evenly in a ball of this many spacings times the cube root of their number have
# a mean distance of one spacing to their 8 nearest (within 5 %, for 20 to 60 points, measured).
BALL_RADIUS = 0.565
MAX_ROUNDS = 1_000


class RealCloud(NamedTuple):
    """A real cloud, or one sampled on a known shape.

    name : folder, or folder/file where a folder holds several clouds
    points : float64 (n, 3)
    classes : str (n,), the publishers' classes, or None
    noise : bool (n,), points that the publishers call noise, or None
    intensity : float (n,), or None
    from_origin : whether all points were taken from the origin
    """

    name: str
    points: np.ndarray
    classes: np.ndarray | None
    noise: np.ndarray | None
    intensity: np.ndarray | None = None
    from_origin: bool = False


def spacing_of(X):
    """Side of the square that a point has for itself."""
    distances, _ = cKDTree(X).query(X[::17], k=20)
    return float(np.sqrt(np.median(np.pi * distances[:, -1] ** 2 / 20)))


def load_clouds(data, names=None, limit=None, seed=0):
    """Yield each cloud of a folder with ``*/*.npz``, or those named, cropped to `limit` points.

    A name is a folder, or folder/file; `seed` is of the center of a crop.
    """
    paths = cloud_paths(data)
    if names is not None:
        unknown = [n for n in names if not any(n in (c, c.split("/")[0]) for c in paths)]
        if unknown:
            raise ValueError(f"no cloud is named {unknown[0]!r}; there are {', '.join(paths)}")
    for name, path in paths.items():
        if names is None or name in names or name.split("/")[0] in names:
            yield cropped(read_cloud(name, path), limit, seed)


def cloud_paths(data):
    """Name and path of each cloud of the folder."""
    paths = {}
    for folder in sorted(p for p in Path(data).iterdir() if p.is_dir()):
        files = sorted(folder.glob("*.npz"))
        if folder.name == "snow_spinning_lidar":
            files = files[:N_SNOW_TURNS]
        for path in files:
            name = folder.name if path.stem == "cloud" else f"{folder.name}/{path.stem}"
            paths[name] = path
    if not paths:
        raise FileNotFoundError(f"no cloud (*/*.npz) in {data}")
    return paths


def read_cloud(name, path):
    """The cloud of a file, with its classes and noise under common names."""
    with np.load(path) as arrays:
        points = arrays["xyz"].astype(np.float64)
        classes = noise = None
        intensity = arrays["intensity"].astype(float) if "intensity" in arrays else None
        if "classification" in arrays:
            codes = arrays["classification"]
            named = (LAS_CLASSES.get(code, f"class {code}") for code in codes.tolist())
            classes = np.array([*named])
            noise = codes == LAS_NOISE
        elif "label" in arrays and not name.startswith("kinect"):
            codes = arrays["label"]
            classes = np.array([NAMES.get(code, f"label {code}") for code in codes.tolist()])
            noise = arrays.get("snow", codes == 1)
        elif "label_ground" in arrays:
            classes = np.where(arrays["label_ground"] == 1, "ground", "other")
            noise = arrays["low_outlier_hint"] == 1
        elif "snow" in arrays:
            noise = arrays["snow"]
        elif "normals" in arrays:
            classes = np.full(len(points), "surface")
    if noise is not None and not noise.any():
        noise = None
    return RealCloud(
        name, points, classes, noise, intensity, from_origin=name.startswith(FROM_ORIGIN)
    )


def cropped(cloud, limit, seed):
    """The `limit` points nearest to a random point: thinning would change the spacing."""
    if limit is None or limit >= len(cloud.points):
        return cloud
    center = np.random.default_rng(seed).choice(cloud.points)
    squares = np.square(cloud.points - center).sum(axis=1)
    rows = np.sort(np.argpartition(squares, limit - 1)[:limit])
    return cloud._replace(
        **{k: v[rows] for k, v in cloud._asdict().items() if isinstance(v, np.ndarray)}
    )


class Spacing:
    """How far points of a cloud lie from their neighbors, place by place.

    The spacing of a point is its mean distance to the 8 nearest other points; at a place it is
    the median over the 8 points nearest to it. Copies of a point count once.
    """

    def __init__(self, points):
        self.points = np.unique(points, axis=0)
        self.tree = cKDTree(self.points)
        distances, neighbors = self.tree.query(self.points, N_SPACING + 1, workers=-1)
        self.of_points = np.median(distances[:, 1:].mean(axis=1)[neighbors[:, 1:]], axis=1)

    def at(self, places):
        """Spacing of the cloud at each place."""
        _, near = self.tree.query(places, N_SPACING, workers=-1)
        return np.median(self.of_points[near], axis=1)

    def is_free(self, places, radius=0.0):
        """Whether a ball at each place stays 3 spacings away from all real points."""
        distances, near = self.tree.query(places, N_SPACING, workers=-1)
        reach = np.reshape(radius, (-1, 1)) + OUT_OF_REACH * self.of_points[near]
        return (distances > reach).all(axis=1)


def inject(points, rng):
    """Put outliers with known truth into a cloud.

    - "uniform", 5 % of n: anywhere in the bounding box, which is enlarged on each side by 5 % of
      its longest side;
    - "group", 2 % of n: balls of 20 to 60 points in that box, as dense as the cloud near there;
    - "near", 3 % of n: 5 to 20 spacings off a real point, in a random direction.

    What comes nearer to a real point than 3 spacings is drawn again. Returns the points, the real
    ones first, and the kind of each: "real", "uniform", "group" or "near".
    """
    n, spacing = len(points), Spacing(points)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * (high - low).max()

    def in_box(count):
        return rng.uniform(low - margin, high + margin, (count, 3))

    def beside_points(count):
        rows = rng.integers(len(spacing.points), size=count)
        distance = rng.uniform(5, 20, count) * spacing.of_points[rows]
        return spacing.points[rows] + distance[:, None] * random_directions(count, rng)

    uniform = drawn(in_box, spacing.is_free, round(0.05 * n))
    near = drawn(beside_points, spacing.is_free, round(0.03 * n))
    group = draw_groups(in_box, spacing, round(0.02 * n), rng)
    parts = {"real": points, "uniform": uniform, "group": group, "near": near}
    kind = np.repeat(list(parts), [len(part) for part in parts.values()])
    return np.vstack(list(parts.values())), kind


def draw_groups(in_box, spacing, count, rng):
    """Balls of 20 to 60 points, together about `count`, at least one."""
    sizes = rng.integers(20, 61, count // 20 + 1)
    sizes = sizes[: max(1, np.searchsorted(np.cumsum(sizes), count, side="right"))]
    growth = BALL_RADIUS * np.cbrt(sizes.max())  # room for the largest

    centers = drawn(
        in_box,
        lambda places: spacing.is_free(places, growth * spacing.at(places)),
        len(sizes),
    )
    radius = BALL_RADIUS * np.cbrt(sizes) * spacing.at(centers)
    total = sizes.sum()
    steps = np.cbrt(rng.random(total))[:, None] * random_directions(total, rng)
    return np.repeat(centers, sizes, axis=0) + np.repeat(radius, sizes)[:, None] * steps


def drawn(draw, accept, count):
    """As many random points as asked for that are accepted."""
    places = draw(count)
    wrong = np.flatnonzero(~accept(places))
    for _ in range(MAX_ROUNDS):
        if not len(wrong):
            return places
        places[wrong] = draw(len(wrong))
        wrong = wrong[~accept(places[wrong])]
    raise ValueError(f"{len(wrong)} of {count} outliers find no room in the cloud")


def random_directions(count, rng):
    directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def evaluate(labels, outlyingness, kind, classes=None):
    """What a detector takes from and finds in a cloud, in percent by (measure, subset).

    Labels of -1 are flagged, outlyingness is high for outliers, and `kind` is "real" or a kind of
    outliers. "flagged" is the share of real points, of all and by class. If there are outliers,
    "TPR" and "average precision" follow.
    """
    real, flagged = np.asarray(kind) == "real", np.asarray(labels) == -1
    percent = {("flagged", "all"): flagged[real].mean()}
    if classes is not None:
        for name in np.unique(classes[real]):
            percent["flagged", str(name)] = flagged[real & (classes == name)].mean()
    if not real.all():
        percent["TPR", "all"] = flagged[~real].mean()
        order = rankdata(outlyingness, method="dense")
        percent["average precision", "all"] = average_precision_score(~real, order)
    return {key: 100 * float(value) for key, value in percent.items()}
