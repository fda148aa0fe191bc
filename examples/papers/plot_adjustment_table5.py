"""
Which protocol gives the paper's Table 5?
=========================================

Arabsheibani et al. insert a known number of outliers into simulated planes. They count the
outliers that Baarda's method and the fuzzy approach find. Up to 16 % of outliers both are right.
With more, "Baarda" removes up to the whole cloud, but "Fuzzy" returns the inserted number.

The paper does not say how large its outliers are, where they lie, or how it removed them. Its
counts show it: outliers of 6 s0 on one side, noise of about 0.1 s0, and **every point above the
uncorrected critical value removed at once**. That is not data snooping, which removes the worst
point and adjusts again, at a level that depends on the number of tests. On the same clouds data
snooping returns the inserted number in every row. So does the fuzzy approach with a width of 1.25.

With 20 clouds for each row, each of the two has one exception. Data snooping stops early in one
cloud of set C at alpha 0.01: 20 % of outliers pull the plane up until they are 4.8 above it, less
than the critical value of 4.89. Fuzzy flags one good point in two clouds with 160 outliers of 500
points.

.. code-block:: bash

    python plot_adjustment_table5.py --runs 20
"""

import argparse
import warnings

import matplotlib.pyplot as plt
import numpy as np
from adjustment_paper import TABLE_5, detect, simulate

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=2, help="clouds for each row")
runs = parser.parse_args().runs

# %%
# Each row of the table has the paper's count beside the mean of ours. Good points that the batch
# removed come back when all points are tested on its last plane.
columns = ["batch", "batch, tested again", "data snooping", "fuzzy alpha", "fuzzy 1", "fuzzy 1.25"]
header = f"{'set':>3}{'alpha':>7}{'inserted':>9}{'paper: Baarda':>15}{'Fuzzy':>7}"
print(header + "".join(f"{name:>21}" for name in columns))
warnings.filterwarnings("ignore", message="The tests reject")  # "500 (all points)"
counts = {}
for row in TABLE_5:
    if row in counts:
        continue  # printed twice in the paper
    found = [detect(simulate(row.set, row.inserted, seed)[0], row.alpha) for seed in range(runs)]
    counts[row] = {name: [np.count_nonzero(run[name]) for run in found] for name in columns}
    line = f"{row.set:>3}{row.alpha:>7.2f}{row.inserted:>9}{row.baarda:>15}{row.inserted:>7}"
    for name in columns:
        each = counts[row][name]
        line += f"{f'{np.mean(each):.1f} [{min(each)}, {max(each)}]':>21}"
    print(line)

# %%
# The difference of our columns from the paper's, in percent of the points of a set.
print()
sizes = {"A": 500, "B": 5000, "C": 10000}
for name, truth in [("batch", "baarda"), ("data snooping", "inserted"), ("fuzzy 1.25", "inserted")]:
    for key, size in sizes.items():
        errors = [
            abs(np.mean(c[name]) - getattr(r, truth)) for r, c in counts.items() if r.set == key
        ]
        print(
            f"{name:>14} against the paper's count, set {key}: {100 * np.mean(errors) / size:.2f} %"
        )

# %%
# The share of points that are called outliers, by the share inserted (alpha 0.15). The paper's
# counts are crosses.
figure, axes = plt.subplots(1, 3, figsize=(14, 4.2), sharey=True, layout="constrained")
for ax, (key, size) in zip(axes, sizes.items(), strict=True):
    rows = sorted((r for r in counts if r.set == key and r.alpha == 0.15), key=lambda r: r.inserted)
    share = [100 * r.inserted / size for r in rows]
    for name, color in [
        ("batch", "tab:red"),
        ("fuzzy alpha", "tab:orange"),
        ("fuzzy 1.25", "tab:green"),
        ("data snooping", "tab:blue"),
    ]:
        ax.plot(
            share, [100 * np.mean(counts[r][name]) / size for r in rows], label=name, color=color
        )
    ax.plot(share, [100 * r.baarda / size for r in rows], "kx", label='paper, "Baarda"')
    ax.plot(share, share, "k:", label="inserted (paper's Fuzzy)")
    ax.set(title=f"Set {key}: {size} points", xlabel="inserted outliers [%]")
axes[0].set_ylabel("detected [%]")
axes[0].legend()
plt.show()
