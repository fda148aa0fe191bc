"""What a sensor looks at: surfaces and soft parts, each of a class."""

import numpy as np

from sklearn_mcmd.datasets._surfaces import Soft
from sklearn_mcmd.datasets._things import Wire


class World:
    """Parts of a scene by their class.

    Parameters
    ----------
    classes : dict of str to list of parts

    Notes
    -----
    ``through`` says of each part whether a beam may go past it and meet something else.
    """

    def __init__(self, classes):
        self.class_names = list(classes)
        self.parts = [part for parts in classes.values() for part in parts]
        counts = [len(parts) for parts in classes.values()]
        self.class_of = np.repeat(np.arange(len(counts)), counts)
        self.through = np.array([isinstance(part, (Soft, Wire)) for part in self.parts])

    def distance(self, points):
        """Distance of any points (n, 3) to the nearest part."""
        return np.min([part.distance(points) for part in self.parts], axis=0)
