"""The first paper's Tables 1, 4 and 6: its printed numbers beside ours.

Its other tables and figures are in commits 0bdc31fa and 97bb9769; docs/reproduction.rst has the
numbers of all.
"""

from benchmarks.paper._angles import table1
from benchmarks.paper._classification import table4
from benchmarks.paper._segments import table6

EXPERIMENTS = {function.__name__: function for function in (table1, table4, table6)}
