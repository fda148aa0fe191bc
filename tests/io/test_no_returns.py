"""Rows of zeros amid large coordinates are named wherever files are read."""

import warnings

import numpy as np
import pytest

from sklearn_mcmd.io import read_points, write_points
from sklearn_mcmd.io._formats import supported_extensions
from sklearn_mcmd.io._no_returns import NoReturns

CORNER = np.array([500_000, 200_000, 100])
SURVEY = CORNER + np.round(np.random.default_rng(0).uniform(0, 20, (30, 3)), 2)
HOLED = np.insert(SURVEY, [7, 7, 20], 0, axis=0)


@pytest.mark.filterwarnings("ignore:.*there are none, and few programs")
@pytest.mark.parametrize("extension", supported_extensions(written=True))
def test_every_format_says_how_many_and_the_first(tmp_path, extension):
    libraries = {".e57": "pye57", ".pcd": "pypcd4", ".ply": "plyfile"}
    pytest.importorskip(libraries.get(extension, "laspy"))
    write_points(tmp_path / f"a{extension}", HOLED)
    with pytest.warns(UserWarning, match="3 of 33 points are 0, 0, 0 .* is point 8: ") as told:
        cloud = read_points(tmp_path / f"a{extension}")
    assert len(cloud) == 33
    assert told[0].filename == __file__


def test_parts_tell_what_the_whole_tells():
    whole, parts = NoReturns().add(HOLED), NoReturns()
    for start in range(0, 33, 8):  # the zeros of row 8 begin a part
        parts.add(HOLED[start : start + 8])
    assert parts.warning("a.las") == whole.warning("a.las")


@pytest.mark.parametrize("shift", [[0, 0, 0], [90_000, 0, 0]])
def test_an_origin_among_smaller_coordinates_is_a_point(tmp_path, shift):
    xyz = np.r_[SURVEY - CORNER + shift, [[0, 0, 0]]]
    np.save(tmp_path / "a.npy", xyz)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_points(tmp_path / "a.npy")
