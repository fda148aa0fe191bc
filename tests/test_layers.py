"""Who imports whom: arrows go one way, and nothing heavy comes with the package."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import sklearn_mcmd

ROOT = Path(sklearn_mcmd.__file__).parent
LAYERS = {  # a module imports only from lower layers, or from its own
    "_extras": 0,
    "_progress": 0,
    "_plane": 0,
    "_plane_numba": 0,
    "_orientation": 0,
    "_neighborhoods": 0,
    "_resolution": 0,
    "_chunks": 1,
    "_consistent_set": 1,
    "_consistent_set_numba": 2,
    "_adaptive_trials": 2,
    "_adaptive_trials_numba": 3,
    "baselines": 2,
    "_rules": 2,
    "_rules_numba": 3,
    "_local_planes": 4,
    "_borrowing": 4,
    "_borrowing_numba": 4,
    "_smoothness": 4,
    "_smoothness_numba": 4,
    "_surface_planes": 5,
    "_judging": 4,
    "_judging_numba": 4,
    "_density": 4,
    "_density_numba": 4,
    "_iteration": 5,
    "_calibration": 5,
    "_base": 5,
    "_segment_search": 6,
    "model_selection": 6,
    "_features": 5,
    "baselines._detector": 6,
    "_creases": 5,
    "_mcmd": 6,
    "_normals": 6,
    "_edges": 7,
    "resampling": 7,
    "adjustment": 6,
    "_region_graph": 2,
    "_region_claims": 1,
    "_region_joining": 1,
    "_cylinder": 0,
    "_cylinder_numba": 0,
    "_region_rest": 3,
    "_region_cylinders": 3,
    "_region_growing_numba": 2,
    "_region_growing": 7,
    "plotting": 7,
    "_file_summary": 7,
    "_demo": 8,
    "cli": 9,
    "paper": 9,
    "__main__": 10,
}
APART = {"datasets", "io", "metrics"}  # import no estimator


def imports_of(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
            if node.module == "sklearn_mcmd":
                names = [f"sklearn_mcmd.{alias.name}" for alias in node.names]
            names = [name.split(".")[1] for name in names if name.startswith("sklearn_mcmd.")]
            yield from (name for name in names if name != "__version__")


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_downward(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    module = ".".join(parts) if ".".join(parts) in LAYERS else parts[0]
    if module == "__init__" or parts == ("baselines", "__init__"):
        return
    for imported in imports_of(path):
        if imported[0].isupper():  # an estimator, from the package itself
            assert module in {"plotting", "cli", "_demo"}
        elif module in APART:
            assert imported in APART | {"_base", "_extras"}, f"{module} imports {imported}"
        elif imported not in APART:
            assert LAYERS[imported] <= LAYERS[module], f"{module} imports {imported}"


def test_importing_the_package_loads_nothing_heavy():
    statement = "import sys, sklearn_mcmd; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", statement], capture_output=True, text=True, check=True
    ).stdout.split()
    heavy = {"numba", "matplotlib", "laspy", "pandas", "typer", "scipy.stats"}
    assert not heavy & set(loaded) - _loaded_by_scikit_learn()


def _loaded_by_scikit_learn():
    statement = "import sys, sklearn.neighbors; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", statement], capture_output=True, text=True)
    return set(result.stdout.split())


def test_private_scikit_learn_is_touched_in_one_file_only():
    private = ("from sklearn.utils._param_validation", "import _fit_context")
    for path in ROOT.rglob("*.py"):
        if path.name != "_base.py":
            text = path.read_text(encoding="utf-8")
            assert not any(statement in text for statement in private), path.name
