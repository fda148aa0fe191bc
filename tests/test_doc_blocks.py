"""Every code block of the documentation runs, and prints what the page shows."""

import json
import pkgutil
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from doc_blocks import blocks, run_console, run_python
from sklearn_mcmd.cli import _messages
from sklearn_mcmd.cli._demo import write_street
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, write_points

ROOT = Path(__file__).resolve().parents[1]
if not (ROOT / "docs").is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)
PAGES = {path.stem: path for path in sorted((ROOT / "docs").glob("*.rst"))}

# Pages whose clouds are large, or that search parameters: pytest -m slow runs them.
SLOW = {
    "command_line",
    "creases",
    "datasets",
    "edges",
    "first_scan",
    "install",
    "outliers",
    "pipelines",
    "planes",
    "reports",
    "tiling",
}
# Pages that show the numbers of the street of `mcmd demo`.
DEMO = {"command_line"}
# Pages that make `street.laz` themselves.
FROM_NOTHING = {"first_scan", "install"}
# What a page takes as known to its reader, beside a cloud `xyz` and the file `street.laz`.
GIVEN = {
    "reproduction": """
import numpy as np
xyz = xyz[:300]  # ROBPCA takes milliseconds for each point
samples = np.random.default_rng(0).normal(size=(20, 50, 3)) * [1, 1, 0.1]
""",
    "normals": "from sklearn_mcmd import RobustNormalEstimator",
    "pipelines": """
import numpy as np
import pandas as pd
from sklearn_mcmd.datasets import make_street
cloud = pd.DataFrame(xyz, columns=list("xyz"))
scenes = [make_street(2_000, random_state=seed) for seed in range(2)]
X = np.vstack([s.data for s in scenes])
surface = np.concatenate([s.surface for s in scenes])
scene = np.repeat([0, 1], 2_000)
""",
    "user_guide": "X = xyz",
    "view": """
from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
detector = MCMDOutlierDetector(random_state=0).fit(xyz)
normals = RobustNormalEstimator(random_state=0).fit(xyz).normals_
labels = RegionGrowing(random_state=0).fit_predict(xyz)
ax = None
""",
}


def with_blocks():
    return [
        pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])
        for name, path in PAGES.items()
        if any(b.language in ("python", "console") for b in blocks(path.read_text("utf-8")))
    ]


@pytest.fixture(scope="module")
def street_xyz():
    return make_street(6_000, random_state=0).data


@pytest.fixture(scope="module")
def given_files(tmp_path_factory, street_xyz):
    """The files that commands of the pages read: a street, a wall, and two of a drive and scans."""
    folder, street = tmp_path_factory.mktemp("given"), PointCloud(np.round(street_xyz, 4))
    (folder / "drive").mkdir()
    for name in ("street", "yours", "scan", "drive"):
        write_points(folder / f"{name}.laz", street)
    halves = [{"assets": {"data": {"href": f"drive/{i}.laz", "roles": ["data"]}}} for i in (0, 1)]
    for i in (0, 1):
        write_points(folder / "drive" / f"{i}.laz", street.subset(slice(i, None, 2)))
        write_points(folder / ("spring.laz", "autumn.laz")[i], street.subset(slice(i, None, 2)))
    index = {"type": "FeatureCollection", "features": [{"type": "Feature"} | h for h in halves]}
    (folder / "drive.vpc").write_text(json.dumps(index))
    return folder


@pytest.fixture
def reader(tmp_path, given_files, monkeypatch):
    """Where a reader works: files of its own, no lines of progress, no windows of pictures."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    shutil.copytree(given_files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_messages, "PATIENCE", 3600.0)
    return tmp_path


@pytest.mark.parametrize("name", with_blocks())
def test_the_blocks_of_a_page_run_and_print_what_it_shows(name, reader, street_xyz):
    if name in DEMO:
        write_street(reader / "street.laz")
    if name in FROM_NOTHING:
        (reader / "street.laz").unlink()
    names = {"__name__": f"docs/{name}.rst", "xyz": street_xyz.copy()}
    exec(GIVEN.get(name, ""), names)
    found = blocks(PAGES[name].read_text("utf-8"))
    for block, after in zip(found, [*found[1:], None], strict=True):
        if block.language == "console":
            run_console(block)
        elif block.language == "python":
            run_python(block, names, after if after and after.language == "none" else None)


@pytest.mark.parametrize("name", PAGES)
def test_scripts_that_a_page_names_exist_and_have_the_options_it_gives(name):
    text = PAGES[name].read_text("utf-8").replace("\\\n", " ")
    for script, options in re.findall(
        r"((?:benchmarks|examples|docs)/\w+\.py)((?: +[^\s`]+)*)", text
    ):
        path = ROOT / script
        assert path.is_file(), script
        code = path.read_text("utf-8")
        for option in re.findall(r"(?<= )--[a-z][a-z-]+", options):
            assert f'"{option}"' in code, f"{script} {option}"


def test_functions_and_tests_that_the_papers_page_names_exist():
    text = PAGES["papers"].read_text("utf-8")
    rows = "\n".join(re.findall(r'^   ".*"$', text, re.MULTILINE))
    names = re.findall(r"``([\w./]+)``", re.sub(r"``[\w/]+\.py`` at ``\w+``", "", rows))
    scripts = re.findall(r'"(\w+)(?:, ``adjustment/test_table5``)?"$', rows, re.MULTILINE)
    names += [f"examples/papers/plot_adjustment_{script}.py" for script in scripts]
    assert len(scripts) == 6
    for name in names:
        if "/" in name:
            path = ROOT / (name if name.startswith(("tests/", "examples/")) else f"tests/{name}.py")
            assert path.is_file(), name
        else:
            room = "adjustment." if name.startswith("_memberships.") else ""
            home = "" if name.startswith("benchmarks.") else f"sklearn_mcmd.{room}"
            pkgutil.resolve_name(home + name)
    assert len(names) > 80


def test_the_tests_that_hold_the_promises_exist():
    rows = PAGES["promises"].read_text("utf-8").split("   * - **")[1:]
    named = [re.findall(r"``([\w/]+\.py)::(\w+)``", row) for row in rows]
    assert all(named)
    for path, test in (pair for row in named for pair in row):
        assert f"def {test}(" in (ROOT / "tests" / path).read_text("utf-8"), f"{path}::{test}"


@pytest.mark.parametrize("name", PAGES)
def test_pictures_have_words_for_those_who_do_not_see_them(name):
    text = PAGES[name].read_text("utf-8")
    for directive in re.finditer(
        r"^ *\.\. (?:image|figure):: .*\n((?: +:.*\n)*)", text, re.MULTILINE
    ):
        assert ":alt:" in directive[1], directive[0]
    assert text.count(":img-top:") == text.count(":img-alt:")


def test_pictures_of_the_guides_are_shown():
    shown = "".join(path.read_text("utf-8") for path in PAGES.values())
    pictures = {path.name for path in (ROOT / "docs" / "images" / "guide").iterdir()}
    assert {name for name in pictures if name not in shown} == set()
