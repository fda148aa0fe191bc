"""Segments as planes: which are found, by the definitions of `evops`, and how well they fit.

`evops` (Apache-2.0) asks for NumPy below 2, so its definitions are here; with its two thresholds
at `FOUND` and `PART` its version 1.0.0 tells the same. Points of unknown surface are left out, and
so are segments that mostly hold such points: they may be surfaces that nobody has labeled.
"""

import numpy as np

FOUND = 0.5  # a surface is found by a segment if their intersection over union is more
STRICT = 0.75  # evops's own threshold
PART = 0.2  # at least that much of it makes a segment a part


def plane_scores(surface, labels):
    """Shares by name: found, wrong and fitting surfaces or segments; see the page of segments."""
    shared = shared_points(surface, labels)
    of_surface, of_segment = np.bincount(surface[surface >= 0]), shared.sum(axis=0)
    of_surface = of_surface[of_surface > 0]
    union = of_surface[:, None] + of_segment - shared
    overlap = shared / union
    fits, part = overlap > FOUND, overlap >= PART
    matched = fits.sum()
    parts, wholes = part.sum(axis=0), part.sum(axis=1)
    alone = part & (parts == 1) & (wholes == 1)[:, None] & ~fits  # too little of each other
    every = 2 * shared[fits] / (union + shared)[fits]
    figures = {
        "precision": share(matched, len(of_segment)),
        "recall": share(matched, len(of_surface)),
        "f1": share(2 * matched, sum(shared.shape)),
        "f1_strict": share(2 * (overlap >= STRICT).sum(), sum(shared.shape)),
        "under": share((parts > 1).sum(), len(of_segment)),
        "over": share((wholes > 1).sum(), len(of_surface)),
        "noise": share(((parts == 0) | alone.any(axis=0)).sum(), len(of_segment)),
        "missed": share(((wholes == 0) | alone.any(axis=1)).sum(), len(of_surface)),
        "iou": overlap.max(axis=1, initial=0).mean(),
        "dice": share(every.sum(), matched),
    }
    return {name: round(float(value), 4) for name, value in figures.items()}


def shared_points(surface, labels):
    """Points (surfaces, segments) that both have, of the segments that count."""
    inside, labeled = labels >= 0, surface >= 0
    everything = np.bincount(labels[inside])
    of_known = np.bincount(labels[inside & labeled], minlength=len(everything))
    counts = (of_known > 0) & (2 * of_known >= everything)
    rows = np.unique(surface[labeled], return_inverse=True)[1]
    table = np.zeros((rows.max() + 1, len(everything)), dtype=int)
    np.add.at(table, (rows[inside[labeled]], labels[labeled & inside]), 1)
    return table[:, counts]


def share(part, whole):
    return part / whole if whole else 0.0
