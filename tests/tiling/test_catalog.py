"""Catalogs know what files hold, and refuse what cannot be one cloud."""

import json

import laspy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.io import PointFileError, write_points
from sklearn_mcmd.tiling import Catalog

WKT = 'LOCAL_CS["{}",UNIT["metre",1]]'


def write(path, n=5, crs=None, point_format=6, first=0):
    header = laspy.LasHeader(version="1.4", point_format=point_format)
    header.scales = [0.01] * 3
    if crs is not None:
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(WKT.format(crs)))
    las = laspy.LasData(header)
    las.x = las.y = las.z = np.arange(first, first + n, dtype=float)
    las.write(path)
    return path


def test_a_folder_is_all_its_las_and_laz_in_the_order_of_names(tmp_path):
    for name, n in {"b.laz": 4, "a.LAS": 3, "c.copc.laz": 2}.items():
        write(tmp_path / name, n, "site")
    (tmp_path / "notes.txt").write_text("of others")
    catalog = Catalog(tmp_path)
    assert [path.name for path in catalog.paths] == ["a.LAS", "b.laz", "c.copc.laz"]
    assert catalog.counts == [3, 4, 2]
    assert (catalog.n_points, len(catalog), catalog.crs) == (9, 3, "site")
    assert catalog.record_sizes == [30, 30, 30]
    assert_allclose([catalog.low, catalog.high], [[0] * 3, [3] * 3])
    assert repr(catalog) == "Catalog(3 files, 9 points)"


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("a.las", lambda _: b"", r"a\.las: is empty \(0 bytes\)"),
        ("a.laz", lambda _: b"x" * 999, r"a\.laz: not a LAS/LAZ file"),
        ("a.las", lambda content: content[:-30], r"a\.las: truncated"),
        ("a.ply", lambda content: content, r"a\.ply: .* must be LAS or LAZ"),
        ("a.las", None, r"a\.las: no such file"),
    ],
)
def test_what_is_no_whole_las_is_named(tmp_path, name, change, message):
    good = write(tmp_path / "good.las", 50)
    if change is not None:
        (tmp_path / name).write_bytes(change(good.read_bytes()))
    with pytest.raises(PointFileError, match=message):
        Catalog([good, tmp_path / name])


def test_a_file_or_a_folder_without_points_is_refused(tmp_path):
    with pytest.raises(PointFileError, match=r"a\.las: holds no points"):
        Catalog(write(tmp_path / "a.las", 0))
    with pytest.raises(PointFileError, match=r"a\.las: holds no points; leave it out"):
        Catalog([write(tmp_path / "b.las"), tmp_path / "a.las"])
    (tmp_path / "b.las").unlink()
    (tmp_path / "a.las").rename(tmp_path / "a.xyz")
    with pytest.raises(PointFileError, match=r"without \.las or \.laz"):
        Catalog(tmp_path)
    with pytest.raises(PointFileError, match="no files"):
        Catalog([])


@pytest.mark.parametrize("crs", ["another site", None])
def test_different_coordinate_systems_are_refused(tmp_path, crs):
    paths = [write(tmp_path / "a.las", crs="site"), write(tmp_path / "b.las", crs=crs)]
    with pytest.raises(
        PointFileError, match=rf"b\.las: .* \({crs or 'no system'}\).*a\.las \(site"
    ):
        Catalog(paths)


def index_of(path, *links):
    """A virtual point cloud, as QGIS makes it."""
    overview = {"href": "no.laz", "roles": ["overview"]}
    features = [
        {"type": "Feature", "assets": {"overview": overview, "data": {"href": link}}}
        for link in links
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_an_index_names_files_relative_to_itself(tmp_path):
    (tmp_path / "x").mkdir()
    paths = [write(tmp_path / name) for name in ("b.las", "x/a b.laz", "c.las", "x/b.las")]
    links = ("./b.las", "x/a%20b.laz", paths[2].as_uri(), str(paths[3]))
    catalog = Catalog(index_of(tmp_path / "all.vpc", *links))
    assert [path.resolve() for path in catalog.paths] == paths
    assert catalog.is_many
    assert Catalog(index_of(tmp_path / "one.vpc", "b.las")).is_many
    assert not Catalog(paths[0]).is_many


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        ("{", "is not an index"),
        ('{"features": 5}', "is not an index"),
        ('{"features": [{"assets": {}}]}', "is not an index"),
        ('{"features": []}', "without files"),
        ('{"features": [{"assets": {"data": {"href": "https://x.org/a.laz"}}}]}', "download it"),
        ('{"features": [{"assets": {"any": {"href": "gone.laz"}}}]}', "no such file"),
    ],
)
def test_an_index_that_is_none_is_named(tmp_path, content, message):
    (tmp_path / "all.vpc").write_text(content)
    with pytest.raises(PointFileError, match=rf"(all\.vpc|gone\.laz): .*{message}"):
        Catalog(tmp_path / "all.vpc")


def test_degrees_beside_meters_are_warned_of(tmp_path):
    xyz = np.array([[13.4, 52.5, 40], [13.41, 52.51, 60]])
    write_points(tmp_path / "a.las", xyz)
    with pytest.warns(UserWarning, match="a.las: x and y seem to be degrees"):
        Catalog(tmp_path)
