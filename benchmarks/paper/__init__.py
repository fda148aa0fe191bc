"""The first paper's tables and figures, one function each: its printed numbers beside ours."""

from benchmarks.paper._angles import figure4, table1
from benchmarks.paper._classification import table4
from benchmarks.paper._denoising import table5
from benchmarks.paper._segments import table6
from benchmarks.paper._sharp import figure10, figure11, figure12, figure13
from benchmarks.paper._speed import table3
from benchmarks.paper._sweeps import figure5, figure6, figure7

EXPERIMENTS = {
    experiment.__name__: experiment
    for experiment in (
        table1,
        table3,
        table4,
        table5,
        table6,
        figure4,
        figure5,
        figure6,
        figure7,
        figure10,
        figure11,
        figure12,
        figure13,
    )
}
