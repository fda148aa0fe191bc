"""Libraries that are not installed with the package, and the words about them."""

import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from sklearn_mcmd._extras import how_to_install, import_extra

ASKED = [
    ("laspy", "las", "laspy"),
    ("lazrs", "las", "laspy"),
    ("plyfile", "formats", "plyfile"),
    ("pypcd4", "formats", "pypcd4"),
    ("pye57", "formats", "pye57"),
    ("matplotlib", "plot", "matplotlib"),
    ("typer", "cli", "typer"),
    ("rich", "cli", "typer"),
    ("distributed", "dask", "dask"),
]


@pytest.mark.parametrize(("library", "extra", "project"), ASKED)
def test_the_command_installs_what_pyproject_asks_for(library, extra, project):
    path = Path(__file__).parents[1] / "pyproject.toml"
    extras = tomllib.loads(path.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (wanted,) = [r for r in extras[extra] if re.match(r"[\w-]+", r)[0] == project]
    assert how_to_install(library, extra) == f'pip install "{wanted.partition(";")[0]}"'


def test_without_metadata_of_the_package_the_library_is_named(monkeypatch):
    def requires(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", requires)
    assert how_to_install("laspy", "las") == 'pip install "laspy"'


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
    assert str(error.value).startswith(f"This needs {absent}, which is not installed: pip install ")
