"""
Do sample size, density and roughness change the order of the methods?
======================================================================

Figures 6 and 7 and Table 2 of the first paper have mean bias angles for 20, 50 and 200 points, for
six densities of points along the plane, and for five variances across it.

.. code-block:: bash

    python plot_paper_samples.py --runs 1000
    python -m sklearn_mcmd.paper figure6
    python -m sklearn_mcmd.paper table2
    python -m sklearn_mcmd.paper figure7
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import figure6, figure7, table2

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=4, help="simulated clouds of each kind")
runs = parser.parse_args().runs

# %%
# By sample size and percentage of outliers, of which the paper has all from 1 to 45.
report = figure6(runs, percentages=(10, 20, 30, 40))
print(report)
report.plot()
plt.show()

# %%
# The six densities.
report = table2(runs)
print(report)
report.plot()
plt.show()

# %%
# By density and by roughness.
report = figure7(runs)
print(report)
report.plot()
plt.show()
