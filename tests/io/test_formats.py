"""The table of formats: what it says holds, and every page that lists formats lists all of it."""

import inspect
import re
from importlib.metadata import metadata
from pathlib import Path

import numpy as np
import pytest

import sklearn_mcmd.io
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.io._formats import (
    ALL,
    FORMATS,
    SENSORS,
    TILED,
    TILED_NAMES,
    WITH_COLUMNS,
    format_of,
    listed,
    no_columns,
    supported_extensions,
)
from sklearn_mcmd.tiling import Catalog

ROOT = Path(__file__).parents[2]
# XYZN and XYZRGB say so where they have nothing but coordinates.
pytestmark = pytest.mark.filterwarnings("ignore:.*few programs read")
WRITTEN = [one for one in FORMATS if one.write]
EXTENSIONS = [extension for one in FORMATS for extension in one.extensions]


def ids(one):
    return one.name


def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


def in_one_line(text):
    return " ".join(text.split())


# ---- pages -----------------------------------------------------------------------------


def readme_row(one):
    names = " ".join(f"`{extension}`" for extension in one.extensions)
    return f"| {names} | {f'`[{one.extra}]`' if one.extra else 'none'} | {one.kept} |"


def page_row(one):
    names = " ".join(f"``{extension}``" for extension in one.extensions)
    return (
        f"   * - {names}\n     - {f'``{one.extra}``' if one.extra else 'none'}\n     - {one.kept}\n"
    )


@pytest.mark.parametrize("one", FORMATS, ids=ids)
@pytest.mark.parametrize(
    ("page", "row"), [("README.md", readme_row), ("docs/command_line.rst", page_row)]
)
def test_the_tables_of_formats_have_a_row_of_each(page, row, one):
    assert row(one) in text_of(page), f"{page} has no row:\n{row(one)}"


def test_the_tables_of_formats_have_no_other_rows():
    rows = re.findall(r"^\| `\..*\|$", text_of("README.md"), re.M)
    assert rows == [readme_row(one) for one in FORMATS]
    rows = re.findall(
        r"^   \* - ``\..*\n     - .*\n     - .*\n", text_of("docs/command_line.rst"), re.M
    )
    assert rows == [page_row(one) for one in FORMATS]


@pytest.mark.parametrize("one", FORMATS, ids=ids)
def test_the_page_of_extras_has_the_files_of_each_format(one):
    extra = f"``{one.extra}``" if one.extra else "none"
    row = re.search(rf"^{extra} .*", text_of("docs/install.rst"), re.M)[0]
    missing = [e for e in one.extensions if e not in re.split(r"[\s`,]+", row)]
    assert not missing, f"docs/install.rst: files of {extra} without {missing}"
    assert one.extra in [None, *metadata("sklearn-mcmd").get_all("Provides-Extra")]


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_the_changelog_names_each_format(extension):
    name = extension.split(".")[1].upper()
    assert re.search(rf"\b{name}\b", text_of("CHANGELOG.md")), f"CHANGELOG.md does not name {name}"


@pytest.mark.parametrize("one", [one for one in FORMATS if one.sensor], ids=ids)
def test_the_page_of_the_sensor_has_a_row_of_each_format_that_tells_it(one):
    table = text_of("docs/sensor.rst").partition("When is it known?")[2]
    names = re.split("'s| and ", f"{one.sensor} ")[0]
    assert re.search(rf"^(\w+, )*{names}\b", table, re.M), f"docs/sensor.rst: no row of {names}"


@pytest.mark.parametrize("page", ["docs/command_line.rst"])
def test_the_page_of_the_command_line_lists_who_tells_the_sensor_and_has_columns(page):
    text = in_one_line(text_of(page))
    assert SENSORS in text, f"{page} does not list: {SENSORS}"
    assert f"in {WITH_COLUMNS}:" in text, f"{page} does not list: {WITH_COLUMNS}"


def test_docstrings_list_who_has_columns_and_who_tells_the_sensor():
    assert f"columns of {WITH_COLUMNS} are" in in_one_line(inspect.getdoc(read_points))
    assert SENSORS in in_one_line(inspect.getdoc(sklearn_mcmd.io.sensor_origins))


