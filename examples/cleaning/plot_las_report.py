"""
How do I clean a LAS file, and keep a report of it?
===================================================

Here laspy makes a file with an intensity, as a scanner's software would. One command writes the
cleaned LAZ, which holds everything else as it was, and a report: one page that says in words,
numbers and maps what was removed and where. Then laspy reads both files.

.. code-block:: bash

    mcmd denoise scan.las clean.laz --report report
    python plot_las_report.py --points 20000
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import laspy
import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import plot_cloud

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=40_000, help="points of the street")
n_points = parser.parse_args().points

# %%
# A street in national coordinates, with steps of 1 mm and bright stripes: what was bright stays so.
street = make_street(n_points, tree=True, outlier_share=0.05, random_state=0)
header = laspy.LasHeader(point_format=6, version="1.4")
header.offsets, header.scales = [356_000, 5_640_000, 80], [0.001, 0.001, 0.001]
scan = laspy.LasData(header)
scan.xyz = street.data + header.offsets
scan.intensity = 200 + 600 * (street.data[:, 0] % 1 < 0.15)

with TemporaryDirectory() as folder:
    source, target = Path(folder, "scan.las"), Path(folder, "clean.laz")
    scan.write(source)
    command = [sys.executable, "-m", "sklearn_mcmd", "denoise", str(source), str(target)]
    subprocess.run([*command, "--report", str(Path(folder, "report"))], check=True)
    clean = laspy.read(target)
    report = Path(folder, "report", "index.html").read_text("utf-8")

# %%
# What the report says first, and what the file has kept.
words = re.sub(r"<[^>]+>", " ", report.partition("<body")[2].partition(">")[2])
print(" ".join(words.split())[:300], "...")
print(f"{len(scan):,} points before, {len(clean):,} after")
print("intensities:", np.unique(scan.intensity), "before,", np.unique(clean.intensity), "after")

# %%
figure, axes = plt.subplots(1, 2, figsize=(13, 5.5), layout="constrained")
for ax, cloud, title in ((axes[0], scan, "scan.las"), (axes[1], clean, "clean.laz")):
    plot_cloud(cloud.xyz - header.offsets, color=np.asarray(cloud.intensity), ax=ax)
    ax.set_title(f"{title}: {len(cloud):,} points, colored by intensity", fontsize=12)
axes[1].set(xlim=axes[0].get_xlim(), ylim=axes[0].get_ylim())
plt.show()
