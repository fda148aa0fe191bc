"""benchmarks/bench_stated.py: what it says of a right position, and of one on the ground."""

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
bench = importlib.import_module("bench_stated")
sys.path.remove(str(BENCHMARKS))


def test_both_numbers_tell_the_right_position_from_the_ground():
    turn = make_lidar_turn(30_000, random_state=0).data
    places = bench.moved(np.zeros(3), 10.0, turn[:, 2].min())
    ratio, sheets, _, flagged, _ = bench.figures(turn, places["right"])
    assert ratio < 0.5
    assert sheets < 10
    wrong_ratio, sheets, _, wrong_flagged, alone = bench.figures(turn, places["on the ground"])
    assert wrong_ratio > 0.5
    assert sheets > 10
    assert wrong_flagged > 5 * flagged
    assert alone > 0.5 * wrong_flagged
