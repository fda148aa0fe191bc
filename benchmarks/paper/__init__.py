"""The first paper's Tables 1 and 4: its printed numbers beside ours.

Its other tables and figures are in commits 0bdc31fa, 97bb9769 and 0f835d4c; docs/reproduction.rst
has the numbers of all.
"""

from benchmarks.paper._angles import table1
from benchmarks.paper._classification import table4

EXPERIMENTS = {function.__name__: function for function in (table1, table4)}