@pytest.mark.parametrize("verb", ["denoise", "normals", "segment", "edges", "plane"])
def test_the_help_of_verbs_names_the_formats_that_are_divided_into_tiles(verb):
    module = pytest.importorskip(f"sklearn_mcmd.cli._{verb}")
    told = in_one_line(inspect.getdoc(getattr(module, verb)))
    assert f"{TILED_NAMES} that need more than --memory" in told or verb == "plane"
    assert f"ends in {listed(TILED, 'or')} gets all" in told


# ---- what the records say --------------------------------------------------------------


def test_an_extension_belongs_to_one_format():
    assert len(EXTENSIONS) == len(set(EXTENSIONS))
    assert all(extension == extension.lower() for extension in EXTENSIONS)
    assert sorted(EXTENSIONS) == [*supported_extensions()]


def test_the_longest_extension_in_any_case_tells_the_format():
    assert format_of("a.b.LAZ").name == "LAS and LAZ"
    assert format_of("a.b.Copc.LAZ").name == "COPC"
    assert format_of("a.copc.las").name == "LAS and LAZ"


@pytest.mark.parametrize("one", [one for one in FORMATS if not one.write], ids=ids)
def test_what_is_only_read_says_so_and_stays(tmp_path, one):
    path = tmp_path / f"a{one.extensions[0]}"
    path.write_bytes(b"as it is")
    with pytest.raises(PointFileError, match=f"{one.name} can be read but not written; write an"):
        write_points(path, np.eye(3))
    assert path.read_bytes() == b"as it is"
    assert not set(one.extensions) & set(supported_extensions(written=True))


def written(tmp_path, one, cloud, **options):
    if one.extra:
        pytest.importorskip(
            {"PLY": "plyfile", "PCD": "pypcd4", "E57": "pye57"}.get(one.name, "lazrs")
        )
    path = tmp_path / f"a{one.extensions[-1]}"
    write_points(path, cloud, **options)
    return path


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_formats_hold_any_attribute_or_are_known_not_to(tmp_path, one):
    cloud = PointCloud(np.eye(3), {"score": np.arange(3) / 8})
    if one.results == ALL:
        assert "score" in read_points(written(tmp_path, one, cloud)).attributes
    else:
        with pytest.warns(UserWarning, match="not written: score"):
            written(tmp_path, one, cloud)


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_outliers_have_a_mark_a_column_or_no_place(tmp_path, one):
    noise = np.array([False, True, False])
    if not (one.marks or one.results == ALL):
        with pytest.raises(PointFileError, match=f"{one.name} has no place to mark outliers"):
            written(tmp_path, one, np.eye(3), noise=noise)
        return
    found = read_points(written(tmp_path, one, np.eye(3), noise=noise)).attributes
    assert ("outlier" in found) != one.marks
    assert np.array_equal(found["classification"] == 7 if one.marks else found["outlier"], noise)


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_columns_are_told_of_formats_that_have_them(tmp_path, one):
    path, columns = written(tmp_path, one, np.diag([1.0, 2.0, 3.0])), {"x": 2, "y": 1, "z": 3}
    if one.columns:
        assert np.array_equal(read_points(path, columns=columns).xyz[:, 0], [0, 2, 0])
    else:
        with pytest.raises(PointFileError, match=re.escape(str(no_columns(columns)))):
            read_points(path, columns=columns)


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_encodings_are_those_of_the_format(tmp_path, one):
    for encoding in one.encodings:
        assert len(read_points(written(tmp_path, one, np.eye(3), encoding=encoding))) == 3
    known = ", ".join(one.encodings) or "only None"
    with pytest.raises(ValueError, match=f"known: {known}"):
        written(tmp_path, one, np.eye(3), encoding="no such")


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_clouds_larger_than_memory_are_of_the_formats_that_are_divided(tmp_path, one):
    path = written(tmp_path, one, np.eye(3))
    if one.tiles:
        assert Catalog(path).n_points == 3
    else:
        with pytest.raises(PointFileError, match="must be LAS or LAZ"):
            Catalog(path)


@pytest.mark.parametrize("one", [one for one in WRITTEN if one.extra is None], ids=ids)
def test_formats_without_an_extra_need_no_library(tmp_path, one, monkeypatch):
    monkeypatch.setattr("sklearn_mcmd._extras.importlib.import_module", None)
    assert len(read_points(written(tmp_path, one, np.eye(3)))) == 3
