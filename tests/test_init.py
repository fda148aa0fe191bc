"""The public names: there as if imported, and imported when first asked for."""

import ast
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import sklearn_mcmd


def python(statement):
    command = [sys.executable, "-c", statement]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()


def test_importing_the_package_imports_none_of_its_dependencies():
    loaded = python("import sys, sklearn_mcmd; print(*sys.modules)")
    assert not {"numpy", "scipy", "sklearn", "joblib", "numba"} & set(loaded)
    assert not {"laspy", "matplotlib", "pandas", "typer"} & set(loaded)


def test_names_are_found_where_nothing_was_imported_before():
    """Of an estimator that is unpickled, then of a subpackage, then all by a star."""
    pickled = pickle.dumps(sklearn_mcmd.MCMDOutlierDetector(n_neighbors=33))
    neighbors, subpackage, *names = python(
        f"import pickle; print(pickle.loads({pickled!r}).n_neighbors)\n"
        "import sklearn_mcmd; print(sklearn_mcmd.tiling.__name__)\n"
        "from sklearn_mcmd import *; print(*dir())"
    )
    assert (neighbors, subpackage) == ("33", "sklearn_mcmd.tiling")
    assert set(sklearn_mcmd.__all__) <= set(names) & set(dir(sklearn_mcmd))


def test_type_checkers_see_the_names_that_users_see():
    tree = ast.parse(Path(sklearn_mcmd.__file__).read_text(encoding="utf-8"))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    homes = {alias.asname: node.module for node in imported for alias in node.names}
    assert {name: f"sklearn_mcmd.{room}" for name, room in sklearn_mcmd._HOMES.items()} == {
        name: home for name, home in homes.items() if name
    }
    assert set(dir(sklearn_mcmd)) == {*sklearn_mcmd.__all__, *sklearn_mcmd._ROOMS}


def test_an_unknown_name_is_an_attribute_error_that_names_it():
    with pytest.raises(AttributeError, match="no attribute 'RobustPlane'"):
        sklearn_mcmd.RobustPlane  # noqa: B018
