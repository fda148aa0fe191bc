"""What half and twice of a constant of plane tests, and of uLSIF, cost on simulated planes.

    python benchmarks/plane_constants.py

For each cloud and constant: change of the outliers found and of the good points kept, in points of
100. Planes are tested as by ``mcmd plane``: orthogonal surface, estimated sigma0, robust start.
"""

import argparse
from contextlib import contextmanager

import numpy as np

from sklearn_mcmd.adjustment import BaardaPlaneDetector
from sklearn_mcmd.adjustment._baarda import JoiningLimits
from sklearn_mcmd.adjustment._start import StartLimits
from sklearn_mcmd.baselines import Ulsif
from sklearn_mcmd.baselines._ulsif import RatioLimits
from sklearn_mcmd.datasets import make_contaminated_plane

N_PLANES = 20
PLANES = {  # points, share and size of the outliers in deviations, whether they are in a corner
    f"{n} points, {share:.0%} of {size} sigma{', in a corner' if corner else ''}": (n, *others)
    for n in (12, 100, 500)
    for share, size, corner in ((0.0, 0, False), (0.2, 6, False), (0.4, 15, False), (0.4, 15, True))
    for others in [(share, size, corner)]
}


def plane(n, share, size, corner, seed):
    """Points with noise of one along z, and which are outliers."""
    rng = np.random.default_rng(seed)
    X = np.column_stack([rng.uniform(0, 100, (n, 2)), rng.normal(size=n)])
    order = np.argsort(np.hypot(*X[:, :2].T)) if corner else np.arange(n)
    bad = np.isin(np.arange(n), order[: round(share * n)])
    X[bad, 2] += size
    return X, bad


def rates(flagged, bad):
    """Shares of outliers found and of good points kept, in percent."""
    flagged, bad = np.concatenate(flagged), np.concatenate(bad)
    found = flagged[bad].mean() if bad.any() else 1.0
    return 100 * np.array([found, 1 - flagged[~bad].mean()])


def of_planes():
    """The rates of each kind of plane."""
    detector = BaardaPlaneDetector(
        sigma0="auto", surface="orthogonal", robust_start=True, random_state=0
    )
    for name, kind in PLANES.items():
        clouds = [plane(*kind, seed) for seed in range(N_PLANES)]
        yield (
            name,
            rates([detector.fit_predict(X) == -1 for X, _ in clouds], [b for _, b in clouds]),
        )


def of_ratios():
    """The rates of uLSIF that flags as many points as there are outliers."""
    for share in (0.05, 0.2, 0.4):
        flagged, bad = [], []
        for seed in range(N_PLANES):
            X, y = make_contaminated_plane(100, outlier_share=share, random_state=seed)
            found = Ulsif(contamination=share).fit(X[None], random_state=0)
            flagged.append(~found.inliers[0])
            bad.append(y == -1)
        yield f"{share:.0%}", rates(flagged, bad)


@contextmanager
def changed(limits, **values):
    """Other limits for as long as this lasts."""
    before = limits.__new__.__defaults__
    limits.__new__.__defaults__ = tuple(limits()._replace(**values))
    try:
        yield
    finally:
        limits.__new__.__defaults__ = before


CHANGES = {  # half, twice and none
    (of_planes, StartLimits, "cut"): (1.25, 5.0, 1e9),
    (of_planes, StartLimits, "support_fraction"): (0.25, 0.95, None),
    (of_planes, JoiningLimits, "near"): (1.5, 6.0, 0.0),
    (of_planes, JoiningLimits, "portion"): (8, 32, 1),
    (of_ratios, RatioLimits, "training_fraction"): (0.25, 0.95, None),
    (of_ratios, RatioLimits, "n_starts"): (25, 100, 1),
    (of_ratios, RatioLimits, "max_basis"): (25, 100, 5),
}


def main():
    """Print the cloud that loses most, of each change."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for (measure, limits, name), values in CHANGES.items():
        before = dict(measure())
        print(measure.__name__, {cloud: rates.round(1).tolist() for cloud, rates in before.items()})
        for value in values:
            if value is None:
                continue
            with changed(limits, **{name: value}):
                changes = {cloud: rates - before[cloud] for cloud, rates in measure()}
            worst = [min(changes, key=lambda cloud, i=i: changes[cloud][i]) for i in (0, 1)]
            lost = " / ".join(f"{changes[cloud][i]:+.1f}" for i, cloud in enumerate(worst))
            print(f"{limits.__name__}.{name} = {value}: {lost}  on {worst}", flush=True)


if __name__ == "__main__":
    main()
