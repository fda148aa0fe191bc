"""Whole pipelines: tables of pandas and polars go through unchanged."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.pipeline import Pipeline, make_pipeline

from growth import grown_without
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.datasets import make_box


@pytest.fixture(scope="module")
def box():
    return make_box(1000, random_state=0)


def segments():
    return Pipeline(
        [
            ("normals", RobustNormalEstimator(20, random_state=0)),
            ("segment", RegionGrowing(normals="precomputed")),
        ]
    )


def edges():
    return make_pipeline(
        RobustNormalEstimator(20, random_state=0),
        SharpFeatureDetector(normals="precomputed", random_state=0),
    )


@pytest.mark.parametrize("make", [segments, edges])
@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_tables_go_through_and_change_no_label(make, library, box):
    frames = pytest.importorskip(library)
    table = frames.DataFrame(dict(zip("xyz", box.data.T, strict=True)))
    pipeline = make().set_output(transform=library)
    assert_array_equal(pipeline.fit_predict(table), make().fit_predict(box.data))
    names = [*"xyz", "normal_x", "normal_y", "normal_z", "surface_variation"]
    names += [*(f"eigenvalue_{i}" for i in range(3)), "plane_offset", "plane_scale"]
    assert list(pipeline[-1].feature_names_in_) == names
    columns = pipeline[:-1].transform(table)
    assert isinstance(columns, frames.DataFrame)
    assert list(columns.columns) == names


def test_growing_takes_planes_as_they_are_handed_on(box):
    columns = RobustNormalEstimator(20, random_state=0).fit_transform(box.data)
    planes_alone = "find_narrow_faces", "assign_unlabeled"
    labels = grown_without(columns, *planes_alone, max_distance=0.1)
    face = np.flatnonzero(labels == 0)
    upper = face[box.data[face, 0] > np.median(box.data[face, 0])]
    columns[upper, 10] += 1.0  # these planes lie far from their points, and explain no neighbor
    assert (grown_without(columns, *planes_alone, max_distance=0.1)[upper] == -1).mean() > 0.9


def test_segments_of_a_box_are_its_faces(box):
    labels = segments().fit_predict(box.data)
    faces = [np.bincount(labels[box.surface == face] + 1).argmax() - 1 for face in range(3)]
    assert sorted(faces) == [0, 1, 2]
    assert np.mean(np.array(faces)[box.surface] == labels) > 0.98


def test_edges_behind_normals_are_at_the_edges(box):
    flagged = edges().fit_predict(box.data) == -1
    distance = box.edge_distance / box.spacing
    assert flagged[distance < 1].mean() > 0.9
    assert flagged[distance > 3].mean() < 0.02


def test_a_pipelines_edges_are_those_of_its_parts(box):
    columns = RobustNormalEstimator(20, random_state=0).fit_transform(box.data)
    detector = SharpFeatureDetector(normals="precomputed", random_state=0)
    assert_array_equal(edges().fit_predict(box.data), detector.fit_predict(columns))
