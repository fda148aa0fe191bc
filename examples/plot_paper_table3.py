"""
What does a robust plane cost?
==============================

Table 3 of the first paper as ratios of times within one run, and the time of MCMD against the
number of points of one neighborhood. Absolute times are those of this machine.

    python plot_paper_table3.py --runs 1000
    python -m sklearn_mcmd.paper table3
    python -m sklearn_mcmd.paper cost
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import cost, table3

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=30, help="simulated clouds of each kind")
runs = parser.parse_args().runs

# %%
# Ratios to MCMD_Z, which is told the share of outliers here as it was in the paper's timings.
report = table3(runs)
print(report)
report.plot()
plt.show()

# %%
# From 10 to 100,000 points in one neighborhood. After what the call itself takes, the time is
# proportional to the number of points.
report = cost()
print(report)
report.plot()
plt.show()
