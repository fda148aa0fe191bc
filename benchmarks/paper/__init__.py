"""The first paper's tables and figures, one function each: its printed numbers beside ours.

Table 3, Table 5 and Figures 5 to 7 are in commit 0bdc31fa; docs/reproduction.rst has their numbers.
"""

from benchmarks.paper._angles import figure4, table1
from benchmarks.paper._classification import table4
from benchmarks.paper._segments import table6
from benchmarks.paper._sharp import figure10, figure11, figure12, figure13

EXPERIMENTS = {
    experiment.__name__: experiment
    for experiment in (
        table1,
        table4,
        table6,
        figure4,
        figure10,
        figure11,
        figure12,
        figure13,
    )
}
