"""Whole pipelines: tables of pandas and polars go through unchanged."""

import pytest
from numpy.testing import assert_array_equal
from sklearn.pipeline import Pipeline, make_pipeline

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
