"""What rays tell, literally and slowly: the part of the oracle `judged` that knows a sensor."""

import numpy as np


class LiteralRays:
    """The rays to n distinct points from where the sensor was, `origins` (n, d), for each.

    All angles, no tree, one beam at a time; every constant stands where it is used.
    """

    def __init__(self, points, origins):
        n, self.points, self.origins = len(points), points, origins
        rays = points - origins
        self.range = np.linalg.norm(rays, axis=1)
        self.direction = np.array([r / (np.linalg.norm(r) or 1) for r in rays])
        seen = self.range > 0
        places = np.hstack([self.direction, origins / np.median(self.range[seen])])
        self.angle = np.array([np.linalg.norm(places - place, axis=1) for place in places])
        # Of points in one direction, the farthest tells where the beam ends.
        hides = (self.angle == 0) & (self.range[:, None] < self.range)
        ends = np.flatnonzero(~hides.any(axis=1))
        self.others = [
            sorted((j for j in ends if self.angle[i, j] > 0), key=lambda j: self.angle[i, j])
            for i in range(n)
        ]
        self.mean_angle = [
            np.mean([self.angle[i, j] for j in self.others[i][:8]]) for i in range(n)
        ]
        self.usual_angle = np.median(np.array(self.mean_angle)[seen])
        self.step = np.minimum(self.mean_angle, 2 * self.usual_angle) * self.range
        self.step[self.range < 0.1 * np.median(self.range[seen])] = 0  # at the sensor

    def of_planes(self, planes, sd, near):
        """How much ranges scatter beside a plane, in steps."""
        n = len(self.points)
        left, alone = np.zeros(n), np.full(n, np.inf)
        for i in range(n):
            center, normal = planes[i][:2]
            away = {j: np.linalg.norm(self.points[j] - self.points[i]) for j in self.others[i][:8]}
            met = [j for j in away if abs((self.points[j] - center) @ normal) <= 3 * sd[i]]
            tilt = [0, *((self.direction[j] - self.direction[i]) @ normal for j in met)]
            farther = np.array([0, *(self.range[j] - self.range[i] for j in met)])
            line = np.column_stack([np.ones(len(tilt)), tilt])
            farther = farther - line @ np.linalg.lstsq(line, farther)[0]
            if self.step[i] > 0:
                left[i] = np.sqrt(np.mean(farther**2)) / self.step[i]
                alone[i] = min(away.values()) / self.step[i]
        scatter = [
            min(np.median(left[near[i, :9]]), np.median(alone[near[i, :9]]) / 1.25 * 3)
            for i in range(n)
        ]
        return np.array(scatter)

    def sheets(self, planes, sd, near, grazed, voters):
        """Flat planes that contain the rays, but where more surfaces beside go on than turn."""
        goes_on = np.zeros(len(self.points))
        for i in np.flatnonzero(grazed):
            for j in self.others[i][:8]:
                if voters[j]:
                    explains = abs((self.points[i] - planes[j][0]) @ planes[j][1]) <= 3 * sd[j]
                    alike = abs(planes[i][1] @ planes[j][1]) >= np.cos(np.radians(25))
                    goes_on[i] += explains if alike else -1
        return grazed & [goes_on[beside].sum() <= 0 for beside in near]

    def far_away(self):
        """Whether one position is farther from the cloud than that is large."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        outside = self.origins[0] - np.clip(self.origins[0], low, high)
        one = (self.origins == self.origins[0]).all()
        return one and np.linalg.norm(outside) > np.linalg.norm(high - low)

    def told(self, i, beams, silent, explained):
        """Beams that pass a place, end before, do so on a surface, and end near on none; all."""
        passing = ending = hidden = near = 0
        for j, no_echo in zip(beams, silent, strict=True):
            farther = self.range[j] - self.range[i]
            farther = np.clip(farther / (3 * self.step[i]), -1, 1) if self.step[i] else 1
            farther = 1 if no_echo else farther
            passing += max(farther, 0)
            ending += max(-farther, 0)
            hidden += max(-farther, 0) * (j in explained)
            near += (1 - abs(farther)) * (j not in explained)
        return np.array([passing, ending, hidden, near, len(beams)])

    def isolation(self, off_surface, isolation, among_all, gaps, explained):
        """Of the points `off_surface` by beams next to each, and those next to 16 points around."""
        told, apart = {}, {}
        for i in off_surface:
            beams = self.others[i][:8]
            told[i] = self.told(i, beams, [False] * len(beams), explained)
            in_steps = among_all[i] / self.step[i] if self.step[i] else isolation[i]
            apart[i] = np.sqrt(isolation[i] * in_steps)

        def empty(told):
            passing, _, _, near, _ = told
            return passing / (passing + near) if passing + near > 0 else 1

        by_beams = np.zeros(len(isolation))
        for i in off_surface:
            around = sorted(off_surface, key=lambda j: gaps[i, j])[:17]  # itself, too
            together = np.exp(np.mean([np.log(apart[j]) for j in around]))
            share = min(empty(told[i]), empty(sum(told[j] for j in around)))
            by_beams[i] = share * np.sqrt(apart[i] * together) if self.step[i] else isolation[i]
        return np.minimum(by_beams, isolation) if self.far_away() else by_beams

    def separation(self, groups, separation, explained):
        """Of the points of groups, by the beams around the whole of each."""
        by_beams = separation.copy()
        for inside in groups:
            told = np.zeros(5)
            for i in inside:
                strange = [j for j in self.others[i][:64] if j not in inside][:8]
                silent = [self.angle[i, j] > 2 * self.usual_angle for j in strange]
                told += self.told(i, strange, silent, explained)
            passing, ending, hidden, _, asked = told
            shares = (passing - ending) / (asked or 1), 2 * hidden / (asked or 1) - 1
            for i in inside:
                by_beams[i] *= min(max(*shares, 0), 1) if self.step[i] else 1
        return by_beams
