"""
How many outliers can each method withstand?
============================================

Figure 5 of the first paper shows the mean bias angle by the percentage of clustered outliers among
100 points. The paper's breakdown points are 47 % for RPCA, 49 % for MCMD_Z, 64 % for RANSAC and
74 % for MCMD_MD, which is given the share. Without the share or the noise no method withstands
half of the points.

.. code-block:: bash

    python plot_paper_breakdown.py --runs 1000
    python -m sklearn_mcmd.paper figure5
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import figure5

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=10, help="simulated clouds of each kind")
runs = parser.parse_args().runs

# %%
report = figure5(runs)
print(report)
report.plot()
plt.show()
