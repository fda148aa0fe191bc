"""
Whose plane stays in place when a fifth of the points are outliers?
===================================================================

Table 1 and Figure 4 of the first paper: the angle between the planes that one method fits to 50
points, 10 of them outliers, and to the same points with these replaced by regular ones. The
paper's figures stand beside ours, with their Monte-Carlo errors; what each row is told and what
cannot be reproduced is printed below. Rows without a line "paper" are this package's additions:
MCMD_MD as the text has it, RANSAC with the right noise, and the default, `reweighted`.

    python plot_paper_table1.py --runs 1000
    python -m sklearn_mcmd.paper table1
    python -m sklearn_mcmd.paper figure4
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd.paper import figure4, table1

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=100, help="simulated clouds of each kind")
runs = parser.parse_args().runs

# %%
# Table 1.
report = table1(runs)
print(report)
report.plot()
plt.show()

# %%
# Figure 4 adds 70 % of clustered and 80 % of uniform outliers, which only a method that is told so
# can bear.
report = figure4(runs)
print(report)
report.plot()
plt.show()
