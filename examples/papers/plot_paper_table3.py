"""
What does a robust plane cost?
==============================

The first table is Table 3 of the first paper, as ratios of times within one run. The second has
the time of MCMD by the number of points in one neighborhood. Absolute times are those of this
machine.

.. code-block:: bash

    python plot_paper_table3.py --runs 1000
    python -m sklearn_mcmd.paper table3
    python -m sklearn_mcmd.paper cost
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import cost, table3

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=8, help="simulated clouds of each kind")
runs = parser.parse_args().runs

# %%
# Ratios to MCMD_Z, which is given the share of outliers, as it was in the paper.
report = table3(runs)
print(report)
report.plot()
plt.show()

# %%
# From 10 to 100,000 points in one neighborhood. Besides a fixed time for the call, the time is
# proportional to the number of points.
report = cost()
print(report)
report.plot()
plt.show()
