"""The decomposition of covariance matrices, beside LAPACK's."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.planes._moments_numba import eigh_3d
from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def decompose(matrices, values, axes):
    for i in range(len(matrices)):
        m = matrices[i]
        eigen = eigh_3d((m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]))
        for row in range(3):
            values[i, row] = eigen[0][row]
            for axis in range(3):
                axes[i, row, axis] = eigen[1][row][axis]


@pytest.mark.parametrize(
    "spread",
    [
        (1, 0.8, 0.05),
        (1, 1, 1),
        (1, 0.8, 0),  # an exact plane
        (1, 1e-6, 1e-7),  # a thin row
        (1, 0, 0),
        (0, 0, 0),
        (1e-150, 1e-150, 1e-152),
        (1e150, 1e149, 1e140),
    ],
)
def test_axes_and_values_are_exact_to_rounding_whatever_the_shape(spread):
    rng = np.random.default_rng(0)
    turns = np.linalg.qr(rng.normal(size=(500, 3, 3)))[0]
    turns[:9] = np.eye(3)[[0, 1, 2, 0, 2, 1, 1, 0, 2]].reshape(3, 3, 3).repeat(3, axis=0)
    members = turns @ (rng.normal(size=(500, 3, 50)) * np.array(spread, dtype=float)[:, None])
    matrices = members @ np.swapaxes(members, -1, -2) / 50
    values, axes = np.empty((500, 3)), np.empty((500, 3, 3))
    decompose(matrices, values, axes)

    rounding = 2e-15 * np.trace(matrices, axis1=1, axis2=2)[:, None]
    assert (np.abs(values - np.linalg.eigvalsh(matrices)) <= rounding).all()
    left = np.einsum("nij,naj->nai", matrices, axes) - values[:, :, None] * axes
    assert (np.abs(left) <= rounding[:, None]).all()
    assert_allclose(axes @ np.swapaxes(axes, 1, 2), np.tile(np.eye(3), (500, 1, 1)), atol=4e-15)
