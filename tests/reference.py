"""What the package computes, literally and slowly: the oracle of the tests.

Algorithms 1 to 4 of the first paper, and `judged`, the default of `MCMDOutlierDetector`. One
neighborhood at a time, one trial at a time, no vectorization, no shortcuts. The only addition to
the paper is what it leaves open: ties go to the first member and the first trial.
"""

from itertools import pairwise

import numpy as np
from scipy.special import fdtri, ndtr, ndtri
from scipy.stats import truncnorm

from reference_rays import LiteralRays
from sklearn_mcmd.planes._record import Neighborhoods

UNIQUE = "return_index", "return_inverse", "return_counts"
VARIANCE_LEFT = truncnorm(-2.5, 2.5).var()  # of a normal law that is cut at 2.5


def plane(points):
    """Mean, ascending eigenvalues and eigenvectors of the covariance matrix (Eq. 1)."""
    mean = points.mean(axis=0)
    deviations = points - mean
    covariance = deviations.T @ deviations / len(points)
    eigenvalues, eigenvectors = np.linalg.eigh(covariance)
    return mean, eigenvalues, eigenvectors


def rank_and_normal(points):
    """Rank of a minimal subset, and the normal of its plane by the decomposition that loses
    least."""
    _, singular, axes = np.linalg.svd(points - points.mean(axis=0))
    return int(np.sum(singular > 1e-6 * singular[0])) if singular[0] > 0 else 0, axes[-1]


