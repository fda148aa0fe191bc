"""Clouds and scenes that several test modules build, with their truth."""

from sklearn_mcmd.datasets._street import _street


def scene_of(street, tree=False):
    """The surfaces that a street of `make_street` was scanned from."""
    n_bays = len(street.scanners)
    return _street(street.length / n_bays, n_bays, tree)
