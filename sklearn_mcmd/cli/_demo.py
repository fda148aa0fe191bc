"""``mcmd demo``: a street with known truth, and the accuracy of the results; ``mcmd warm-up``."""

import os
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.cli._denoise import denoise
from sklearn_mcmd.cli._messages import clear_exits, print_table, progress
from sklearn_mcmd.cli._normals import normals
from sklearn_mcmd.cli._options import Quiet
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._files import naming, replacing
from sklearn_mcmd.runtime._interrupts import ignore_interrupts

N_POINTS = 60_000  # of the street
OUTLIER_SHARE = 0.1  # of its points
DPI = 100  # of the picture


def demo(
    folder: Annotated[
        Path, typer.Argument(metavar="[DIR]", help="Folder of the files; it is made if missing.")
    ] = Path("mcmd-demo"),
    force: Annotated[bool, typer.Option("--force", help="Replace files with these names.")] = False,
) -> None:
    """Twice: by coordinates alone, and with --sensor, the position of the scanner. Writes
    street.laz (with outliers, and the truth as attributes), clean.laz, clean_sensor.laz,
    normals.laz and demo.png, and prints the accuracy.
    """
    with clear_exits():
        begin = time.perf_counter()
        import_extra("matplotlib", "plot", "the picture")
        names = "street.laz", "clean.laz", "clean_sensor.laz", "normals.laz", "demo.png"
        outputs = street, clean, clean_sensor, with_normals, picture = [folder / n for n in names]
        present = [path.name for path in outputs if os.path.lexists(path)]
        if present and not force:
            raise FileExistsError(
                f"{folder} already holds {', '.join(present)}; name another folder, or --force"
            )
        sensor = write_street(street)
        denoise(street, clean, sensor="none")
        denoise(street, clean_sensor, sensor=sensor)
        normals(clean_sensor, with_normals, orientation="sensor", sensor=sensor)
        cleaned = {"by coordinates alone": clean}
        cleaned[f"with --sensor {','.join(f'{x:g}' for x in sensor)}"] = clean_sensor
        draw(street, cleaned, with_normals, picture)
        ignore_interrupts()
        for how, path in cleaned.items():
            print_table(f"Outliers {how}, against the truth", **outlier_rates(street, path))
        median, high = np.quantile(normal_errors(with_normals), [0.5, 0.95])
        print_table(
            "Normals of what is left with --sensor: angle to the truth",
            degrees=f"median {median:.2f}, 95 % below {high:.1f}",
        )
        typer.echo(f"Picture: {picture}; {time.perf_counter() - begin:.1f} seconds in all.")


def write_street(path):
    """Write a contaminated street with its truth as attributes; returns where its sensor stood."""
    with naming(path.parent, "made"):
        path.parent.mkdir(parents=True, exist_ok=True)
    from sklearn_mcmd.datasets import make_street

    street = make_street(N_POINTS, outlier_share=OUTLIER_SHARE, random_state=0)
    truth = {
        "true_outlier": (street.target == -1).astype(np.uint8),
        "outlier_kind": street.outlier_kind.astype(np.uint8),
        "edge_distance": street.edge_distance.astype(np.float32),
    }
    for axis, values in zip("xyz", street.normals.T, strict=True):
        truth[f"true_normal_{axis}"] = values.astype(np.float32)
    # Tenths of a millimeter, as a scanner writes.
    write_points(path, PointCloud(np.round(street.data, 4), truth))
    return tuple(street.sensor_origins[0].tolist())


def outlier_rates(street, clean):
    """Accuracy of the removal, in words, from the two files alone: both hold the truth."""
    is_outlier = read_points(street).attributes["true_outlier"] == 1
    missed = read_points(clean).attributes["true_outlier"] == 1
    n_outliers, n_regular = np.count_nonzero(is_outlier), np.count_nonzero(~is_outlier)
    n_found, n_kept = n_outliers - np.count_nonzero(missed), np.count_nonzero(~missed)
    rates = {
        "outliers found": n_found / n_outliers,
        "regular points kept": n_kept / n_regular,
        "accuracy": (n_found + n_kept) / len(is_outlier),
    }
    return {name: f"{100 * rate:.1f} %" for name, rate in rates.items()}


def normal_errors(path):
    """Angles to the true normals in degrees, from the file alone, of points that have one."""
    from sklearn_mcmd.metrics import bias_angle

    cloud = read_points(path)
    true_normals = _stack(cloud, "true_normal_")
    has_normal = np.isfinite(true_normals).all(axis=1)
    return bias_angle(_stack(cloud, "normal_")[has_normal], true_normals[has_normal])


def draw(street, cleaned, with_normals, path):
    """Draw the street, each cleaned one and the normals into a PNG; outliers are red."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from sklearn_mcmd.plotting import normal_colors, plot_cloud
    from sklearn_mcmd.plotting._still import draw_ball
    from sklearn_mcmd.plotting._views import VIEW

    fig, axes = plt.subplots(2, 2, figsize=(11, 8.6), layout="constrained", facecolor="white")
    for ax, (how, file) in zip(axes.flat, ({"Before": street} | cleaned).items(), strict=False):
        cloud = read_points(file)
        outlier = cloud.attributes["true_outlier"] == 1
        plot_cloud(cloud.xyz, outliers=outlier, ax=ax)
        left = "left" if file in cleaned.values() else "in red"
        title = f"{how[0].upper()}{how[1:]}: {np.count_nonzero(outlier):,} outliers {left}"
        ax.set_title(title, fontsize=12)
    last, cloud = axes[1, 1], read_points(with_normals)
    plot_cloud(cloud.xyz, color=normal_colors(_stack(cloud, "normal_")), ax=last)
    last.set_title("Normals of what is left with --sensor", fontsize=12)
    draw_ball(last, VIEW)
    for ax in axes.flat[1:]:  # the same place and scale, so that the eye can compare
        ax.set(xlim=axes[0, 0].get_xlim(), ylim=axes[0, 0].get_ylim())
    with replacing(path) as temporary:
        fig.savefig(temporary, dpi=DPI)
    plt.close(fig)


def warm_up(quiet: Quiet = False) -> None:
    """Their first run then does not wait. The code is kept on disk until the package or Numba
    changes."""
    with clear_exits():
        import sklearn_mcmd
        from sklearn_mcmd.datasets import make_street

        begin = time.perf_counter()
        X = make_street(20_000, outlier_share=0.1, random_state=0).data
        estimators = (
            sklearn_mcmd.MCMDOutlierDetector,
            sklearn_mcmd.RobustNormalEstimator,
            sklearn_mcmd.RegionGrowing,
            sklearn_mcmd.SharpFeatureDetector,
        )
        with progress("warm-up", quiet) as part:
            for i, estimator in enumerate(estimators):
                with part(i / 4, (i + 1) / 4, estimator.__name__):
                    estimator(random_state=0).fit(X)
        if not quiet:
            print_table("Compiled", begin)


def _stack(cloud, prefix):
    return np.column_stack([cloud.attributes[f"{prefix}{axis}"] for axis in "xyz"])
