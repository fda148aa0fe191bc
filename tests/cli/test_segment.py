"""mcmd segment: the estimator's labels as an attribute, regions as colors."""

import csv
import json

import numpy as np
import pytest

from commands import run
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.plotting import region_colors

COLORS = ("red", "green", "blue")


@pytest.fixture
def room():
    """A floor and a wall, few enough for the form that needs no compilation."""
    rng = np.random.default_rng(0)
    floor = rng.uniform(0, 2, (500, 3)) * [1, 1, 0]
    wall = rng.uniform(0, 2, (400, 3)) * [1, 0, 1] + [0, 2, 0]
    xyz = np.vstack([floor, wall]) + rng.normal(0, 0.003, (900, 3))
    return PointCloud(np.round(xyz, 4), {"intensity": np.arange(900, dtype=np.uint16)})


def expected_labels(xyz, **params):
    normals = RobustNormalEstimator(random_state=0)
    return RegionGrowing(normal_estimator=normals, **params).fit_predict(xyz)


@pytest.mark.parametrize("extension", ["laz", "csv", "npy"])
def test_segment_writes_the_estimators_labels(extension, room, room_file, tmp_path):
    path = tmp_path / f"out.{extension}"
    result = run("segment", room_file, path)
    assert result.exit_code == 0, result.output
    out = read_points(path)
    labels = expected_labels(read_points(room_file).xyz)
    assert len(np.unique(labels)) > 1
    np.testing.assert_array_equal(out.attributes["region"], labels)
    np.testing.assert_array_equal(out.attributes["intensity"], np.arange(900))


def test_each_region_has_its_color(room_file, tmp_path):
    assert run("segment", room_file, tmp_path / "out.npz").exit_code == 0
    out = read_points(tmp_path / "out.npz").attributes
    written = np.column_stack([out[name] for name in COLORS])
    expected = np.rint(255 * region_colors(out["region"]))
    assert written.dtype == np.uint8
    np.testing.assert_array_equal(written, expected)
    assert len(np.unique(written, axis=0)) == len(np.unique(out["region"]))


def test_las_without_a_place_for_colors_gets_one(room_file, tmp_path):
    laspy = pytest.importorskip("laspy")
    assert laspy.read(room_file).point_format.id == 6
    assert run("segment", room_file, tmp_path / "out.laz").exit_code == 0
    las = laspy.read(tmp_path / "out.laz")
    assert las.point_format.id == 7
    assert {*COLORS, "region"} <= set(las.point_format.dimension_names)
    assert las.red.max() > 255
    np.testing.assert_array_equal(las.X, laspy.read(room_file).X)


def test_colors_of_the_input_stay_unless_region_colors_are_asked_for(room, tmp_path):
    gray = np.full(len(room), 77, dtype=np.uint8)
    write_points(tmp_path / "in.npz", room.with_attributes(**dict.fromkeys(COLORS, gray)))
    for options, same in (((), True), (("--colors",), False)):
        assert run("segment", tmp_path / "in.npz", tmp_path / "out.npz", *options).exit_code == 0
        out = read_points(tmp_path / "out.npz").attributes
        assert bool((out["red"] == 77).all()) is same


def test_without_colors_only_the_labels_are_added(room_file, tmp_path):
    assert run("segment", room_file, tmp_path / "out.csv", "--no-colors").exit_code == 0
    assert not read_points(tmp_path / "out.csv").attributes.keys() & set(COLORS)


def test_options_of_segment_reach_the_estimators(room, room_file, tmp_path):
    result = run(
        *("segment", room_file, tmp_path / "out.npy", "--max-angle", 7, "--max-distance", 0.003),
        *("--max-gap", 0.4, "--min-region-size", 30, "--no-refine"),
        *("--n-neighbors", 20, "--growth-neighbors", 16, "--max-outlier-rate", 0.3),
        *("--random-state", 4, "--n-jobs", 1),
    )
    assert result.exit_code == 0, result.output
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


def test_the_summary_states_regions_and_the_largest(room, room_file, tmp_path):
    result = run("segment", room_file, tmp_path / "out.laz")
    rows = dict(line.split(maxsplit=1) for line in result.stdout.splitlines()[1:])
    labels = expected_labels(read_points(room_file).xyz)
    sizes = np.bincount(labels[labels >= 0])
    assert rows["points"] == "900"
    assert rows["regions"] == str(len(sizes))
    assert rows["inside"].startswith(f"{sizes.sum()} ")
    assert rows["largest"].split(", ")[0] == str(sizes[0])
    assert result.stderr == ""


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(room_file, tmp_path):
    for name, n_jobs in (("a", 1), ("b", 2)):
        run("segment", room_file, tmp_path / f"{name}.csv", "--n-jobs", n_jobs)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_output_may_replace_the_input(room_file):
    assert run("segment", room_file, room_file).exit_code == 0
    assert "region" in read_points(room_file).attributes


@pytest.mark.parametrize(
    "options", [("--max-angle", 0), ("--max-angle", 91), ("--max-gap", -1), ("--max-distance", 0)]
)
def test_thresholds_out_of_range_are_wrong_usage(options, room_file, tmp_path):
    result = run("segment", room_file, tmp_path / "out.laz", *options)
    assert result.exit_code == 2
    assert not (tmp_path / "out.laz").exists()


def test_too_few_points_fail_in_one_line(tmp_path):
    write_points(tmp_path / "few.csv", np.eye(3))
    result = run("segment", tmp_path / "few.csv", tmp_path / "out.csv")
    assert result.exit_code == 1
    assert "3 points is too few for planes" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_table_of_regions_is_csv_and_geojson_in_the_coordinates_of_the_file(room, tmp_path):
    room.xyz[:] += [4e5, 5e6, 100.0]
    write_points(tmp_path / "in.laz", room)
    for name in ("regions.csv", "regions.geojson"):
        result = run(
            "segment", tmp_path / "in.laz", tmp_path / "out.laz", "--regions", tmp_path / name
        )
        assert result.exit_code == 0, result.output
    with open(tmp_path / "regions.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    labels = read_points(tmp_path / "out.laz").attributes["region"]
    assert [int(row["points"]) for row in rows] == np.bincount(labels[labels >= 0]).tolist()
    assert {row["kind"] for row in rows} == {"plane"}
    assert rows[0]["radius"] == ""
    assert float(rows[0]["dip"]) < 1
    assert 89 < float(rows[1]["dip"]) <= 90
    found = json.loads((tmp_path / "regions.geojson").read_text(encoding="utf-8"))
    assert found["type"] == "FeatureCollection"
    for row, feature in zip(rows, found["features"], strict=True):
        assert feature["properties"]["points"] == int(row["points"])
        assert feature["properties"]["radius"] is None
        ring = np.array(feature["geometry"]["coordinates"][0])
        np.testing.assert_array_equal(ring[0], ring[-1])
        low, high = room.xyz.min(axis=0) - 0.02, room.xyz.max(axis=0) + 0.02
        assert ((low < ring) & (ring < high)).all()
    np.testing.assert_allclose(found["features"][0]["properties"]["area"], 4, rtol=0.1)


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


def test_an_existing_table_is_kept_if_asked(room_file, tmp_path):
    (tmp_path / "r.csv").write_text("mine")
    options = ("--regions", tmp_path / "r.csv", "--no-clobber")
    assert run("segment", room_file, tmp_path / "out.csv", *options).exit_code != 0
    assert (tmp_path / "r.csv").read_text() == "mine"
