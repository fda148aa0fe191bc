"""The clouds with a truth that `ablation.py` measures on: simulated and real.

Each function takes the program's options, and yields name or "name/part", points and truth.
"""

import zlib
from pathlib import Path

import numpy as np
from _real_clouds import inject, load_clouds
from simulators import make_bus_stop, make_traffic_furniture

REAL = {  # and most points
    "isprs_samp31": None,
    "ahn3_amsterdam_2397": None,
    "ign_village": 60_000,
    "pcl_cars_mincut": None,
    "jakarto_scanlines": None,
    "fast_gicp_velodyne": None,
    "pcl_office1": 60_000,
}


def simulated(options, truth, outlier_share):
    from sklearn_mcmd.datasets import make_box, make_crown_roof, make_street

    makers = make_traffic_furniture, make_bus_stop, make_street, make_box, make_crown_roof
    for make in makers:
        name = make.__name__.removeprefix("make_")
        for seed in range(options.seeds):
            scene = make(options.size, outlier_share=outlier_share, random_state=seed)
            yield name, scene.data, truth(scene)


def labelled(options):
    """Real clouds, of 20,000 points at most, and the surface of each point, -1 for unknown."""
    for path in sorted(Path(options.data).glob("*/*.npz")):
        home = path.parent.name
        field = {"cad": "patch", "roof": "plane", "kinect": "label"}.get(home.partition("_")[0])
        if field is None:
            continue
        with np.load(path) as arrays:
            X, surface = arrays["xyz"].astype(np.float64), arrays[field].astype(int)
        rows = np.sort(np.random.default_rng(0).permutation(len(X))[:20_000])
        has_surface = {"patch": surface >= 0, "plane": surface > 0, "label": surface == 1}[field]
        name = home.removeprefix("cad_")
        yield f"{name}/{path.stem}", X[rows], np.where(has_surface, surface, -1)[rows]


def machined_parts(options):
    for name in ("cad_angle_block", "cad_featuretype", "cad_plate_holes"):
        path = Path(options.data) / name / "cloud.npz"
        if path.is_file():
            with np.load(path) as arrays:
                X, normals = arrays["xyz"].astype(np.float64), arrays["normals"]
                near = arrays["edge_dist"] < 4 * spacing_of(X)
            yield name, X, (normals, near, np.ones(len(X), dtype=bool))


def edge_distances(scene):
    """Distance to the edge, not a number for outliers, and the spacing."""
    return scene.edge_distance, scene.spacing


def machined_edges(options):
    """Parts as they are, and with 20 % of displaced points."""
    from bench_edges import of_file

    for path in sorted(Path(options.data).glob("cad_*/cloud.npz")):
        for share in (0.0, 0.2):
            X, *truth = of_file(path, share)
            yield path.parent.name.removeprefix("cad_"), X, truth


def ridges(options):
    """Roofs whose planes are told by hand, and simulated ones."""
    from bench_edges import of_file, simulated_roofs

    for path in sorted(Path(options.data).glob("roof_planes/*.npz")):
        X, *truth = of_file(path)
        yield "roofs", X, truth
    for X, *truth in simulated_roofs():
        yield "simulated roofs", X, truth


def shapes(options):
    """A hand and a vase, clean and with two levels of noise."""
    for path in sorted(Path(options.data).glob("dipole_shapes/*.npz")):
        with np.load(path) as arrays:
            X, normals = (arrays[name].astype(np.float64) for name in ("xyz", "normals"))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        diagonal, everyone = np.linalg.norm(np.ptp(X, axis=0)), np.ones(len(X), dtype=bool)
        for kind, noise in (("none", 0.0), ("0.12 %", 0.0012), ("0.6 %", 0.006)):
            rng = np.random.default_rng([zlib.crc32(name.encode()) for name in (path.stem, kind)])
            points = X + rng.normal(0, noise * diagonal, X.shape)
            yield f"{path.stem} {kind}", points, (normals, everyone, everyone)


def spacing_of(X):
    """Side of the square that a point has for itself."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(X).query(X[::17], k=20)
    return float(np.sqrt(np.median(np.pi * distances[:, -1] ** 2 / 20)))


def streets(options):
    """With 10 and 20 % of outliers; True for these."""
    from sklearn_mcmd.datasets import make_street

    for n in (100_000, 20_000, 400):  # the last for what is only for small clouds
        for share in (0.1, 0.2):
            for seed in range(options.seeds):
                street = make_street(n, outlier_share=share, random_state=seed)
                yield f"{n} {share:.0%}", street.data, street.target == -1


def true_normals(scene):
    """Normals, which points are within four spacings of an edge, and which are regular."""
    return scene.normals, scene.edge_distance < 4 * scene.spacing, scene.outlier_kind == 0


def contaminated(options):
    """Real clouds, without the noise that is known, with outliers put in; True for these."""
    for name, most in REAL.items():
        for cloud in load_clouds(options.data, [name], most):
            points = cloud.points if cloud.noise is None else cloud.points[~cloud.noise]
            points, kind = inject(points, np.random.default_rng(0))
            yield name, points, kind != "real"


def seen(options):
    """Streets with trees, and real turns; points, then the sensor's position. True for outliers."""
    from sklearn_mcmd.datasets import make_street

    for share in (0.1, 0.2):
        for seed in range(options.seeds):
            street = make_street(
                sampling="scan_lines", tree=True, outlier_share=share, random_state=seed
            )
            X = np.hstack(
                [street.data, np.broadcast_to(street.sensor_origins[0], street.data.shape)]
            )
            yield f"street {share:.0%}", X, street.target == -1
    for name in ("snow_spinning_lidar", "fast_gicp_velodyne"):
        for cloud in load_clouds(options.data, [name]):
            outlier = np.zeros(len(cloud.points), bool) if cloud.noise is None else cloud.noise
            yield cloud.name, np.hstack([cloud.points, 0 * cloud.points]), outlier
