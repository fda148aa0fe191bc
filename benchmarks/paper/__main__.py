"""Print the first paper's Tables 1 and 4 beside ours, with Monte-Carlo errors.

python -m benchmarks.paper list
python -m benchmarks.paper table1 --runs 1000 --seed 0
"""

import argparse
from inspect import signature
from time import perf_counter

from benchmarks.paper import EXPERIMENTS
from sklearn_mcmd.cli._messages import progress


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.paper",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", choices=["list", "all", *EXPERIMENTS], metavar="NAME")
    parser.add_argument("--runs", type=int, help="simulated clouds; else the paper's number")
    parser.add_argument("--seed", type=int, default=0, help="seed of clouds and trials")
    options = parser.parse_args(arguments)
    if options.runs is not None and options.runs < 2:
        parser.error(f"argument --runs: {options.runs} is too few, at least 2 are needed")
    if options.seed < 0:
        parser.error(f"argument --seed: {options.seed} is negative")
    if options.name == "list":
        for name, function in EXPERIMENTS.items():
            print(f"{name:<9} {function.__doc__.splitlines()[0].partition(': ')[2]}")
        return
    for name in EXPERIMENTS if options.name == "all" else [options.name]:
        reproduce(name, options)


def reproduce(name, options):
    experiment = EXPERIMENTS[name]
    runs = options.runs or signature(experiment).parameters["runs"].default
    start = perf_counter()
    with progress(name, quiet=False):
        report = experiment(runs, seed=options.seed)
    print(f"{report}\n\n{perf_counter() - start:.1f} seconds, seed {options.seed}\n")


if __name__ == "__main__":
    main()
