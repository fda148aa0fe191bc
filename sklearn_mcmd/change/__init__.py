"""What has moved between two clouds of one place."""

from sklearn_mcmd.change._bodies import Bodies, moved_bodies
from sklearn_mcmd.change._estimator import Changes, CloudChange

__all__ = ["Bodies", "Changes", "CloudChange", "moved_bodies"]
