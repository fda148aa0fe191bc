"""mcmd edges: the columns it writes are the detector's, the cloud is otherwise as it was."""

import numpy as np
import pytest

from commands import done
from sklearn_mcmd import SharpFeatureDetector
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


def edges(source, target, *options):
    result = done("edges", source, target, *options)
    return read_points(target).attributes, result


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
    out, result = edges(box_file, tmp_path / "out.npz", *options)
    detector = SharpFeatureDetector(**{"random_state": 0, **parameters}).fit(box.xyz)
    edge = detector.predict(box.xyz) == -1
    assert 0 < edge.sum() < 450
    assert f"edges    {edge.sum():,} (" in result.stdout
    np.testing.assert_array_equal(out["edge"], edge)
    sign = 1 if detector.criterion == "crease" else -1
    scores = sign * detector.score_samples(box.xyz)
    np.testing.assert_allclose(out["edge_score"], scores, rtol=1e-6)
    np.testing.assert_array_equal(read_points(tmp_path / "out.npz").xyz, box.xyz)
    np.testing.assert_array_equal(out["intensity"], np.arange(900))


@pytest.mark.parametrize(("extension", "scale"), [(".ply", 1), (".laz", 257)])
def test_edges_are_red_and_surfaces_gray_in_the_colors_of_the_format(
    box_file, tmp_path, extension, scale
):
    out, _ = edges(box_file, tmp_path / f"out{extension}")
    colors = np.column_stack([out[c] for c in ("red", "green", "blue")])
    edge = out["edge"] == 1
    assert (colors[edge] == np.multiply(EDGE_COLOR, scale)).all()
    assert (colors[~edge] == np.multiply(SURFACE_COLOR, scale)).all()


@pytest.mark.parametrize("verb", ["edges", "segment"])
def test_colors_of_the_input_stay_unless_others_are_asked_for(verb, box, box_file, tmp_path):
    paint = {c: np.full(900, 7, dtype=np.uint8) for c in ("red", "green", "blue")}
    write_points(tmp_path / "in.ply", PointCloud(box.xyz, paint))
    for options, kept in (((), True), (("--colors",), False)):
        done(verb, tmp_path / "in.ply", tmp_path / "out.ply", *options)
        assert (read_points(tmp_path / "out.ply").attributes["red"] == 7).all() == kept
    done(verb, box_file, tmp_path / "out.ply", "--no-colors")
    assert "red" not in read_points(tmp_path / "out.ply").attributes
