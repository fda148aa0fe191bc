"""
How many regular points does each method call outliers?
=======================================================

Table 4 and Figure 8 of the first paper have outliers found (TPR) and regular points kept (TNR) of
100 points. MCMD_Z and MCMD_MD are reproduced to a tenth of a percent. So is RANSAC if it is given
the variance of the noise in place of its standard deviation, as in the paper. uLSIF and qSp are not
reproduced.

.. code-block:: bash

    python plot_paper_table4.py --runs 1000
    python -m sklearn_mcmd.paper table4
    python -m sklearn_mcmd.paper figure8
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import figure8, table4

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=100, help="simulated clouds of each kind")
runs = parser.parse_args().runs

# %%
# Table 4.
report = table4(runs)
print(report)
report.plot()
plt.show()

# %%
# Figure 8: the regular points kept in each run, with 20 % of outliers.
report = figure8(runs)
print(report)
report.plot()
plt.show()
