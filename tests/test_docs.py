import importlib
import inspect
import pkgutil
import re
import sys
import zlib
from ast import literal_eval
from pathlib import Path

import pytest

import sklearn_mcmd

DOCS = Path(__file__).parent.parent / "docs"
COMMAND_LINE = {"cli"}
MODULES = [
    "sklearn_mcmd",
    *(
        f"sklearn_mcmd.{module.name}"
        for module in pkgutil.iter_modules(sklearn_mcmd.__path__)
        if not module.name.startswith("_") and module.name not in COMMAND_LINE
    ),
]


def documented():
    """What api.rst lists, as full names: rows of tables, and what a directive describes."""
    names, module = [], None
    for line in (DOCS / "api.rst").read_text().splitlines():
        if found := re.fullmatch(r"\.\. currentmodule:: (\S+)", line):
            module = found[1]
        elif found := re.fullmatch(r"(?:   |\.\. data:: )([A-Za-z]\w*)", line):
            names.append(f"{module}.{found[1]}")
    return names


@pytest.mark.parametrize("name", MODULES)
def test_every_public_name_has_a_page(name):
    pages = {id(pkgutil.resolve_name(page)) for page in documented()}
    module = importlib.import_module(name)
    public = set(module.__all__) - {"__version__"}
    assert {n for n in public if id(getattr(module, n)) not in pages} == set()


def test_only_public_names_have_pages():
    for page in documented():
        module, _, name = page.rpartition(".")
        assert name in importlib.import_module(module).__all__, page


def test_a_subpackage_with_pages_needs_no_import_of_its_own():
    homes = {page.split(".")[1] for page in documented() if page.count(".") == 2}
    assert homes <= sklearn_mcmd._ROOMS.keys() & set(dir(sklearn_mcmd))


def test_no_name_has_two_pages():
    assert len(documented()) == len(set(documented()))


def told_defaults(thing):
    """What the section of parameters says after "default=", by name."""
    document = inspect.getdoc(thing) or ""
    _, _, section = document.partition("Parameters\n----------\n")
    section = re.split(r"\n\w[\w ]*\n-{3,}\n", section)[0]
    for names, default in re.findall(r"^(\w[\w, ]*) : .*default=(.+)$", section, re.M):
        yield from ((name, default.strip("`")) for name in names.split(", "))


def test_defaults_are_those_that_are_documented():
    n_told = 0
    for page in documented():
        thing = pkgutil.resolve_name(page)
        for name, told in told_defaults(thing):
            if told not in ("{}", "inf"):  # made anew for each, and no literal
                default = inspect.signature(thing).parameters[name].default
                assert default == literal_eval(told), f"{page}: {name}"
                n_told += 1
    assert n_told > 150


@pytest.fixture
def inventories(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    yield importlib.import_module("offline_inventories")
    sys.modules.pop("offline_inventories", None)


def test_offline_links_name_their_page(inventories, tmp_path):
    # Sphinx itself puts the name only in place of a $ at the end of an address.
    for _, (_, file) in inventories.intersphinx_mapping(tmp_path).values():
        lines = zlib.decompress(Path(file).read_bytes().split(b"zlib.\n", 1)[1]).decode()
        assert "$" not in lines


def signatures():
    """Of public functions and classes, and of their methods."""
    for page in documented():
        thing = pkgutil.resolve_name(page)
        methods = inspect.getmembers(thing, inspect.isfunction) if inspect.isclass(thing) else []
        shown = [thing, *(method for name, method in methods if not name.startswith("_"))]
        if not (inspect.isclass(thing) and issubclass(thing, BaseException)):  # of C
            yield from ((page, inspect.signature(part)) for part in shown if callable(part))


def test_help_shows_names_of_types_and_not_what_they_stand_for():
    spelled = [page for page, signature in signatures() if "numpy._typing" in str(signature)]
    assert spelled == []
    assert len(list(signatures())) > 100
