"""``mcmd demo``: a street with known truth, and the accuracy of the results."""

import os
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.cli._denoise import denoise
from sklearn_mcmd.cli._messages import clear_exits, print_table
from sklearn_mcmd.cli._normals import normals
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._files import naming, replacing
from sklearn_mcmd.runtime._interrupts import ignore_interrupts

N_POINTS = 60_000  # of the street
OUTLIER_SHARE = 0.1  # of its points
DPI = 100  # of the picture
FILES = "street.laz", "clean.laz", "clean_sensor.laz", "normals.laz", "demo.png"


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
        present = [name for name in FILES if os.path.lexists(folder / name)]
        if present and not force:
            raise FileExistsError(
                f"{folder} already holds {', '.join(present)}; name another folder, or --force"
            )
        street, clean, clean_sensor, oriented, picture = (folder / name for name in FILES)
        sensor = write_street(street)
        denoise(street, clean, sensor="none")
        denoise(street, clean_sensor, sensor=sensor)
        normals(clean_sensor, oriented, orientation="sensor", sensor=sensor)
        before, *cleaned, with_normals = map(read_points, (street, clean, clean_sensor, oriented))
        ways = "by coordinates alone", f"with --sensor {','.join(f'{x:g}' for x in sensor)}"
        after = dict(zip(ways, cleaned, strict=True))
        draw(before, after, with_normals, picture)
        ignore_interrupts()
        for way, cloud in after.items():
            print_table(f"Outliers {way}, against the truth", **outlier_rates(before, cloud))
        median, high = np.nanquantile(normal_errors(with_normals), [0.5, 0.95])
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


def outlier_rates(before, after):
    """Accuracy of the removal, in words; both clouds hold the truth."""
    counts = (np.bincount(one.attributes["true_outlier"], minlength=2) for one in (before, after))
    (n_regular, n_outliers), (n_kept, n_missed) = counts
    rates = {
        "outliers found": 1 - n_missed / n_outliers,
        "regular points kept": n_kept / n_regular,
        "accuracy": (n_kept + n_outliers - n_missed) / len(before),
    }
    return {name: f"{100 * rate:.1f} %" for name, rate in rates.items()}


def normal_errors(cloud):
    """Angles to the true normals in degrees; NaN of points that have none."""
    from sklearn_mcmd.metrics import bias_angle

    return bias_angle(_stack(cloud, "normal_"), _stack(cloud, "true_normal_"))


def draw(before, after, with_normals, path):
    """Draw the street, each cleaned one and the normals into a PNG; outliers are red."""
    new_figure = import_extra("matplotlib.figure", "plot", "the picture").Figure
    from sklearn_mcmd.plotting import normal_colors, plot_cloud
    from sklearn_mcmd.plotting._still import draw_ball
    from sklearn_mcmd.plotting._views import VIEW

    figure = new_figure((11, 8.6), dpi=DPI, layout="constrained", facecolor="white")
    *axes, last = figure.subplots(2, 2).flat
    for ax, (way, cloud) in zip(axes, ({"before": before} | after).items(), strict=True):
        is_outlier = cloud.attributes["true_outlier"] == 1
        plot_cloud(cloud.xyz, outliers=is_outlier, ax=ax)
        left = "in red" if cloud is before else "left"
        title = f"{way[0].upper()}{way[1:]}: {np.count_nonzero(is_outlier):,} outliers {left}"
        ax.set_title(title, fontsize=12)
    colors = normal_colors(_stack(with_normals, "normal_"))
    plot_cloud(with_normals.xyz, color=colors, ax=last)
    last.set_title("Normals of what is left with --sensor", fontsize=12)
    draw_ball(last, VIEW)
    for ax in (*axes[1:], last):  # the same place and scale, so that the eye can compare
        ax.set(xlim=axes[0].get_xlim(), ylim=axes[0].get_ylim())
    with replacing(path) as temporary:
        figure.savefig(temporary)


def _stack(cloud, prefix):
    return np.column_stack([cloud.attributes[f"{prefix}{axis}"] for axis in "xyz"])
