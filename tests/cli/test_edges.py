"""mcmd edges: the columns it writes are the detector's, the cloud is otherwise as it was."""

import numpy as np
import pytest
from typer.testing import CliRunner

from sklearn_mcmd import SharpFeatureDetector
from sklearn_mcmd.cli import app
from sklearn_mcmd.datasets import make_box
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.plotting._still import EDGE_COLOR, SURFACE_COLOR


@pytest.fixture(scope="module")
def box():
    box = make_box(900, outlier_share=0.1, random_state=0)
    return PointCloud(np.round(box.data, 4), {"intensity": np.arange(900, dtype=np.uint16)})


@pytest.fixture
def box_file(tmp_path, box):
    path = tmp_path / "box.ply"
    write_points(path, box)
    return path


def run(*args):
    return CliRunner().invoke(app, ["edges", *(str(a) for a in args)], prog_name="mcmd")


@pytest.mark.parametrize(
    ("options", "parameters"),
    [
        ([], {}),
        (
            ["--n-neighbors", 30, "--threshold", 3, "--min-angle", 45, "--random-state", 1],
            {"n_neighbors": 30, "threshold": 3.0, "min_angle": 45.0, "random_state": 1},
        ),
        (["--no-denoise"], {"outlier_detector": "passthrough"}),
        (["--criterion", "surface_variation"], {"criterion": "surface_variation"}),
    ],
)
def test_the_columns_are_labels_and_scores_of_the_detector(
    box, box_file, tmp_path, options, parameters
):
    result = run(box_file, tmp_path / "out.npz", *options)
    assert result.exit_code == 0, result.output
    out = read_points(tmp_path / "out.npz")
    detector = SharpFeatureDetector(**{"random_state": 0, **parameters}).fit(box.xyz)
    edge = detector.predict(box.xyz) == -1
    assert 0 < edge.sum() < 450
    np.testing.assert_array_equal(out.attributes["edge"], edge)
    sign = 1 if detector.criterion == "crease" else -1
    scores = sign * detector.score_samples(box.xyz)
    np.testing.assert_allclose(out.attributes["edge_score"], scores, rtol=1e-6)
    np.testing.assert_array_equal(out.xyz, box.xyz)
    np.testing.assert_array_equal(out.attributes["intensity"], np.arange(900))


@pytest.mark.parametrize(("extension", "scale"), [(".ply", 1), (".laz", 257)])
def test_edges_are_red_and_surfaces_gray_in_the_colors_of_the_format(
    box_file, tmp_path, extension, scale
):
    assert run(box_file, tmp_path / f"out{extension}").exit_code == 0
    out = read_points(tmp_path / f"out{extension}").attributes
    colors = np.column_stack([out[c] for c in ("red", "green", "blue")])
    edge = out["edge"] == 1
    assert (colors[edge] == np.multiply(EDGE_COLOR, scale)).all()
    assert (colors[~edge] == np.multiply(SURFACE_COLOR, scale)).all()


def test_colors_of_the_input_stay_unless_others_are_asked_for(box, tmp_path):
    paint = {c: np.full(900, 7, dtype=np.uint8) for c in ("red", "green", "blue")}
    write_points(tmp_path / "in.ply", PointCloud(box.xyz, paint))
    assert run(tmp_path / "in.ply", tmp_path / "kept.ply").exit_code == 0
    assert (read_points(tmp_path / "kept.ply").attributes["red"] == 7).all()
    assert run(tmp_path / "in.ply", tmp_path / "new.ply", "--colors").exit_code == 0
    assert (read_points(tmp_path / "new.ply").attributes["red"] != 7).all()


def test_no_colors_writes_none(box_file, tmp_path):
    assert run(box_file, tmp_path / "out.ply", "--no-colors").exit_code == 0
    assert "red" not in read_points(tmp_path / "out.ply").attributes


def test_the_summary_counts_the_edges(box_file, tmp_path):
    result = run(box_file, tmp_path / "out.npz")
    n_edge = int(read_points(tmp_path / "out.npz").attributes["edge"].sum())
    assert f"{n_edge:,} (" in result.stdout
    assert run(box_file, tmp_path / "out.npz", "--quiet").stdout == ""


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--threshold", "0"], 2, "not a number above 0"),
        (["--criterion", "sharpness"], 2, "sharpness"),
        (["--min-angle", "90"], 2, "89"),
        (["--n-neighbors", "3"], 2, "4"),
    ],
)
def test_wrong_usage_is_named_and_nothing_is_written(box_file, tmp_path, options, code, words):
    result = run(box_file, tmp_path / "out.ply", *options)
    assert result.exit_code == code
    assert words in result.stderr
    assert not (tmp_path / "out.ply").exists()


def test_a_missing_file_is_one_clear_line(tmp_path):
    result = run(tmp_path / "absent.ply", tmp_path / "out.ply")
    assert result.exit_code == 1
    assert result.stderr.startswith("mcmd: error: ")
    assert len(result.stderr.splitlines()) == 1
