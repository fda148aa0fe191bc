"""mcmd segment: the estimator's labels as an attribute, regions as colors."""

import csv
import json

import numpy as np
import pytest

from commands import done, run
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.io import read_points, write_points


def expected_labels(xyz, **params):
    normals = RobustNormalEstimator(random_state=0)
    return RegionGrowing(normal_estimator=normals, **params).fit_predict(xyz)


@pytest.mark.parametrize("extension", ["laz", "csv", "npy"])
def test_segment_writes_the_estimators_labels(extension, room, room_file, tmp_path):
    path = tmp_path / f"out.{extension}"
    result = done("segment", room_file, path)
    out = read_points(path)
    labels = expected_labels(read_points(room_file).xyz)
    assert len(np.unique(labels)) > 1
    np.testing.assert_array_equal(out.attributes["region"], labels)
    np.testing.assert_array_equal(out.attributes["intensity"], np.arange(len(room)))
    sizes = np.bincount(labels[labels >= 0])
    rows = dict(line.split(maxsplit=1) for line in result.stdout.splitlines()[1:])
    assert (rows["points"], rows["regions"]) == (str(len(room)), str(len(sizes)))
    assert rows["inside"].startswith(f"{sizes.sum()} ")
    assert rows["largest"].split(", ")[0] == str(sizes[0])


def test_options_of_segment_reach_the_estimators(room, room_file, tmp_path):
    done(
        *("segment", room_file, tmp_path / "out.npy", "--max-angle", 7, "--max-distance", 0.003),
        *("--max-gap", 0.4, "--min-region-size", 30, "--no-refine"),
        *("--n-neighbors", 20, "--growth-neighbors", 16, "--max-outlier-rate", 0.3),
        *("--random-state", 4, "--n-jobs", 1),
    )
    growing = RegionGrowing(
        16,
        max_angle=7,
        max_distance=0.003,
        max_gap=0.4,
        min_region_size=30,
        refine=False,
        normal_estimator=RobustNormalEstimator(20, max_outlier_rate=0.3, random_state=4),
    )
    labels = growing.fit_predict(read_points(room_file).xyz)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy")["region"], labels)
    assert (labels != expected_labels(room.xyz)).any()


def test_a_table_of_regions_is_csv_and_geojson_in_the_coordinates_of_the_file(room, tmp_path):
    room.xyz[:] += [4e5, 5e6, 100.0]
    write_points(tmp_path / "in.laz", room)
    for name in ("regions.csv", "regions.geojson"):
        done("segment", tmp_path / "in.laz", tmp_path / "out.laz", "--regions", tmp_path / name)
    with open(tmp_path / "regions.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    labels = read_points(tmp_path / "out.laz").attributes["region"]
    assert [int(row["points"]) for row in rows] == np.bincount(labels[labels >= 0]).tolist()
    assert [row["radius"] for row in rows] == [""] * len(rows)  # of planes
    assert float(rows[0]["dip"]) < 1 < 89 < float(rows[1]["dip"])
    regions = json.loads((tmp_path / "regions.geojson").read_text(encoding="utf-8"))
    for row, feature in zip(rows, regions["features"], strict=True):
        assert feature["properties"]["points"] == int(row["points"])
        ring = np.array(feature["geometry"]["coordinates"][0])
        low, high = room.xyz.min(axis=0) - 0.02, room.xyz.max(axis=0) + 0.02
        assert ((low < ring) & (ring < high)).all()


@pytest.mark.parametrize(
    ("table", "words"),
    [("r.shp", "ends in .csv"), ("out.csv", "is IN"), ("no/r.csv", "does not exist")],
)
def test_tables_that_cannot_be_written_are_refused_first(table, words, room_file, tmp_path):
    out = tmp_path / "out.csv"
    result = run("segment", room_file, out, "--regions", tmp_path / table)
    assert result.exit_code != 0
    assert words in " ".join(result.output.replace("│", " ").split())
    assert not out.exists()
