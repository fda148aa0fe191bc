"""The first paper's Tables 1, 4 and 6 and Figure 4: its printed numbers beside ours.

Its other tables and figures, and drawings of all, are in commit 0bdc31fa. docs/reproduction.rst has
the numbers of all.
"""

from benchmarks.paper._angles import figure4, table1
from benchmarks.paper._classification import table4
from benchmarks.paper._segments import table6

EXPERIMENTS = {function.__name__: function for function in (table1, table4, table6, figure4)}
