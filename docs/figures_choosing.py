"""The pictures and numbers of choosing.rst.

python docs/figures_choosing.py [NAME ...]
"""

import io
import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_box, make_contaminated_plane, make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.plotting import normal_colors, plot_cloud

IMAGES = Path(__file__).parent / "images"
BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"


def save(figure, name, colors=96):
    """A small PNG: few colors, rare ones among them, no more pixels than a page shows."""
    picture = io.BytesIO()
    figure.savefig(picture, dpi=76, facecolor="white")
    path = IMAGES / f"{name}.png"
    image = Image.open(picture).convert("RGB")
    image.quantize(colors, method=Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")
    plt.close(figure)


def neighborhoods():
    """What 10, 50 and 300 neighbors of one point beside a kerb are."""
    street = make_street(60_000, outlier_share=0.0, random_state=0)
    xyz, spacing = street.data, street.spacing
    kerb = street.surface_names.index("kerb")
    on_kerb = np.where(street.surface == kerb, 0.0, np.inf)
    point = np.argmin(np.linalg.norm(xyz - [2.5, 3.0, 0.07], axis=1) + on_kerb)
    order = np.argsort(np.linalg.norm(xyz - xyz[point], axis=1))
    near = np.abs(xyz - xyz[point])[:, :2].max(axis=1) < 0.4
    near &= xyz[:, 2] < 0.5
    view = (-75, 35)
    pale = 0.5 + 0.5 * normal_colors(street.normals[near], view=view)
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.4), layout="constrained")
    for ax, k in zip(axes, (10, 50, 300), strict=True):
        chosen = np.zeros(len(xyz), dtype=bool)
        chosen[order[:k]] = True
        color = np.where(chosen[near, None], matplotlib.colors.to_rgb(RED), pale)
        plot_cloud(xyz[near], color=color, view=view, ax=ax)
        reach = np.linalg.norm(xyz[order[k - 1]] - xyz[point])
        share = np.mean(street.surface[order[:k]] == kerb)
        ax.set_title(f"{k} neighbors: {200 * reach:.0f} cm across", fontsize=12)
        print(f"k = {k}: {2 * reach / spacing:.1f} spacings, {100 * share:.0f} % on the kerb")
    save(figure, "choosing_neighborhoods")


def normals():
    """Mean angle to the true normal by k and noise, beside edges and elsewhere."""
    sizes = [8, 12, 16, 25, 35, 50, 70, 100, 150, 200, 300]
    figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True, layout="constrained")
    spacing = make_box(8000, random_state=0).spacing
    shades = plt.get_cmap("viridis")
    print(f"{'noise':<8}{'elsewhere: k for 2.5 degrees':<32}{'best k beside edges':<24}")
    for i, noise in enumerate((0.1, 0.2, 0.4, 0.8)):
        box = make_box(8000, noise=noise * spacing, random_state=0)
        near = box.edge_distance < 4 * spacing
        errors = np.empty((len(sizes), 2))
        for j, k in enumerate(sizes):
            found = RobustNormalEstimator(k, random_state=0).fit(box.data).normals_
            angle = bias_angle(found, box.normals)
            errors[j] = angle[near].mean(), angle[~near].mean()
        auto = RobustNormalEstimator("auto", random_state=0).fit(box.data)
        angle = bias_angle(auto.normals_, box.normals)
        color = shades(i / 3.5)
        for ax, column, rows in ((axes[0], 1, ~near), (axes[1], 0, near)):
            ax.plot(sizes, errors[:, column], "o-", ms=4, color=color, label=f"noise {noise:g}")
            place = np.median(auto.n_neighbors_[rows]), angle[rows].mean()
            ax.plot(*place, "*", ms=14, color=color, mec="k", mew=0.5)
        enough = [k for k, e in zip(sizes, errors[:, 1], strict=True) if e <= 2.5]
        best = sizes[errors[:, 0].argmin()]
        print(f"{noise:<8g}{enough[0] if enough else '-':<32}{best:<24}")
    for ax, title in zip(axes, ("on faces", "within 4 spacings of an edge"), strict=True):
        ax.set(xscale="log", yscale="log", xlabel="neighbors", title=title)
        ax.set_xticks([8, 16, 25, 50, 100, 200, 300], [8, 16, 25, 50, 100, 200, 300])
        ax.set_yticks([0.5, 1, 2.5, 5, 10, 20, 40], [0.5, 1, 2.5, 5, 10, 20, 40])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("mean angle to the true normal (degrees)")
    axes[0].legend(title="in spacings")
    save(figure, "choosing_normals")


