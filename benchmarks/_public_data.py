"""Public benchmarks as their publishers lay them out, and the judged parts of each.

- roofs_ntnu: `roofs.npz` with xyz, building and plane; or the texts `scene_*.txt` that the
  publisher's evaluation wrote: x y z, what it said, and the truth. LidarRoofSegNet of HD0NG.
- pcpnet: the lists `testset_*.txt` and for each name in them `.xyz`, `.normals` and `.pidx`; or
  shapes as `.npz` with xyz and normals, to which the noise of the benchmark is added.
- wads: `sequences/*/velodyne/*.bin` and `labels/*.label` as SemanticKITTI has them; or frames as
  `.npz` with xyz, intensity and label.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

FALLING_SNOW = 110  # a label of WADS
KINDS = {  # of PCPNet: the list of each, and its noise as a share of the box's diagonal
    "no noise": ("testset_no_noise.txt", 0.0),
    "0.12 %": ("testset_low_noise.txt", 0.0012),
    "0.6 %": ("testset_med_noise.txt", 0.006),
    "1.2 %": ("testset_high_noise.txt", 0.012),
    "stripes": ("testset_vardensity_striped.txt", None),
    "gradient": ("testset_vardensity_gradient.txt", None),
}
N_JUDGED = 5000  # points of a shape


class Roof(NamedTuple):
    """Points (n, 3) and the face of each, -1 for none."""

    kind: str
    X: np.ndarray
    plane: np.ndarray


class Shape(NamedTuple):
    """Points and true unit normals (n, 3), and the rows that are judged."""

    kind: str
    X: np.ndarray
    normals: np.ndarray
    rows: np.ndarray


class Frame(NamedTuple):
    """Points (n, 3) with the sensor at the origin, intensities, and which are falling snow."""

    kind: str
    X: np.ndarray
    intensity: np.ndarray
    snow: np.ndarray


def roofs(folder):
    if (path := Path(folder, "roofs.npz")).is_file():
        with np.load(path) as arrays:
            X, plane, building = (arrays[name] for name in ("xyz", "plane", "building"))
        for number in np.unique(building):
            mine = building == number
            yield Roof("all", X[mine], plane[mine].astype(int))
    for path in sorted(Path(folder).glob("scene_*.txt")):
        table = np.loadtxt(path)
        yield Roof("all", table[:, :3], table[:, 4].astype(int))


def shapes(folder):
    for kind, (file, share) in KINDS.items():
        names = Path(folder, file).read_text().split() if Path(folder, file).is_file() else []
        for name in names:
            X, normals = (np.loadtxt(Path(folder, name + end)) for end in (".xyz", ".normals"))
            rows = np.loadtxt(Path(folder, name + ".pidx"), ndmin=1).astype(np.intp)
            yield Shape(kind, X, unit(normals), rows)
        for path in sorted(Path(folder).glob("*.npz")) if share is not None else []:
            yield noisy_shape(path, kind, share)


def unit(normals):
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0, lengths, 1)


def noisy_shape(path, kind, share):
    """A shape without noise, with the noise of a kind; the truth is that of the clean points."""
    rng = np.random.default_rng(0)
    with np.load(path) as arrays:
        X, normals = arrays["xyz"].astype(float), unit(arrays["normals"].astype(float))
        sure = np.flatnonzero(arrays["known"] if "known" in arrays else np.ones(len(X), bool))
    rows = rng.choice(sure, min(N_JUDGED, len(sure)), replace=False)
    deviation = share * np.linalg.norm(np.ptp(X, axis=0))
    return Shape(kind, X + rng.normal(0, deviation, X.shape), normals, rows)


def frames(folder):
    for path in sorted(Path(folder).glob("*.npz")):
        with np.load(path) as arrays:
            X, intensity, label = (arrays[name] for name in ("xyz", "intensity", "label"))
        yield Frame("all", X.astype(float), intensity.astype(float), label == FALLING_SNOW)
    for path in sorted(Path(folder).glob("**/velodyne/*.bin")):
        points = np.fromfile(path, dtype="<f4").reshape(-1, 4).astype(float)
        labels = path.parents[1] / "labels" / f"{path.stem}.label"
        label = np.fromfile(labels, dtype="<u4") & 0xFFFF  # above are numbers of things
        yield Frame("all", points[:, :3], points[:, 3], label == FALLING_SNOW)
