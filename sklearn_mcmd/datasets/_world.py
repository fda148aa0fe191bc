"""What a sensor looks at: surfaces and soft parts, each of a class."""

import numpy as np


class World:
    """Parts of a scene by their class.

    Parameters
    ----------
    classes : dict of str to list of parts
    through : sequence of str, default=()
        Classes behind which a part of the beam may go on and meet something else.
    """

    def __init__(self, classes, through=()):
        self.class_names = list(classes)
        self.parts = [part for parts in classes.values() for part in parts]
        counts = [len(parts) for parts in classes.values()]
        self.class_of = np.repeat(np.arange(len(counts)), counts)
        self.through = np.repeat([name in through for name in classes], counts)

    def distance(self, points):
        """Distance of any points (n, 3) to the nearest part."""
        return np.min([part.distance(points) for part in self.parts], axis=0)