def consistent_set(points, trials, h):
    """Algorithm 1: members of the maximum consistent set and its least eigenvalue."""
    k, d = points.shape
    distances = sorted(np.linalg.norm(points - points[0], axis=1))
    radius = distances[k // 2] or distances[-1] or 1.0
    candidates = []
    for row in trials:
        row = [p for p in row if p < k]
        m = d
        while (found := rank_and_normal(subset := points[row[:m]]))[0] < d - 1 and m < k:
            m = min(m + max(1, m // 2), k)
        normal = found[1]
        distances = np.abs((points - subset.mean(axis=0)) @ normal)
        # Equal to rounding is equal: the earlier member first.
        order = np.argsort(np.round(distances / radius * 2**29), kind="stable")
        chosen = order[:h]
        mean, eigenvalues, axes = plane(points[chosen])
        if eigenvalues[1] <= 1e-12 * eigenvalues[-1]:
            continue  # a line has no normal
        candidates.append((np.mean(((points[chosen] - mean) @ axes[:, 0]) ** 2), sorted(chosen)))
    best = min(least for least, _ in candidates)
    return next((m, least) for least, m in candidates if least <= best + 1e-14 * radius**2)


def mcmd_z(points, members, query):
    """Algorithm 2: inliers (Rz < 2.5) and the query's own Rz."""
    mean, _, axes = plane(points[members])
    od = (points - mean) @ axes[:, 0]
    median = np.median(od)
    mad = 1.4826 * np.median(np.abs(od - median))
    rz = np.abs(od - median) / mad
    return rz < 2.5, abs((query - mean) @ axes[:, 0] - median) / mad


def mcmd_md(points, members, query, cutoff):
    """Algorithm 3: inliers (RMD < cutoff) and the query's own RMD; covariance with n - 1."""
    mean = points[members].mean(axis=0)
    inverse = np.linalg.inv(np.cov(points[members].T))
    rmd = [np.sqrt((p - mean) @ inverse @ (p - mean)) for p in points]
    distance = np.sqrt((query - mean) @ inverse @ (query - mean))
    return np.array(rmd) < cutoff, distance


def pca(points, query):
    """Eq. 1: the plane of all members, which are all kept, and the query's distance over their
    standard deviation."""
    mean, _, axes = plane(points)
    sd = np.sqrt(np.sum(((points - mean) @ axes[:, 0]) ** 2) / (len(points) - points.shape[1]))
    return np.ones(len(points), bool), abs((query - mean) @ axes[:, 0]) / sd


# The literal form of each rule: inliers and the query's own distance, of points, the consistent
# set, the query and the cutoff.
RULES = {
    "mcmd_z": lambda points, members, query, cutoff: mcmd_z(points, members, query),
    "mcmd_md": mcmd_md,
    "pca": lambda points, members, query, cutoff: pca(points, query),
}


def parts(n, links):
    """Label of the connected part of each of n points: the first of its points."""
    labels = list(range(n))
    for i, j in links:
        low, high = sorted((labels[i], labels[j]))
        labels = [low if label == high else label for label in labels]
    return labels


def neighborhood(X, query, k):
    """Indices of the k nearest points, by sorting all distances."""
    return np.argsort(np.linalg.norm(X - query, axis=1), kind="stable")[:k]


def saliency(X, query, k, trials, h, method, cutoff):
    """Algorithm 4 for one query: own distance, normal and eigenvalues after cleaning."""
    points = X[neighborhood(X, query, k)]
    members, _ = consistent_set(points, trials, h)
    inliers, distance = RULES[method](points, members, query, cutoff)
    _, eigenvalues, axes = plane(points[inliers])
    return distance, axes[:, 0], eigenvalues


def reweighted_plane(points, trials, h):
    """Centroid, normal, scale and share kept of a neighborhood: Algorithm 1, refitted twice.

    The first scale is that of least median of squares.
    """
    k, d = points.shape
    members, _ = consistent_set(points, trials, h)
    center, _, axes = plane(points[members])
    off = np.abs((points - center) @ axes[:, 0])
    return refitted_plane(points, center, axes[:, 0], 1.4826 * (1 + 5 / (k - d)) * np.median(off))


def refitted_plane(points, center, normal, scale):
    """A plane refitted twice: scales are standard deviations of what is left of a normal law that
    is cut at 2.5."""
    off = np.abs((points - center) @ normal)
    for _ in range(2):
        kept = off < 2.5 * scale
        center, _, axes = plane(points[kept])
        off = np.abs((points - center) @ axes[:, 0])
        freedom = kept.sum() - points.shape[1]
        scale = np.sqrt(np.sum(off[kept] ** 2) / freedom / VARIANCE_LEFT)
    kept = off < 2.5 * scale
    center, _, axes = plane(points[kept])
    return center, axes[:, 0], scale, kept.mean()


def whole_plane(points):
    """The `plane` of all members; their variance about it and about a quadric over it; whether
    they deviate by noise alone, by four tests, of which each allows 1.5 standard errors."""
    k, d = points.shape
    center, _, axes = fitted = plane(points)
    z, *flat = ((points - center) @ axes).T
    products = [u * v for j, u in enumerate(flat) for v in flat[j:]]
    design = np.column_stack([np.ones(k), *flat, *products])
    terms = design.shape[1]
    left = z - design @ np.linalg.lstsq(design, z)[0]
    by_plane, by_quadric = (z @ z) / (k - d), (left @ left) / (k - terms)
    chance = ndtr(-1.5)
    gained = by_plane * (k - d) - by_quadric * (k - terms)
    noise = gained <= fdtri(terms - d, k - terms, 1 - chance) * (terms - d) * by_quadric
    noise &= np.abs(z).max() <= -ndtri(chance / (2 * k)) * z.std()
    most_skew = 1.5 * np.sqrt(6 * (k - 2) / ((k + 1) * (k + 3)))
    noise &= abs(np.mean(z**3)) <= most_skew * z.std() ** 3
    geary = np.abs(z).mean() - np.sqrt(2 / np.pi) * z.std()
    noise &= abs(geary) <= 1.5 * np.sqrt((1 - 3 / np.pi) / k) * z.std()
    return fitted, by_plane, by_quadric, noise


def robust_scale(distances):
    """The S-estimate: in units of it, squares that are one at most have a mean of one half.

    With the right number of squares that are no more than one their sum tells the unit, with any
    other number a larger one.
    """
    n = len(distances)
    within = np.arange(n // 2 + 1, n + 1)
    squares = np.cumsum(np.sort(distances**2))[within - 1] / (within - n / 2)
    return np.sqrt(squares.min())


def agreed_planes(X, near, trials, h, small_faces=False):
    """What `reweighted_plane` returns, of planes on which neighbors agree in two passes.

    `near` (n, k) are the neighbors of each of the points X, itself first. A neighborhood that
    deviates by noise alone, or by rounding, has the plane of all its members, and asks nobody.
    Planes of `small_faces` are those of a third of the members by the noise that is usual around.
    """
    planes, asks = [], []
    for members in near:
        (center, _, axes), variance, _, noise = whole_plane(X[members])
        noise |= np.sqrt(variance) <= 8 * 2.0**-52 * np.abs(center).max()
        asks.append(not noise)
        whole = center, axes[:, 0], np.sqrt(variance), 1.0
        planes.append(whole if noise else reweighted_plane(X[members], trials, h))
    for _ in range(2):
        before, planes = planes, list(planes)
        for i in np.flatnonzero(asks):
            points = X[near[i]]
            off = [np.abs((points - before[j][0]) @ before[j][1]) for j in near[i]]
            scales = [robust_scale(one) for one in off]
            center, normal, *_ = before[near[i][np.argmin(scales)]]
            k, d = points.shape
            scale = (1 + 5 / (k - d)) * min(scales)
            usual = np.quantile([before[j][2] for j in near[i]], 0.5, method="lower")
            near_it = np.abs((points - center) @ normal) < 2.5 * usual
            if small_faces and near_it.mean() >= 1 / 3:
                scale = min(scale, usual)
            planes[i] = refitted_plane(points, center, normal, scale)
    return planes


def thin(values, count, across, needed):
    """Whether the longest axis is three times one across, whose deviation has a standard error:
    `needed` points have none. Eigenvalues ascend."""
    deviations, spare = np.sqrt(np.maximum(values, 0)), count - needed
    if spare < 1 or deviations[-1] == 0:
        return False
    error = np.sqrt(count / spare) * (1 + 1 / np.sqrt(2 * spare))
    return 3 * deviations[across] * error <= deviations[-1]


def straight(points, halves=True):
    """Whether points are thin across their longest axis, and both halves of it, too, to which these
    turn by 1 in 3 at most."""
    center, values, axes = plane(points)
    if not thin(values, len(points), -2, 2) or not halves:
        return thin(values, len(points), -2, 2)
    along = (points - center) @ axes[:, -1]
    low = along - along.min() >= along.max() - along
    turns = [abs(plane(points[half])[2][:, -1] @ axes[:, -1]) for half in (low, ~low)]
    each = all(straight(points[half], halves=False) for half in (low, ~low))
    return each and np.tan(np.arccos(min(1.0, *turns))) <= 1 / 3


def judged(X, k, trials, h, noise=None, sensor=None):
    """Scores of the detector's default, by strictness; which points are on a surface; and company:
    isolation, separation and labels of groups, 0, 0 and -1 on surfaces.

    `noise` is `noise_scale`, `sensor` one position or one for each point. All distances, no tree;
    every constant stands where it is used. For clouds with more than k distinct points and without
    a step or a perfect plane.
    """
    points, first, place, counts = np.unique(X, axis=0, **dict.fromkeys(UNIQUE, True))
    n = len(points)
    gaps = np.array([np.linalg.norm(points - point, axis=1) for point in points])
    near = np.argsort(gaps, axis=1, kind="stable")[:, :k]
    planes = agreed_planes(points, near, trials, h)
    radius = [gaps[i, near[i, -1]] for i in range(n)]

    def off(i, j, sd):
        """Distance of point i from the plane of j."""
        return abs((points[i] - planes[j][0]) @ planes[j][1]) / sd

    # Surfaces: flat planes that explain each other.
    scale = [scale for _, _, scale, _ in planes]
    sd = [noise or one for one in scale]
    usable = [scale[i] <= 0.15 * radius[i] and off(i, i, sd[i]) <= 3 for i in range(n)]
    usable = np.array(usable)
    cos_25 = np.cos(np.radians(25))

    def large_parts(usable, least, counting=None, degrees=25):
        counting = np.ones(n, bool) if counting is None else counting
        least_cosine = np.cos(np.radians(degrees))

        def explain_each_other(i, j):
            near_each_other = j in near[i, :16] and i in near[j, :16]
            both = off(i, j, scale[j]) <= 3 and off(j, i, scale[i]) <= 3
            cosine = abs(planes[i][1] @ planes[j][1])
            return usable[i] and usable[j] and near_each_other and both and cosine >= least_cosine

        part = parts(n, [(i, j) for i in range(n) for j in near[i] if explain_each_other(i, j)])
        counts = {one: sum(np.array(part)[counting] == one) for one in set(part)}
        return np.array([usable[i] and counts[part[i]] >= least for i in range(n)])

    # Planes that contain the rays are no surfaces.
    scatter, ending, sheet = np.zeros(n), *np.zeros((2, n), bool)
    if sensor is not None:
        rays = LiteralRays(points, np.broadcast_to(sensor, X.shape)[first])
        scatter = rays.of_planes(planes, sd, near)
        flat = np.array([scale[i] <= 0.15 * radius[i] for i in range(n)])
        faces = flat & (scatter <= 3)
        tells = large_parts(usable, min(k, n / 5), faces & (scatter <= 1.25), 12.5)
        voters = faces, faces & tells if tells.any() else faces
        ending, sheet = (
            rays.sheets(planes, sd, near, flat & ~faces, some) & (not rays.far_away())
            for some in voters
        )
    sheet = large_parts(usable & sheet, 0.5 * min(k, n / 5))
    explains = large_parts(usable & ~sheet & ~ending, min(k, n / 5))
    distance, owner = np.full(n, np.inf), np.arange(n)
    for i in range(n):
        for j in [i] if explains[i] else near[i]:
            reached = np.linalg.norm(points[i] - planes[j][0]) <= radius[j]
            if explains[j] and (reached or i == j) and off(i, j, sd[j]) < distance[i]:
                distance[i], owner[i] = off(i, j, sd[j]), j
    explained = [i for i in range(n) if distance[i] <= 3]
    off_surface = [i for i in range(n) if distance[i] > 3]

    # Company: mean distances to 8 measurements, in spacings that are usual on surfaces around.
    def mean_of_8(i, among, copies, missing=()):
        distances = [0.0] * copies
        for j in sorted(among, key=lambda j: gaps[i, j]):
            distances += [gaps[i, j]] * (counts[j] if j != i else 0)
        return np.mean([*distances, *missing][:8])

    extent = np.linalg.norm(points.max(axis=0) - points.min(axis=0))
    to_others = [mean_of_8(i, near[i, :9], 0) for i in range(n)]
    reference = explained or range(n)
    usual, among_all, among_off_surface = {}, {}, {}
    isolation, separation = np.zeros(n), np.zeros(n)
    for i in off_surface:
        around = sorted(reference, key=lambda j: gaps[i, j])[:128]
        usual[i] = sorted(to_others[j] for j in around)[
            int((0.75 if explained else 0.5) * len(around))
        ]
        among_all[i] = mean_of_8(i, near[i, :9], counts[i] - 1)
        among_off_surface[i] = mean_of_8(i, off_surface, counts[i] - 1, [extent] * 8)
        isolation[i] = among_off_surface[i] ** (2 / 3) * among_all[i] ** (1 / 3) / usual[i]

    # Groups off the surfaces, and how far the small ones stand off from what is real.
    links = []
    for i in off_surface:
        others = sorted((j for j in off_surface if j != i), key=lambda j: gaps[i, j])[:16]
        links += [(i, j) for j in others if gaps[i, j] <= 2.5 * min(usual[i], usual[j])]
    thing = min(2 * k, len(X) / 5)

    def small_groups(links):
        group = parts(n, links)
        members = {group[i]: [j for j in off_surface if group[j] == group[i]] for i in off_surface}
        measured = {label: counts[inside].sum() for label, inside in members.items()}
        most = np.inf if explained else max(measured.values(), default=0)
        return group, members, [g for g in members if measured[g] < min(thing, most)]

    # Points in a row are a group: straight with the 8 nearest, and among the nearest of each other.
    group, members, small = small_groups(links)
    nine = {
        i: sorted(off_surface, key=lambda j: gaps[i, j])[:9]
        for i in off_surface
        if group[i] in small
    }
    nine = {
        i: nine[i] for i in nine if len(off_surface) > 8 and straight(points[nine[i]], halves=False)
    }
    part = parts(n, [(i, j) for i in nine for j in nine[i] if j in nine and i in nine[j]])
    rows = [[i for i in nine if part[i] == label] for label in {part[i] for i in nine}]
    rows = [row for row in rows if len(row) > 1 and straight(points[row])]
    in_row = {i for row in rows for i in row}
    wholes = [[i for i in inside if i not in in_row] for inside in members.values()] + rows
    links = [(i, j) for inside in wholes for i, j in pairwise(inside)]

    # Flat groups are pieces of one if they are as near to each other as to anything real, or in one
    # plane, and no more than five times as far apart as they are long, less where all is far off.
    group, members, small = small_groups(links)
    real = explained + [i for i in off_surface if group[i] not in small]
    flat = {}
    for label in small:
        inside = members[label]
        center, values, axes = plane(points[inside])
        if thin(values, len(inside), 0, X.shape[1]):
            spare = len(inside) - X.shape[1]
            error = np.sqrt(len(inside) / spare) * (1 + 1 / np.sqrt(2 * spare))
            level = center, axes[:, 0], np.sqrt(max(values[0], 0)) * error + 1e-12
            has_plane = not straight(points[inside], halves=False)
            length, to_real = np.sqrt(12 * values[-1]), gaps[np.ix_(inside, real)].min()
            flat |= dict.fromkeys(inside, (length, to_real, has_plane, *level))

    def explains(i, j):
        _, _, has_plane, center, normal, thick = flat[i]
        return has_plane and abs((points[j] - center) @ normal) <= 3 * thick

    for i in flat:
        for j in sorted(off_surface, key=lambda j: gaps[i, j])[: int(np.ceil(thing))]:
            if j in flat:
                reach, to_real = 5 * (flat[i][0] + flat[j][0]), max(flat[i][1], flat[j][1])
                if gaps[i, j] > reach or gaps[i, j] * to_real > reach**2:
                    continue
                near_enough = gaps[i, j] <= to_real
                alike = abs(flat[i][4] @ flat[j][4]) >= cos_25
                if near_enough or (alike and explains(i, j) and explains(j, i)):
                    links.append((i, j))
    group, members, small = small_groups(links)
    real = explained + [i for i in off_surface if group[i] not in small]
    things = [i for i in real if i not in explained]
    sizes = {}
    for label, inside in members.items():
        size = np.mean([usual[i] for i in inside])
        if len(inside) > 1:
            length = np.sqrt(12) if straight(points[inside]) else 1
            size = max(size, length * np.sqrt(plane(points[inside])[1][-1]))
        sizes[label] = size
        if label in small:
            # From a thing by the spacing that it has there, if that is more.
            apart = [gaps[i, j] / size for i in inside for j in explained]
            for i in inside if things else ():
                beside = sorted(things, key=lambda j: gaps[i, j])[:8]
                sparse = np.median([among_off_surface[j] for j in beside])
                apart.append(gaps[i, beside[0]] / max(size, sparse))
            separation[inside] = min(apart)
            in_row |= set(inside) if len(inside) > 1 and straight(points[inside]) else set()
        elif explained and len(inside) >= thing:  # n times as many must stand off n times as far
            size *= counts[inside].sum() / thing
            if gaps[np.ix_(inside, explained)].min() / size > 3:
                strange = [i for i in real if i not in inside]
                separation[inside] = gaps[np.ix_(inside, strange)].min() / size

    # What hangs beside a small flat group that is kept is beside something real, too.
    def lost(label):
        inside = members[label]
        apart = [max(separation[i], 0 if i in in_row else isolation[i]) for i in inside]
        is_flat = thin(plane(points[inside])[1], len(inside), 0, X.shape[1])
        return max(apart) > 3 or not is_flat

    changed = True
    while changed:
        left = [label for label in small if lost(label)]
        kept = explained + [i for i in off_surface if group[i] not in left]
        nearer = {one: gaps[np.ix_(members[one], kept)].min() / sizes[one] for one in left if kept}
        changed = [one for one in nearer if nearer[one] <= 3 < separation[members[one][0]]]
        for one in changed:
            separation[members[one]] = nearer[one]

    for i in in_row:  # it keeps company with its row
        isolation[i] = min(isolation[i], separation[i])

    # Where beams went.
    if sensor is not None:
        isolation = rays.isolation(off_surface, isolation, among_all, gaps, explained)
        separation = rays.separation(members.values(), separation, explained)
    for i in off_surface:
        reach = [j for j in near[i] if np.linalg.norm(points[i] - planes[j][0]) <= radius[j]]
        sheets = [j for j in reach if sheet[j] and off(i, j, sd[j]) <= 3]
        if sheets:
            best = min(sheets, key=lambda j: off(i, j, sd[j]))
            isolation[i] = max(isolation[i], scatter[best])

    # One score: the best excuse counts.
    scores = {}
    for strictness in ("isolated", "groups", "surfaces"):
        apart = isolation if strictness == "isolated" else np.maximum(isolation, separation)
        score = [min(distance[i], apart[i]) if i in usual else distance[i] for i in range(n)]
        if strictness == "surfaces" and explained:
            score = list(distance)
            for i in np.flatnonzero(np.isinf(distance)):
                j = min(explained, key=lambda j: gaps[i, j])
                score[i] = max(gaps[i, j] / sd[owner[j]], apart[i])
        scores[strictness] = np.array(score)[place]
    group = np.where(np.isin(range(n), off_surface), group, -1)
    return scores, np.isin(place, explained), (isolation[place], separation[place], group[place])


class GivenNeighbors:
    """Given neighborhoods of points in the place of a `NeighborIndex`."""

    def __init__(self, points, neighbors, chunk=1000):
        self.points, self.neighbors, self.chunk = points, neighbors, chunk
        self.n_neighbors = neighbors.indices.shape[1]

    def query_own(self, rows, k):
        around = self.neighbors.take(rows)
        return Neighborhoods(around.indices[:, :k], np.minimum(around.sizes, k))
