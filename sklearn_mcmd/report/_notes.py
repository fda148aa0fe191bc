"""Warnings in plain words, each from a measurement, with what to do."""

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.report._contents import Note, note_if, percent

CHECKS_OF_ALL = "duplicates, coordinates that are rounded, and points far from all others"
CHECKS = "too few points, sparse parts, noise that hides surfaces, " + CHECKS_OF_ALL
FEW = 10  # neighborhoods; the detector judges clouds of fewer by other shares (`SurfaceLimits`)
COPIES = 0.01  # share of copies, which count once, below which they change no picture
STEP = 0.505  # steps of coordinates; half a step is the least scale, and sets the usual one then
SPARSE = 5.0  # times the usual radius: there is a twenty-fifth of the usual density


def cloud_notes(facts, *, local=True):
    """What is the matter with the cloud itself; not `local`: where no neighborhoods are taken."""
    n_copies, n_far = facts.n_points - facts.n_distinct, int(np.count_nonzero(~facts.near))
    spans = " x ".join(f"{value:.4g}" for value in facts.high - facts.low)
    notes = note_if(
        n_copies > COPIES * facts.n_points,
        "Duplicates.",
        f"{n_copies:,} points ({percent(n_copies, facts.n_points)}) lie exactly where another one "
        "does. They count once in planes, and say nothing about noise.",
        "Look for a strip that was merged twice, or thin the cloud to distinct points first.",
    )
    notes += note_if(
        facts.step and facts.noise <= STEP * facts.step,
        "Rounded coordinates.",
        f"Coordinates are multiples of {facts.step:.3g}, which is coarser than the noise. "
        "Distances from surfaces are known in steps and no longer in noise; what is off by less "
        "than a step and a half is not seen.",
        "Export the scan with more decimals, if it has them.",
    )
    notes += note_if(
        n_far > 0,
        "Points far from all others.",
        f"{n_far:,} points ({percent(n_far, facts.n_points)}) lie farther from the rest than this "
        f"is wide: the file spans {spans}. Maps leave them out.",
        "Check them, and cut them off if they are no part of the scan.",
    )
    return notes + _neighborhood_notes(facts) if local else notes


def _neighborhood_notes(facts):
    notes = note_if(
        facts.n_distinct < FEW * facts.n_neighbors or facts.n_distinct <= facts.n_neighbors,
        "Few points.",
        f"The cloud has {counted(facts.n_distinct, 'distinct point')}, and a neighborhood takes "
        f"{facts.n_neighbors:,} of them. What is a surface and what is usual is then a guess.",
        "Give a larger part of the scan, or a smaller --n-neighbors.",
    )
    notes += note_if(
        facts.sparse_radius > SPARSE * facts.radius,
        "Sparse parts.",
        f"A neighborhood of {facts.n_neighbors} points usually has a radius of {facts.radius:.2g}. "
        f"For 5 % of the points it is more than {facts.sparse_radius:.2g}: smaller things are not "
        "seen there, and normals are averages over that width.",
        "Trust these parts less, cut them off, or give a smaller --n-neighbors.",
    )
    flat = SurfaceLimits().flat  # which 50 neighbors have at noise of 0.6 spacings
    return notes + note_if(
        facts.noise > flat * facts.radius,
        "Noise hides the surfaces.",
        f"Points scatter by {facts.noise:.2g} about their planes, and neighborhoods have a radius "
        f"of {facts.radius:.2g}. From {flat:g} of the radius on (0.6 spacings with 50 neighbors) "
        "nothing counts as a surface. The cloud is noise, or foliage.",
        "Give more neighbors, such as --n-neighbors 200, or a cloud of surfaces.",
    )


def with_warnings(contents, warned):
    """The same with what the run warned of on the terminal."""
    new = [Note("Warned on the terminal.", words) for words in warned]
    return contents._replace(notes=new + contents.notes)