def widths():
    """The share of a kerb's normals that are right, by k as a share of the rule's limit."""
    shares = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
    print(f"{'spacing':<10}{'limit':<8}" + "".join(f"{share:>8g}" for share in shares))
    for n_points in (15_000, 40_000, 90_000):
        street = make_street(n_points, outlier_share=0.0, noise=0.003, random_state=0)
        kerb = street.surface == street.surface_names.index("kerb")
        limit = (2 * 0.13 / street.spacing) ** 2
        cells = []
        for share in shares:
            k = max(8, int(share * limit))
            found = RobustNormalEstimator(k, random_state=0).fit(street.data).normals_
            angle = bias_angle(found[kerb], street.normals[kerb])
            cells.append(f"{100 * np.mean(angle < 10):8.0f}")
        print(f"{street.spacing:<10.3f}{limit:<8.0f}" + "".join(cells))


def outliers():
    """Outliers found and real points lost, by k."""
    sys.path.append(str(Path(__file__).resolve().parents[1]))
    from benchmarks.simulators import make_mobile_scan

    scans = {
        "street of even density": make_street(40_000, outlier_share=0.05, random_state=0),
        "street, from a vehicle": make_mobile_scan(40_000, random_state=0),
    }
    sizes = [10, 15, 20, 30, 50, 80, 120, 200]
    figure, axes = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained")
    for color, (name, scan) in zip((BLUE, ORANGE), scans.items(), strict=True):
        wrong = scan.target == -1
        shares = np.empty((len(sizes), 2))
        for i, k in enumerate(sizes):
            flagged = MCMDOutlierDetector(k, random_state=0).fit_predict(scan.data) == -1
            shares[i] = 100 * flagged[wrong].mean(), 100 * flagged[~wrong].mean()
        for ax, column in zip(axes, shares.T, strict=True):
            ax.plot(sizes, column, "o-", color=color, label=name)
        print(name, dict(zip(sizes, shares.round(2).tolist(), strict=True)))
    for ax, label in zip(axes, ("outliers found (%)", "real points lost (%)"), strict=True):
        ax.set(xscale="log", xlabel="neighbors", ylabel=label, ylim=(0, None))
        ax.set_xticks(sizes, sizes)
        ax.minorticks_off()
        ax.grid(alpha=0.3)
    axes[0].legend()
    save(figure, "choosing_outliers")


def trials():
    """How many trials Eq. 13 asks for."""
    rate = np.linspace(0.02, 0.8, 200)
    figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
    for probability, color in ((0.95, GREEN), (0.99, BLUE), (0.9999, RED)):
        count = np.ceil(np.log1p(-probability) / np.log1p(-((1 - rate) ** 3)))
        ax.plot(rate, count, color=color, label=f"success_probability={probability:g}")
    ax.plot(0.5, 69, "ko")
    ax.annotate("default: 69", (0.5, 69), (0.27, 180), arrowprops={"arrowstyle": "->"})
    ax.set(xlabel="max_outlier_rate", ylabel="trials", yscale="log", ylim=(1, 1500))
    ax.grid(alpha=0.3)
    ax.legend()
    save(figure, "choosing_trials")
    for value in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7):
        counts = [
            int(np.ceil(np.log1p(-p) / np.log1p(-((1 - value) ** 3)))) for p in (0.95, 0.99, 0.9999)
        ]
        print(value, counts)


def rates(runs=100):
    """Neighborhoods of 50 points whose plane tilts, by the outliers in them and by the rate."""
    shares = np.arange(0.0, 0.75, 0.08)
    forms = {
        "max_outlier_rate=0.1": {"max_outlier_rate": 0.1},
        "max_outlier_rate=0.3": {"max_outlier_rate": 0.3},
        "max_outlier_rate=0.5 (default)": {},
        'max_outlier_rate=0.7, support_fraction=0.3, mcmd_md': {
            "max_outlier_rate": 0.7, "support_fraction": 0.3,
            "method": "mcmd_md", "reweight": False,
        },
    }  # fmt: skip
    figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
    for color, (name, options) in zip((GREEN, BLUE, RED, ORANGE), forms.items(), strict=True):
        tilted = []
        for share in shares:
            bad = 0
            for seed in range(runs):
                X, _ = make_contaminated_plane(
                    50, outlier_share=share, outliers="uniform", random_state=seed
                )
                estimator = RobustNormalEstimator(
                    None, neighbor_planes=False, random_state=seed, **options
                ).fit(X)
                bad += np.degrees(np.arccos(min(1, abs(estimator.normals_[0, 2])))) > 5
            tilted.append(100 * bad / runs)
        ax.plot(100 * shares, tilted, "o-", ms=4, color=color, label=name)
        print(name, dict(zip(shares.round(2).tolist(), map(float, tilted), strict=True)))
    ax.set(
        xlabel="outliers in the neighborhood (%)", ylabel="planes off by more than 5 degrees (%)"
    )
    ax.grid(alpha=0.3)
    ax.legend()
    save(figure, "choosing_rates")


FIGURES = {f.__name__: f for f in (neighborhoods, normals, widths, outliers, trials, rates)}

if __name__ == "__main__":
    for name in sys.argv[1:] or FIGURES:
        FIGURES[name]()
