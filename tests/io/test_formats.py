"""The table of formats: what it says holds, and every page that lists formats lists all of it."""

import inspect
import re
import sys
from importlib.metadata import metadata
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import (
    PointCloud,
    PointFileError,
    read_points,
    sensor_origins,
    write_points,
)
from sklearn_mcmd.io._formats import (
    ALL,
    FORMATS,
    SENSORS,
    WITH_COLUMNS,
    format_of,
    no_columns,
    supported_extensions,
)
from sklearn_mcmd.tiling import Catalog

for library in ("laspy", "lazrs", "plyfile", "pypcd4", "pye57"):
    pytest.importorskip(library)
ROOT = Path(__file__).parents[2]
WRITTEN = [one for one in FORMATS if one.write]
XYZ = np.diag([1.0, 2.0, 3.0])
EXTENSIONS = [extension for one in FORMATS for extension in one.extensions]


def ids(one):
    return one.name


def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


def in_one_line(text):
    return " ".join(text.split())


# ---- pages -----------------------------------------------------------------------------


def test_the_table_of_formats_has_a_row_of_each_and_no_other():
    any_row = r'^   "(``\..*)", "(.*)", "(.*)"\n'
    rows = re.findall(any_row, text_of("docs/command_line.rst"), re.M)
    rows = ["|".join(row).replace("`", "") for row in rows]
    assert rows == [f"{' '.join(f.extensions)}|{f.extra or 'none'}|{f.kept}" for f in FORMATS]


@pytest.mark.parametrize("one", FORMATS, ids=ids)
def test_the_page_of_extras_has_the_files_of_each_format(one):
    extra = f"``{one.extra}``" if one.extra else "none"
    row = re.search(rf"^{extra} .*", text_of("docs/install.rst"), re.M)[0]
    missing = [e for e in one.extensions if e not in re.split(r"[\s`,]+", row)]
    assert not missing, f"docs/install.rst: files of {extra} without {missing}"
    assert one.extra in [None, *metadata("sklearn-mcmd").get_all("Provides-Extra")]


def test_pages_list_who_has_columns_and_who_tells_the_sensor():
    page = in_one_line(text_of("docs/command_line.rst"))
    for text, words in [
        (page, SENSORS),
        (page, f"in {WITH_COLUMNS}:"),
        (in_one_line(inspect.getdoc(read_points)), f"columns of {WITH_COLUMNS} are"),
        (in_one_line(inspect.getdoc(sensor_origins)), SENSORS),
    ]:
        assert words in text, f"not listed: {words}"


# ---- what the records say --------------------------------------------------------------


def test_an_extension_belongs_to_one_format_and_the_longest_tells_it_in_any_case():
    assert sorted(EXTENSIONS) == [*supported_extensions()]
    assert all(extension == extension.lower() for extension in EXTENSIONS)
    names = [format_of(name).name for name in ("a.b.LAZ", "a.b.Copc.LAZ", "a.copc.las")]
    assert names == ["LAS and LAZ", "COPC", "LAS and LAZ"]


@pytest.mark.parametrize("one", [one for one in FORMATS if not one.write], ids=ids)
def test_what_is_only_read_says_so_and_stays(tmp_path, one):
    path = tmp_path / f"a{one.extensions[0]}"
    path.write_bytes(b"as it is")
    with pytest.raises(PointFileError, match=f"{one.name} can be read but not written; write an"):
        write_points(path, np.eye(3))
    assert path.read_bytes() == b"as it is"
    assert not set(one.extensions) & set(supported_extensions(written=True))


def written(tmp_path, one, cloud=XYZ, **options):
    path = tmp_path / f"a{one.extensions[-1]}"
    write_points(path, cloud, **options)
    return path


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_results_come_back_under_their_names_or_are_known_to_be_lost(tmp_path, one, cloud):
    if one.results == ALL:
        back = read_points(written(tmp_path, one, cloud)).attributes
        for name, values in cloud.attributes.items():
            assert_array_equal(back[name].astype(values.dtype), values, err_msg=name)
    else:
        with pytest.warns(UserWarning, match="not written: .*surface_variation"):
            written(tmp_path, one, PointCloud(cloud.xyz, {"surface_variation": cloud.xyz[:, 0]}))


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_outliers_have_a_mark_a_column_or_no_place(tmp_path, one):
    noise = np.array([False, True, False])
    if not (one.marks or one.results == ALL):
        with pytest.raises(PointFileError, match=f"{one.name} has no place to mark outliers"):
            written(tmp_path, one, noise=noise)
        assert not list(tmp_path.iterdir())
        return
    back = read_points(written(tmp_path, one, noise=noise)).attributes
    assert ("outlier" in back) != one.marks
    assert_array_equal(back["classification"] == 7 if one.marks else back["outlier"], noise)


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_columns_and_tiles_are_those_of_the_format(tmp_path, one):
    path, columns = written(tmp_path, one), {"x": 2, "y": 1, "z": 3}
    if one.columns:
        assert_array_equal(read_points(path, columns=columns).xyz, XYZ[:, [1, 0, 2]])
    else:
        with pytest.raises(PointFileError, match=re.escape(str(no_columns(columns)))):
            read_points(path, columns=columns)
    if one.tiles:
        assert Catalog(path).n_points == 3
    else:
        with pytest.raises(PointFileError, match="must be LAS or LAZ"):
            Catalog(path)


@pytest.mark.parametrize("one", WRITTEN, ids=ids)
def test_a_missing_library_is_named_with_its_command_and_others_need_none(
    tmp_path, one, monkeypatch
):
    path = written(tmp_path, one)
    before = path.read_bytes()
    for library in ("laspy", "lazrs", "plyfile", "pypcd4", "pye57"):
        monkeypatch.setitem(sys.modules, library, None)
    if one.extra is None:
        assert len(read_points(written(tmp_path, one))) == 3
        return
    message = rf"which is not installed: pip install \w+, or .* its extra \[{one.extra}\]"
    with pytest.raises(PointFileError, match=message):
        read_points(path)
    with pytest.raises(PointFileError, match=message):
        written(tmp_path, one)
    assert path.read_bytes() == before
