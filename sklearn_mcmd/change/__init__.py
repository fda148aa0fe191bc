"""What has moved between two clouds of one place."""

from sklearn_mcmd.change._bodies import Bodies, moved_bodies
from sklearn_mcmd.change._estimator import REASONS, Changes, CloudChange

__all__ = ["REASONS", "Bodies", "Changes", "CloudChange", "moved_bodies"]
