"""What has moved between two clouds of one place."""

from sklearn_mcmd.change._bodies import Bodies, moved_bodies
from sklearn_mcmd.change._comparison import Changes
from sklearn_mcmd.change._estimator import CloudChange

__all__ = ["Bodies", "Changes", "CloudChange", "moved_bodies"]
