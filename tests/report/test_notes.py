"""Warnings: each is given for the cloud it is meant for, and for no clean one."""

import numpy as np
import pytest

from sklearn_mcmd.report._facts import Facts
from sklearn_mcmd.report._notes import cloud_notes


def plane(noise=0.01, n=4000, side=10.0):
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, side, (n, 2))
    return np.column_stack([xy, 0.3 * xy[:, 0] + rng.normal(0, noise, n)])


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
    notes = cloud_notes(Facts.of(xyz, 50, np.array([noise])))
    assert {note.title for note in notes} >= set(titles)
    assert bool(notes) == bool(titles)
    for note in notes:
        assert any(character.isdigit() for character in note.text)
        assert note.remedy.endswith(".")
