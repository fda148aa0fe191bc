"""
What do the planes look like?
=============================

Figure 3 of the first paper shows clouds of 50 points along the y axis, and the planes that the
methods fit to them. The clouds have few or very many outliers, clustered or uniform.

.. code-block:: bash

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
