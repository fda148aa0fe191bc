"""
What do the planes look like?
=============================

Figure 3 of the first paper: one cloud of 50 points with few and with very many outliers, clustered
or uniform, seen along the y axis, and the planes that the methods fit to it.

    python plot_paper_planes.py
    python -m sklearn_mcmd.paper figure3
"""

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import figure3

# %%
report = figure3()
print(report)
report.plot()
plt.show()
