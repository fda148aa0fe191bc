"""benchmarks/bench_recognition.py: what it says of a turn, and of the same turn moved."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from sklearn_mcmd.datasets import make_lidar_turn

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"

if not BENCHMARKS.is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))
bench = importlib.import_module("bench_recognition")
sys.path.remove(str(BENCHMARKS))


def test_the_figures_of_a_turn_say_what_is_recognized():
    """The ratio of the turn is below the limit and its rise above, and "moved" is not it."""
    turn = make_lidar_turn(8_000, random_state=0).data
    ratio, rise, told = bench.figures(turn)
    assert ratio < 0.5
    assert rise > 3
    assert told == "a turn about the origin"
    away = list(bench.moved(turn))
    assert len(away) == 12
    assert {round(np.linalg.norm((other - turn)[0])) for other in away} == {1, 10, 1000}
    ratio, rise, told = bench.figures(away[0])
    assert not told
    assert ratio >= 0.5 or rise <= 3
