"""Constants of the whole cloud, found part by part, are those that estimators find at once."""

import numpy as np
import pytest

from sklearn_mcmd.planes._resolution import coordinate_step
from sklearn_mcmd.tiling._cloud_constants import WholeCloud

NATIONAL = np.array([362_000, 5_157_000, 100])
RNG = np.random.default_rng(0)
CLOUDS = {
    "continuous": RNG.uniform(0, 9, (3_000, 3)),
    "millimeters": np.round(RNG.uniform(0, 2, (3_000, 3)) + NATIONAL, 3),
    "centimeters on a floor": np.round(RNG.uniform(0, 2, (3_000, 3)) * [1, 1, 0.01], 2),
    "some not rounded": np.vstack(
        [np.round(RNG.uniform(0, 2, (3_000, 3)), 2), RNG.uniform(0, 2, (9, 3))]
    ),
    "single precision": RNG.integers(0, 500, (3_000, 3)) / 64,
    "whole meters": RNG.integers(0, 500, (3_000, 3)) + NATIONAL,
}


@pytest.mark.parametrize("name", CLOUDS)
def test_the_step_of_the_parts_is_that_of_the_cloud(name):
    xyz, whole = CLOUDS[name], WholeCloud()
    for part in np.array_split(xyz, [100, 150, 2_000]):
        whole.add(part)
    found = whole.constants()
    assert found.dtype == ("float32" if name == "single precision" else "float64")
    assert found.step == coordinate_step(xyz.astype(found.dtype))
    assert (found.step > 0) == (name != "continuous")
