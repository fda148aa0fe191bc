"""Warnings: each is given for the cloud it is meant for, and for no clean one."""

import numpy as np
import pytest

from sklearn_mcmd.report._facts import Facts
from sklearn_mcmd.report._notes import cloud_notes

N, SIDE = 4000, 10.0


def plane(noise=0.01, n=N, seed=0):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, SIDE, (n, 2))
    return np.column_stack([xy, 0.3 * xy[:, 0] + rng.normal(0, noise, n)])


def titles(xyz, noise=0.01, n_neighbors=50):
    return [note.title for note in cloud_notes(Facts.of(xyz, n_neighbors, np.array([noise])))]


def test_a_clean_plane_has_no_warning():
    assert titles(plane()) == []


def sparse_rim():
    rng = np.random.default_rng(1)
    rim = np.column_stack(
        [rng.uniform(-8 * SIDE, -2, 300), rng.uniform(0, SIDE, 300), np.zeros(300)]
    )
    return np.vstack([plane(), rim])


@pytest.mark.parametrize(
    ("xyz", "noise", "title"),
    [
        (plane(n=200), 0.01, "Few points."),
        (np.vstack([plane(), plane()[:200]]), 0.01, "Duplicates."),
        (np.round(plane(), 1), 0.05, "Rounded coordinates."),
        ((plane() + 4e6).astype(np.float32).astype(float), 0.1,
         "Single precision far from the origin."),
        (np.vstack([plane(), [[99, 99, 0]]]), 0.01, "Points far from all others."),
        (sparse_rim(), 0.01, "Sparse parts."),
        (plane(0.5), 0.5, "Noise hides the surfaces."),
    ],
)  # fmt: skip
def test_each_fault_has_its_warning(xyz, noise, title):
    assert title in titles(xyz, noise)


def test_every_warning_has_a_number_and_a_remedy():
    xyz = np.vstack([np.round(plane(0.5, n=300), 1), [[99, 99, 0]]])
    notes = cloud_notes(Facts.of(xyz, 50, np.array([0.05])))
    assert len(notes) >= 3
    for note in notes:
        assert any(character.isdigit() for character in note.text)
        assert note.remedy.endswith(".")


def test_rounding_finer_than_the_noise_is_no_fault():
    assert titles(np.round(plane(), 3)) == []
