"""The reproductions run as scripts."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("table4", ["--runs", "1"], "largest ratio after / before in 100 clouds: 0."),
        ("figures", [], "grid: data snooping                  finds  100 of 100 outliers"),
    ],
)
def test_a_reproduction_prints_its_result(name, arguments, expected):
    script = EXAMPLES / f"plot_adjustment_{name}.py"
    if not script.exists():
        pytest.skip("examples/ isn't installed")
    pytest.importorskip("matplotlib")
    root = str(EXAMPLES.parent)
    path = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, str(script), *arguments], capture_output=True, text=True, check=False,
        env=os.environ | {"MPLBACKEND": "agg", "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert expected in done.stdout
