"""The measures of public benchmarks, as their authors define them.

Roofs as LidarRoofSegNet's `roofseg/metrics.py` at 5623f5f, normals as PCPNet (Guerrero et al.,
2018) and the evaluations after it, snow as Kurup and Bos (2021). Written anew from definitions.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment
from sklearn.metrics import adjusted_rand_score, precision_recall_fscore_support
from sklearn.metrics.cluster import contingency_matrix

from sklearn_mcmd.metrics import bias_angle

MATCHED = 0.5  # intersection over union from which on a face and a segment are the same
PART = 0.2  # share of a face, or of a segment, from which on it holds a part of the other
WIDEST = 30.0  # degrees at which the curve of shares within an angle ends


def roof_scores(roof, labels):
    """Of one roof. Segments are 0, 1, ...; -1, no segment, is one label more for ARI alone,
    which is not asked of a single face.

    Precision and recall ask for a partner of an intersection over union (IoU) of .5 or more. The
    mean IoU is over the pairs of the one-to-one matching that has the largest sum.
    """
    plane, labels = roof.plane[roof.plane >= 0], labels[roof.plane >= 0]
    shared = contingency_matrix(plane, labels)[:, np.unique(labels) >= 0]
    n_segments, of_segment = shared.shape[1], shared.sum(axis=0)
    of_face = np.unique(plane, return_counts=True)[1]
    iou = shared / (of_face[:, None] + of_segment - shared)
    pairs = linear_sum_assignment(-iou)
    in_segments, in_faces = shared / of_face[:, None] >= PART, shared / of_segment >= PART
    return {
        "ARI": adjusted_rand_score(plane, labels) if len(of_face) > 1 else np.nan,
        "mean IoU": iou[pairs].mean() if n_segments else 0.0,
        "precision": (iou.max(axis=0) >= MATCHED).mean() if n_segments else 0.0,
        "recall": (iou.max(axis=1, initial=0) >= MATCHED).mean(),
        "faces off by": abs(n_segments - len(of_face)),
        "over": (in_segments.sum(axis=1) > 1).mean(),
        "under": (in_faces.sum(axis=0) > 1).mean() if n_segments else 0.0,
    }


def normal_scores(shape, normals):
    """Of one shape, at its judged rows. A point without a normal is off by 90 degrees."""
    angle = bias_angle(normals[shape.rows], shape.normals[shape.rows])
    angle = np.where(np.isnan(angle), 90.0, angle)
    return {
        "RMSE": np.sqrt(np.mean(angle**2)),
        "within 5": 100 * np.mean(angle <= 5),
        "within 10": 100 * np.mean(angle <= 10),
        # The mean over 0 to 30 degrees of the share of angles up to there.
        "area": 100 * np.mean(np.clip(1 - angle / WIDEST, 0, None)),
    }


def snow_scores(frame, flagged):
    precision, recall, f1, _ = precision_recall_fscore_support(
        frame.snow, flagged, average="binary", zero_division=0.0
    )
    shares = precision, recall, f1, np.mean(flagged[~frame.snow])
    names = "precision", "recall", "F1", "others lost"
    return {name: 100 * share for name, share in zip(names, shares, strict=True)}
