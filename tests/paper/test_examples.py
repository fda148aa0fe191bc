"""The scripts of examples/ that reproduce the first paper, and the grid search, run as scripts."""

import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("paper_table1", ["--runs", "2"], "Figure 4: bias angles (degrees) of 50 points, 2 runs"),
        ("paper_table4", ["--runs", "2"], "Table 4: classification of 100 points, 2 runs"),
        ("paper_planes", [], "angle to the true plane, degrees"),
        ("grid_search", ["--points", "1500"], "unseen street"),
    ],
)
def test_an_example_prints_its_result(name, arguments, expected, monkeypatch, capsys):
    script = EXAMPLES / f"plot_{name}.py"
    if not script.exists():
        pytest.skip("examples/ isn't installed")
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("agg")
    monkeypatch.setattr(sys, "argv", [str(script), *arguments])
    runpy.run_path(str(script), run_name="__main__")
    plt.close("all")
    assert expected in capsys.readouterr().out


def test_every_example_of_the_paper_begins_with_a_question():
    scripts = sorted(EXAMPLES.glob("plot_paper_*.py"))
    if not scripts:
        pytest.skip("examples/ isn't installed")
    for script in scripts:
        title = script.read_text(encoding="utf-8").splitlines()[1]
        assert title.endswith("?"), script.name
