"""Catalogs know what files hold, and refuse what cannot be one cloud."""

import json

import laspy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.io import PointFileError, write_points
from sklearn_mcmd.tiling import Catalog

WKT = 'LOCAL_CS["{}",UNIT["metre",1]]'


def write(path, n=5, crs=None):
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = [0.01] * 3
    if crs is not None:
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(WKT.format(crs)))
    las = laspy.LasData(header)
    las.x = las.y = las.z = np.arange(n, dtype=float)
    las.write(path)
    return path


def test_a_folder_is_all_its_las_and_laz_in_the_order_of_names(tmp_path):
    for name, n in {"b.laz": 4, "a.LAS": 3, "c.copc.laz": 2}.items():
        write(tmp_path / name, n, "site")
    (tmp_path / "notes.txt").write_text("of others")
    catalog = Catalog(tmp_path)
    assert [path.name for path in catalog.paths] == ["a.LAS", "b.laz", "c.copc.laz"]
    assert (catalog.counts, catalog.record_sizes) == ([3, 4, 2], [30, 30, 30])
    assert (catalog.n_points, len(catalog), catalog.crs) == (9, 3, "site")
    assert_allclose([catalog.low, catalog.high], [[0] * 3, [3] * 3])
    assert repr(catalog) == "Catalog(3 files, 9 points)"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.las", b"", r"is empty \(0 bytes\)"),
        ("a.laz", b"x" * 999, "not a LAS/LAZ file"),
        ("a.las", slice(-30), "truncated"),
        ("a.ply", slice(None), "must be LAS or LAZ"),
        ("a.las", None, "no such file"),
        ("a.las", 0, "holds no points; leave it out"),
        ("a.vpc", b"", "is empty"),
        ("a.vpc", b"{", "is not an index"),
        ("a.vpc", b'{"features": 5}', "is not an index"),
        ("a.vpc", b'{"features": [{"assets": {}}]}', "is not an index"),
        ("a.vpc", b'{"features": []}', "without files"),
        ("a.vpc", b'{"features": [{"assets": {"data": {"href": "ht://x.y/a"}}}]}', "download it"),
        ("a.vpc", b'{"features": [{"assets": {"any": {"href": "a.laz"}}}]}', "no such file"),
    ],
)
def test_what_is_no_whole_las_and_no_index_is_named(tmp_path, name, content, message):
    path, good = tmp_path / name, write(tmp_path / "good.las", 50)
    if content == 0:
        write(path, 0)
    elif content is not None:
        path.write_bytes(good.read_bytes()[content] if isinstance(content, slice) else content)
    with pytest.raises(PointFileError, match=rf"{path.stem}\.\w+: .*{message}"):
        Catalog(path if path.suffix == ".vpc" else [good, path])


def test_nothing_a_folder_of_other_files_and_a_file_without_points_are_refused(tmp_path):
    (tmp_path / "a.xyz").touch()
    with pytest.raises(PointFileError, match="no files"):
        Catalog([])
    with pytest.raises(PointFileError, match=r"without \.las or \.laz"):
        Catalog(tmp_path)
    with pytest.raises(PointFileError, match=r"a\.las: holds no points$"):
        Catalog(write(tmp_path / "a.las", 0))


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
    assets = [{"overview": overview, "data": {"href": link}} for link in links]
    features = [{"type": "Feature", "assets": asset} for asset in assets]
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


def test_degrees_beside_meters_are_warned_of(tmp_path):
    xyz = np.array([[13.4, 52.5, 40], [13.41, 52.51, 60]])
    write_points(tmp_path / "a.las", xyz)
    with pytest.warns(UserWarning, match="a.las: x and y seem to be degrees"):
        Catalog(tmp_path)
