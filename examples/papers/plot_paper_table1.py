"""
Whose plane stays in place when a fifth of the points are outliers?
===================================================================

One method fits two planes: to 50 points with 10 outliers, and to the same points with regular
points in place of the outliers. Table 1 and Figure 4 of the first paper have the angle between
these planes. The paper's numbers are printed beside ours, with Monte-Carlo errors. Notes below
say which values each method is given, and which numbers cannot be reproduced. Rows without a line
"paper" are additions: MCMD_MD as in the text, RANSAC with the right noise, and the default,
`reweighted`.

.. code-block:: bash

    python plot_paper_table1.py --runs 1000
    python -m sklearn_mcmd.paper table1
    python -m sklearn_mcmd.paper figure4
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import figure4, table1

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=50, help="simulated clouds of each kind")
runs = parser.parse_args().runs

# %%
# Table 1.
report = table1(runs)
print(report)
report.plot()
plt.show()

# %%
# Figure 4 adds 70 % of clustered and 80 % of uniform outliers. Only methods that are given the
# share withstand these.
report = figure4(runs)
print(report)
report.plot()
plt.show()
