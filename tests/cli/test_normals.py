"""mcmd normals: the estimator's normals and features as attributes."""

import re

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.io import PointCloud, read_points, write_points

CURVED = ["mean_curvature", "max_curvature_direction"]


@pytest.mark.parametrize(
    ("suffix", "options", "parameters"),
    [
        ("laz", (), {}),
        ("laz", ("--n-neighbors", "auto"), {"n_neighbors": "auto"}),
        ("ply", ("--features", ",".join(CURVED)), {"features": CURVED}),
    ],
)
def test_columns_are_the_estimators_results_as_float32(
    suffix, options, parameters, room, room_file, tmp_path
):
    done("normals", room_file, tmp_path / f"out.{suffix}", *options)
    out = read_points(tmp_path / f"out.{suffix}").attributes
    fitted = RobustNormalEstimator(random_state=0, **parameters).fit(read_points(room_file).xyz)
    expected = {
        "surface_variation": fitted.surface_variation_,
        "removed_fraction": fitted.removed_fraction_,
        **{f"normal_{a}": fitted.normals_[:, i] for i, a in enumerate("xyz")},
        **{f"eigenvalue_{i}": fitted.eigenvalues_[:, i] for i in range(3)},
    }
    if "features" in parameters:
        names = ["mean_curvature", *(f"max_curvature_direction_{axis}" for axis in "xyz")]
        expected |= dict(zip(names, fitted.features_.T, strict=True))
    if "n_neighbors" in parameters:
        expected["n_neighbors"] = fitted.n_neighbors_
    for name, values in expected.items():
        assert out[name].dtype == np.float32
        np.testing.assert_array_equal(out[name], values.astype(np.float32))
    np.testing.assert_array_equal(out["intensity"], np.arange(len(room)))


def test_normals_look_at_where_a_trajectory_says(room, tmp_path):
    path = np.array([[0.0, 5, 5, 9], [1, -5, -5, -9]])  # time, x, y, z
    times = np.linspace(0, 1, len(room))
    origins = np.stack([np.interp(times, path[:, 0], path[:, i]) for i in (1, 2, 3)], axis=1)
    write_points(tmp_path / "in.csv", PointCloud(room.xyz, {"time": times}))
    np.savetxt(tmp_path / "path.csv", path, delimiter=",", header="time,x,y,z", comments="")
    result = oriented(tmp_path / "in.csv", tmp_path, "--trajectory", tmp_path / "path.csv")
    assert "(trajectory)" in row_of_sensor(result)
    normals, xyz = written(tmp_path)
    assert (np.einsum("ij,ij->i", normals, origins - xyz) >= -1e-4).all()


def oriented(source, folder, *options):
    args = ("--orientation", "sensor", *options, "--report", folder / "report")
    return run("normals", source, folder / "out.npy", *args)


def row_of_sensor(result):
    assert result.exit_code == 0, result.output
    return re.search(r"^  sensor +(.*)$", result.stdout, re.MULTILINE)[1]


def written(folder):
    out = np.load(folder / "out.npy")
    return [np.column_stack([out[f"{name}{a}"] for a in "xyz"]) for name in ("normal_", "")]


def test_normals_do_not_look_at_a_local_origin_that_a_file_states(room, tmp_path):
    """What is typed is taken: another place, from which the points were not measured either."""
    pytest.importorskip("pypcd4")
    viewpoint = {"pcd_viewpoint": (1.0, 2.0, -3.0, 1.0, 0.0, 0.0, 0.0)}
    write_points(tmp_path / "in.pcd", PointCloud(room.xyz, {}, viewpoint))
    line = error_line(oriented(tmp_path / "in.pcd", tmp_path, "--sensor", "auto"))
    assert "in.pcd: the file says that the sensor was at 1, 2, -3 (PCD's VIEWPOINT), but" in line
    assert "give --sensor X,Y,Z where it stood, or --orientation up or mst" in line
    assert files_in(tmp_path) == ["in.pcd"]
    typed = oriented(tmp_path / "in.pcd", tmp_path, "--sensor", "-1,2,-3")
    assert row_of_sensor(typed) == "-1, 2, -3 (given)"
    normals, xyz = written(tmp_path)
    assert (np.einsum("ij,ij->i", normals, [-1, 2, -3] - xyz) >= -1e-4).all()


def test_where_noise_decides_the_side_of_many_the_option_is_named(small_machine, tmp_path):
    pytest.importorskip("lazrs")
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 2, (2_000, 3)) * [1, 1, 0] + rng.normal(0, 0.003, (2_000, 3))
    wall = np.arange(2_000) < 600
    xyz[wall] = xyz[wall][:, [0, 2, 1]]
    for name, part in {"room": slice(None), "floor": ~wall}.items():
        write_points(tmp_path / f"{name}.laz", PointCloud(xyz[part]))
    target, tiles = tmp_path / "out.laz", ("--memory", "2MB", "--n-jobs", 1)
    for name, options, expected in (
        ("room", (), ["30"]),
        ("room", tiles, ["30"]),
        ("room", ("--orientation", "mst"), []),
        ("floor", (), []),
    ):
        result = done("normals", tmp_path / f"{name}.laz", target, *options)
        told = re.findall(r"(\d+) % .*see --orientation sensor and mst\n", result.stdout)
        assert told == expected
    down = np.column_stack([read_points(target).attributes[f"normal_{a}"] for a in "xyz"])
    assert (down[:, 2] > 0.9).all()


@pytest.mark.parametrize(
    "options",
    [
        ["--orientation", "sensor"],
        ["--sensor", "1,2,3"],
        ["--trajectory", "path.csv"],
        ["--orientation", "sensor", "--sensor", "1,2,3", "--trajectory", "path.csv"],
    ],
)
def test_a_wrong_sensor_is_wrong_usage(options, room_file, tmp_path):
    result = run("normals", room_file, tmp_path / "out.laz", *options)
    assert result.exit_code == 2
    assert "sensor" in result.stderr
    assert files_in(tmp_path) == ["room.laz"]
