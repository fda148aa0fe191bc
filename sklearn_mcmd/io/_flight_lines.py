"""Where an airborne sensor was, from the scan angles of each flight line."""

import numpy as np

# Degrees (rms) by which directions may differ from scan angles. Rounding to whole degrees makes
# 0.29, and no single angle is wrong by more than half a degree.
MOST_OFF = 0.5
LEAST_POINTS = 100  # of a line, for its angles to tell anything
ROUNDS = 20  # of the adjustment; each changes the height by about relief over height less


def positions_of_lines(cloud):
    """Positions for each point (n, 3), or None; and where they are from, or why there are none."""
    given = cloud.attributes
    angles = given.get("scan_angle_rank")
    if angles is None and "scan_angle" in given:
        angles = 0.006 * np.asarray(given["scan_angle"], float)
    if angles is None or "gps_time" not in given or "point_source_id" not in given:
        return None, "points have no scan angles with times; give a position or a trajectory"
    angles, times = np.asarray(angles, float), np.asarray(given["gps_time"], float)
    if np.ptp(angles) == 0 or np.ptp(times) == 0:
        return None, "scan angles or times are all equal; give a position or a trajectory"
    lines = np.asarray(given["point_source_id"])
    positions, numbers = np.empty((len(cloud), 3)), np.unique(lines)
    for line in numbers:
        rows = lines == line
        found, why = _adjusted(cloud.xyz[rows], times[rows], angles[rows])
        if found is None:
            return None, f"of flight line {line}, {why}; give a trajectory"
        positions[rows] = found
    one = len(numbers) == 1
    return positions, "scan angles of " + ("one flight line" if one else f"{len(numbers)} lines")


def _adjusted(xyz, times, angles):
    """Positions of the sensor on a straight and level line, or None and why.

    The plan of a point is that of the sensor, which moves by time, and a step across that is the
    height over the point times the tangent of its angle. Height and direction of the step are
    linear unknowns while the points' heights are corrected for with those of the round before.
    """
    if len(xyz) < LEAST_POINTS:
        return None, f"there are fewer than {LEAST_POINTS} points"
    middle, tangents = xyz.mean(axis=0), np.tan(np.radians(angles))
    times = (times - times.mean()) / max(np.ptp(times), np.finfo(float).tiny)
    unknown = np.column_stack([np.ones(len(xyz)), times, tangents])
    if np.linalg.matrix_rank(unknown) < 3:
        return None, "scan angles or times are all equal"
    local, across, solve = xyz - middle, np.zeros(2), np.linalg.pinv(unknown)
    for _ in range(ROUNDS):
        plan = local[:, :2] + (local[:, 2] * tangents)[:, None] * across
        solved = solve @ plan
        height = np.linalg.norm(solved[2])
        if not height > 0:
            return None, "scan angles say nothing of its height"
        across = solved[2] / height
    off = np.linalg.norm(plan - unknown @ solved, axis=1)
    off = np.degrees(np.sqrt(np.mean(off**2)) / height)
    if off > MOST_OFF:
        return None, (
            f"directions to points differ from scan angles by {off:.2g} degrees (rms; "
            f"{MOST_OFF:g} are the most)"
        )
    if height <= local[:, 2].max():
        return None, "scan angles put the sensor below the highest of its points"
    flown = middle[:2] + unknown[:, :2] @ solved[:2]
    return np.column_stack([flown, np.full(len(xyz), middle[2] + height)]), ""
