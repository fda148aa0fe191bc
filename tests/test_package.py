"""What tools read beside the code: the marker of type hints, metadata and workflows."""

import inspect
import json
import re
import tomllib
from importlib import import_module
from importlib.resources import files
from pathlib import Path

import pytest

import sklearn_mcmd

yaml = pytest.importorskip("yaml")  # dask has it

ROOT = Path(__file__).resolve().parents[1]


def test_type_checkers_are_told_to_read_the_hints():
    assert (files("sklearn_mcmd") / "py.typed").is_file()


@pytest.mark.parametrize("room", sorted(sklearn_mcmd._ROOMS.keys() - {"outliers"}))
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


def sections():
    """Versions and dates of the changelog."""
    return re.findall(r"^## (\S+), (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)


def released():
    """The version, or the last one that was released while the next one is made."""
    version = sklearn_mcmd.__version__
    if ".dev" in version:
        assert sections()[0] == (version, "unreleased")
        version = sections()[1][0]
    return version


@pytest.mark.parametrize(
    "name", ["CITATION.cff", "codemeta.json", ".zenodo.json", "recipe/recipe.yaml"]
)
def test_all_files_tell_the_same_of_the_package(name):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / name).read_text()
    assert project["license"] in text
    if name != "recipe/recipe.yaml":
        assert all(author["name"] in text for author in project["authors"])
    if name != ".zenodo.json":  # Zenodo knows version and repository by itself
        assert re.search(rf'version"?: "?{re.escape(released())}\b', text)
        assert project["urls"]["Source"] in text


def test_the_release_has_one_date_and_one_section_of_the_changelog():
    (date,) = (date for version, date in sections() if version == released())
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["version"] == released()
    assert date == str(cited.get("date-released", "unreleased"))
    meta = json.loads((ROOT / "codemeta.json").read_text())
    assert date == meta.get("datePublished", "unreleased")


def test_the_recipe_needs_what_the_package_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())
    run = {need.replace(" ", "") for need in recipe["requirements"]["run"]}
    assert project["requires-python"] == f">={recipe['context']['python_min']}"
    extras = project["optional-dependencies"]
    needed = project["dependencies"] + extras["cli"] + extras["las"]
    assert {need.replace("[lazrs]", "") for need in needed} <= run
    assert recipe["build"]["python"]["entry_points"] == [
        f"{name} = {call}" for name, call in project["scripts"].items()
    ]


@pytest.mark.parametrize("path", sorted((ROOT / ".github" / "workflows").glob("*.yml")))
def test_workflows_pin_actions_by_hash_and_begin_with_no_permission(path):
    text = path.read_text()
    used = re.findall(r"uses: (.*)", text)
    assert all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v[\d.]+", action) for action in used)
    assert yaml.safe_load(text)["permissions"] == {}
