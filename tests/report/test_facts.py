"""What a cloud is like, compared with what it was made of."""

import numpy as np
import pytest

from depth_frames import turned_wall
from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.report import _facts
from sklearn_mcmd.report._facts import Facts, cloud_notes, usual_rows


def raster(n=40, step=0.5):
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])


def test_spacing_copies_and_step_of_a_raster_are_those_it_was_made_with():
    xyz = np.vstack([raster(), raster()[:100]])
    xyz[:, 2] = xyz[:, 0]  # of one level no step is known
    facts = Facts.of(xyz, 9, np.array([0.1, np.nan, 0.3, 0.2]))
    assert (facts.n_points, facts.n_distinct) == (1700, 1600)
    assert (facts.spacing, facts.steps.lattice, facts.noise) == (0.5, 0.5, 0.2)
    assert facts.radius == pytest.approx(0.5 * np.sqrt(3))  # eight neighbors, where z = x
    assert usual_rows(xyz).all()
    assert np.isnan(Facts.of(xyz, 9).noise)
    assert Facts.of(np.zeros((1, 3)), 50).n_distinct == 1
    assert Facts.of(np.array([[0.0, 0, 0], [3, 4, 0]]), 50).spacing == 5


def test_the_depths_of_a_camera_have_a_row():
    frame = PointCloud(turned_wall(60, 3)[0])
    rows = dict(Facts.of(frame.xyz).rows(frame))
    assert rows["depths"] == "in steps of 0.017 to 0.045, as of a camera"
    assert "coordinates" not in rows


def test_only_points_farther_away_than_the_cloud_is_wide_are_far():
    xyz = np.vstack([raster(), [[500.0, 0, 0], [25, 0, 0]]])
    assert np.flatnonzero(~usual_rows(xyz)).tolist() == [1600]


def plane(noise=0.01, n=4000, side=10.0):
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, side, (n, 2))
    return np.column_stack([xy, 0.3 * xy[:, 0] + rng.normal(0, noise, n)])


@pytest.mark.parametrize("most", [1_000, 3_000])
def test_the_spacing_of_a_sample_is_nearly_that_of_all_in_any_order_of_rows(most, monkeypatch):
    xyz = plane(n=20_000)
    spacing = Facts.of(xyz).spacing
    monkeypatch.setattr(_facts, "SPACING_SAMPLE", most)
    sampled = Facts.of(xyz).spacing
    assert sampled != spacing
    assert sampled == pytest.approx(spacing, rel=0.06)  # three standard errors of such a median
    assert Facts.of(np.random.default_rng(0).permutation(xyz)).spacing == sampled


RIM = np.random.default_rng(1).uniform((-80, 0, 0), (-2, 10, 0), (300, 3))


@pytest.mark.parametrize(
    ("xyz", "noise", "titles"),
    [
        (plane(), 0.01, []),
        (np.round(plane(), 3), 0.01, []),
        (plane(n=200), 0.01, ["Few points."]),
        (np.vstack([plane(), plane()[:200]]), 0.01, ["Duplicates."]),
        (np.round(plane(), 1), 0.05, ["Rounded coordinates."]),
        (np.vstack([plane(), [[99, 99, 0]]]), 0.01, ["Points far from all others."]),
        (np.vstack([plane(), RIM]), 0.01, ["Sparse parts."]),
        (plane(0.5), 0.5, ["Noise hides the surfaces."]),
    ],
)
def test_each_fault_has_its_warning_with_a_number_and_a_remedy(xyz, noise, titles):
    facts, n_far = Facts.of(xyz, 50, np.array([noise])), np.count_nonzero(~usual_rows(xyz))
    notes = cloud_notes(facts, n_far)
    assert {note.title for note in notes} >= set(titles)
    assert bool(notes) == bool(titles)
    for note in notes:
        assert any(character.isdigit() for character in note.text)
        assert note.remedy.endswith(".")
