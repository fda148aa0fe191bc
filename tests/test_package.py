"""What tools read beside the code: the marker of type hints and the citation."""

import inspect
import re
import tomllib
from importlib import import_module
from importlib.resources import files
from pathlib import Path

import pytest

import sklearn_mcmd

ROOT = Path(__file__).resolve().parents[1]


def test_type_checkers_are_told_to_read_the_hints():
    assert (files("sklearn_mcmd") / "py.typed").is_file()


@pytest.mark.parametrize("room", sorted(sklearn_mcmd._SUBPACKAGES - {"outliers"}))
def test_public_functions_have_type_hints(room):
    for function in public_functions(import_module(f"sklearn_mcmd.{room}")):
        names = {*inspect.signature(function).parameters, "return"} - {"self", "cls"}
        assert names == {*inspect.unwrap(function).__annotations__}, function.__qualname__


def public_functions(module):
    """Those in a module's `__all__`, and the public methods of classes there."""
    for name in module.__all__:
        value = getattr(module, name)
        if not inspect.isclass(value):
            yield value
            continue
        for method, function in inspect.getmembers(value, inspect.isfunction):
            ours = function.__module__.startswith("sklearn_mcmd.")
            if ours and (method == "__init__" or not method.startswith("_")):
                yield function


def test_the_citation_and_the_package_name_the_same_repository():
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]
    cited = re.search(r"^repository-code: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert cited[1] == urls["Source"]
