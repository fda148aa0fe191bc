"""Libraries that are not installed with the package, and the words about them."""

import sys
from pathlib import Path

import pytest

from sklearn_mcmd._extras import import_extra


def test_the_page_of_errors_has_these_words(monkeypatch):
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(ImportError) as error:
        import_extra("laspy", "las", "...")
    page = Path(__file__).resolve().parents[1] / "docs" / "install.rst"
    assert f"``{error.value}``" in page.read_text("utf-8")


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
