"""The scripts of examples/: each answers a question, has its place in the gallery, and is quick."""

import re
import runpy
import sys
import time
import warnings
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(EXAMPLES.rglob("plot_*.py"))
if not SCRIPTS:
    pytest.skip("examples/ isn't installed", allow_module_level=True)

# What a script prints, as part of its answer.
PRINTED = {
    "plot_adjustment_figures": "grid: data snooping                  finds  100 of 100 outliers",
    "plot_adjustment_table4": "largest ratio after / before in 300 clouds: 0.",
    "plot_dask_cluster": "the output is that of one process: True",
    "plot_grid_search": "unseen street",
    "plot_las_report": "intensities: [200 800] before, [200 800] after",
    "plot_one_plane": "finds 360 of 360, and 0 good points",
    "plot_pipeline_edges": "area under ROC",
    "plot_pipeline_search": "defaults, unseen",
    "plot_pipeline_segments": "polars gives the same segments: True",
    "plot_tiles": "other scores:      0\nother verdicts:    0",
}
FEW = ("--points", "4000")  # of scripts that have the option; `.ci/docs` runs them whole
ONCE = dict.fromkeys(["plot_adjustment_judgement", "plot_adjustment_table5"], ("--runs", "1"))
LONGEST = 60  # seconds of a processor: half a minute on two cores


@pytest.fixture(params=SCRIPTS, ids=lambda script: script.stem)
def script(request):
    return request.param


def test_a_chosen_thumbnail_is_one_of_its_figures(script):
    text = script.read_text(encoding="utf-8")
    chosen = re.search(r"^# sphinx_gallery_thumbnail_number = (\d+)$", text, re.M)
    assert chosen is None or int(chosen[1]) <= text.count("plt.show()")


def test_what_is_printed_is_asked_of_scripts_that_there_are():
    assert set(PRINTED) <= {script.stem for script in SCRIPTS}


@pytest.mark.slow
def test_it_answers_in_time(script, monkeypatch, capsys):
    for library in ("pandas", "polars", "laspy", "distributed"):
        pytest.importorskip(library)
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("agg")
    few = FEW if '"--points"' in script.read_text(encoding="utf-8") else ONCE.get(script.stem, ())
    monkeypatch.setattr(sys, "argv", [str(script), *few])
    monkeypatch.chdir(script.parent)
    monkeypatch.syspath_prepend(script.parent)  # some share a module
    before = time.process_time()
    with warnings.catch_warnings(), plt.rc_context():
        warnings.simplefilter("default")
        runpy.run_path(str(script), run_name="__main__")
    plt.close("all")
    assert PRINTED.get(script.stem, "") in capsys.readouterr().out
    assert time.process_time() - before < LONGEST
