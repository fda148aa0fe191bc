"""
How do I give a large cloud to a Dask cluster?
==============================================

Start the cluster, and say ``backend="dask"``: `process_files` gives each tile to a worker, and the
output is that of one process. Here two workers run on this machine, in this process. On several
machines replace the cluster by the address of a scheduler; :doc:`/cluster` says what they need.

.. code-block:: bash

    mcmd denoise scan.laz clean.laz --scheduler tcp://10.0.0.1:8786
    python plot_dask_cluster.py --points 20000
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import dask
import joblib
import matplotlib.pyplot as plt
import numpy as np
from distributed import Client, LocalCluster

from sklearn_mcmd import RegionGrowing
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.plotting import SegmentationDisplay
from sklearn_mcmd.tiling import process_files

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=20_000, help="points of the street")
n_points = parser.parse_args().points
xyz = np.round(make_street(n_points, outlier_share=0.0, random_state=0).data, 3)

# %%
# The same job twice: in this process, and by the workers. Each worker takes one tile at a time, so
# it has one thread.
growing = RegionGrowing(random_state=0)
dask.config.set({"distributed.worker.memory.pause": False})  # they share this process's memory
place = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "protocol": "tcp"}
workers = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "memory_limit": "1.5GB"}
with TemporaryDirectory() as folder:
    source, alone, shared = (Path(folder, f"{name}.laz") for name in ("scan", "alone", "shared"))
    write_points(source, PointCloud(xyz))
    process_files(source, alone, growing, tile_size=n_points // 4)
    with (
        LocalCluster(**place, **workers) as cluster,
        Client(cluster),
        joblib.parallel_config(backend="dask"),
    ):
        report = process_files(source, shared, growing, tile_size=n_points // 4)
    print(f"{report.n_points:,} points in {report.n_tiles} tiles, {report.n_workers} workers")
    print("the output is that of one process:", alone.read_bytes() == shared.read_bytes())
    result = read_points(shared)

# %%
# Regions go on over the borders of tiles.
figure, ax = plt.subplots(figsize=(9, 6), layout="constrained")
SegmentationDisplay.from_predictions(result.xyz, result.attributes["region"], ax=ax)
ax.set_title(f"{report.n_tiles} tiles, by {report.n_workers} workers", fontsize=12)
plt.show()
