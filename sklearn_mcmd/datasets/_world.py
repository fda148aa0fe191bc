"""What a sensor looks at: surfaces and soft parts, each of a class."""

import numpy as np

from sklearn_mcmd.datasets._surfaces import Soft
from sklearn_mcmd.datasets._things import Wire


class World:
    """Parts of a scene by their class: lists of parts, or of lists of them.

    ``through`` says of each part whether a beam may go past it and meet something else.
    """

    def __init__(self, classes):
        self.class_names = list(classes)
        parts = [_flat(things) for things in classes.values()]
        self.parts = _flat(parts)
        self.class_of = np.repeat(np.arange(len(parts)), list(map(len, parts)))
        self.through = np.array([isinstance(part, (Soft, Wire)) for part in self.parts])

    def distance(self, points):
        """Distance of any points (n, 3) to the nearest part."""
        return np.min([part.distance(points) for part in self.parts], axis=0)


def _flat(things):
    return [part for some in things for part in (some if isinstance(some, list) else [some])]
