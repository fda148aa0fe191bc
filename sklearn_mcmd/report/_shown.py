"""The points that a report shows: those of memory, or of files by tiles a sample that it states."""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.io._units import length_unit
from sklearn_mcmd.report._contents import Note, share
from sklearn_mcmd.report._facts import (
    CHECKS,
    CHECKS_OF_ALL,
    Facts,
    bounds_rows,
    cloud_notes,
    usual_rows,
)

SAMPLE = 500_000  # points; maps show a quarter of them, and shares are known to 0.1 %
PART = 1_000_000  # points that are read at a time


class Shown(NamedTuple):
    """What a report shows, and what it knows of the whole."""

    cloud: PointCloud  # all points, or every so many-th, with the attributes that were written
    n_all: int  # points of the whole
    near: np.ndarray  # bool (n,), points that are not far from all others
    rows: list[tuple[str, str]]  # what the input holds
    words: str = ""  # that state the sample, if not all points are shown
    notes: Sequence[Note] = ()  # what is the matter with the cloud itself
    checks: str = ""  # what was looked for in the cloud itself
    run_rows: Sequence[tuple[str, str]] = ()  # numbers of tiles and files
    files: str = ""  # words on the number of outputs, if there are several

    @property
    def xyz(self):
        return self.cloud.xyz

    @property
    def left_out(self):
        """Which points maps and tables leave out, in words."""
        n = int(np.count_nonzero(~self.near))
        far = f"{counted(n, 'point', 'lie')} far from the others, and not in the maps." if n else ""
        return f"{self.words} {far}".strip()

    @classmethod
    def of_memory(cls, cloud, n_neighbors, scales=None, /, **results):
        """A cloud as it was read, with results; 0 neighbors: without neighborhoods."""
        facts, near = Facts.of(cloud.xyz, n_neighbors, scales), usual_rows(cloud.xyz)
        return cls(
            cloud=cloud.with_attributes(**results),
            n_all=len(cloud),
            near=near,
            rows=[*facts.rows(cloud), ("unit of lengths", length_unit(cloud) or "not stated")],
            notes=cloud_notes(facts, int(np.count_nonzero(~near))),
            checks=CHECKS if n_neighbors else CHECKS_OF_ALL,
        )

    @classmethod
    def of_tiles(cls, catalog, outputs, run, names):
        return cls.of_sample(sample_of(outputs, step_of(run), names), catalog, outputs, run)

    @classmethod
    def of_sample(cls, cloud, catalog, outputs, run):
        step, words = step_of(run), ""
        if step > 1:
            words = f"Maps and tables are of a sample: one point of {step:,}, "
            words += f"{share(len(cloud), run.n_points)}."
        rows = [("points", f"{catalog.n_points:,}"), ("files", f"{len(catalog):,}")]
        rows += bounds_rows(catalog.low, catalog.high).items()
        rows.append(("CRS", catalog.crs or "not stated"))
        run_rows = [("tiles", f"{run.n_tiles:,}"), ("input files", f"{len(catalog):,}")]
        return cls(
            cloud=cloud,
            n_all=run.n_points,
            near=usual_rows(cloud.xyz),
            rows=rows,
            words=words,
            checks="the cloud itself is not measured by tiles",
            run_rows=run_rows,
            files=f" in {counted(len(outputs), 'file')}",
        )


def step_of(run):
    return -(-run.n_points // SAMPLE)


def sample_of(paths, step, names=()):
    """Every so many-th point of files, with these attributes."""
    columns: dict[str, list] = {name: [] for name in names}
    xyz, first = [], 0
    for part in chain.from_iterable(read_parts(path, PART) for path in paths):
        rows = slice((-first) % step, None, step)
        xyz.append(part.xyz[rows])
        for name in names:
            columns[name].append(part.attributes[name][rows])
        first += len(part)
    return PointCloud(
        np.concatenate(xyz), {name: np.concatenate(parts) for name, parts in columns.items()}
    )
