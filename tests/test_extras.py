"""Libraries that are not installed with the package, and the words about them."""

import sys
import tomllib
from pathlib import Path

import pytest

from sklearn_mcmd._extras import NEWEST, import_extra


def test_the_page_of_errors_has_these_words(monkeypatch):
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(ImportError) as error:
        import_extra("laspy", "las", "...")
    page = Path(__file__).resolve().parents[1] / "docs" / "install.rst"
    assert f"``{error.value}``" in page.read_text("utf-8")


def error_of(module, version, abi, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(sys, "version_info", version)
    monkeypatch.setattr(sys, "abiflags", abi, raising=False)
    with pytest.raises(ImportError) as error:
        import_extra(module, "las", "LAZ")
    return str(error.value)


@pytest.mark.parametrize(
    ("version", "abi", "told"), [((3, 15, 0), "", "3.15"), ((3, 14, 1), "t", "3.14t")]
)
def test_the_error_names_a_python_for_which_libraries_may_have_no_wheel(
    version, abi, told, monkeypatch
):
    for module in ("laspy", "lazrs", "pye57"):
        error = error_of(module, version, abi, monkeypatch)
        assert error.endswith(f"; it may have no wheel for Python {told} yet: take Python 3.14")


def test_the_error_says_nothing_of_wheels_where_all_are_there(monkeypatch):
    assert error_of("lazrs", (3, 14, 9), "", monkeypatch).endswith("with its extra [las]")


def test_all_extras_have_wheels_up_to_the_newest_python_of_the_metadata():
    path = Path(__file__).resolve().parents[1] / "pyproject.toml"
    if not path.is_file():
        pytest.skip("a checkout is needed")
    project = tomllib.loads(path.read_text())["project"]
    classifiers = [c for c in project["classifiers"] if "Python :: 3." in c]
    assert max(tuple(map(int, c.split(" :: ")[-1].split("."))) for c in classifiers) == NEWEST


@pytest.mark.parametrize(
    ("module", "extra", "absent"),
    [
        ("distributed", "dask", "dask"),
        ("matplotlib.figure", "plot", "PIL"),
        ("laspy", "las", "laspy"),
    ],
)
def test_the_error_names_what_is_missing_even_if_another_library_needs_it(
    module, extra, absent, tmp_path, monkeypatch
):
    package = tmp_path / module.split(".")[0]
    package.mkdir()
    package.joinpath("__init__.py").write_text(f"import {absent}")
    for name in [name for name in sys.modules if name.split(".")[0] == package.name]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, absent, None)
    with pytest.raises(ImportError) as error:
        import_extra(module, extra, "This")
    assert str(error.value) == (
        f"This needs {absent}, which is not installed: pip install {package.name}, or this "
        f"package with its extra [{extra}]"
    )
