"""The four kinds of outliers that a street scan holds."""

import numpy as np

from sklearn_mcmd.datasets._surfaces import Foliage

CLEARANCE = 4.0  # outliers keep so many noise standard deviations from every true surface
_LEAST_ACCEPTANCE = 0.005  # below this share of usable proposals there is no room to draw in
_ENOUGH = 5000  # proposals that show it


def gaussian(scene, n, is_clear, rng):
    """Points of the surfaces, displaced at random on each axis."""
    solid = [part for part in scene.parts if not isinstance(part, Foliage)]
    areas = np.array([part.area for part in solid])

    def propose(m):
        counts = rng.multinomial(m, areas / areas.sum())
        origin = np.concatenate([p.sample(c, rng) for p, c in zip(solid, counts, strict=True)])
        return rng.permutation(origin + rng.normal(scale=scene.displacement, size=(m, 3)))

    return draw_clear(n, is_clear, propose)


def uniform(scene, n, is_clear, rng):
    """Points anywhere in the scene's bounding box."""
    low, high = scene.bounds
    return draw_clear(n, is_clear, lambda m: rng.uniform(low, high, (m, 3)))


def mixed_pixel(scene, n, is_clear, rng):
    """Points between an outline and what lies behind it, on one ray of a scanner.

    A beam that is cut by an outline returns a mean of the two ranges. Rays leave the scanner
    within 3 milliradians (a standard deviation) of visible outlines; those which pass and meet a
    background at least 15 cm behind give a point in between.
    """
    lengths = np.array([part.outline_length for part in scene.parts])
    reach = 2 * np.linalg.norm(np.diff(scene.bounds, axis=0)) + scene.farthest_range

    def propose(m):
        counts = rng.multinomial(m, lengths / lengths.sum())
        outline = np.concatenate(
            [
                part.sample_outline(count, rng, scene.scanner)
                for part, count in zip(scene.parts, counts, strict=True)
                if count
            ]
        )
        outline = rng.permutation(outline[scene.visible(outline, tolerance=1e-3)])
        ray = outline - scene.scanner
        near = np.linalg.norm(ray, axis=1, keepdims=True)
        ray = ray / near + rng.normal(scale=0.003, size=ray.shape)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        far = reach * scene.first_hit(scene.scanner + reach * ray)[:, None]
        passes = (np.isfinite(far) & (far > near + 0.15))[:, 0]
        near, far, ray = near[passes], far[passes], ray[passes]
        return scene.scanner + ray * (near + rng.uniform(0.05, 0.95, near.shape) * (far - near))

    return draw_clear(n, is_clear, propose)


def ghost(scene, n, is_clear, rng):
    """Dense balls of 10 to 60 points, 5 to 10 cm in radius, floating off the surfaces."""
    low, high = scene.bounds
    sizes = cluster_sizes(n, rng)
    radii = rng.uniform(0.05, 0.10, len(sizes))
    centers = draw_clear(
        len(sizes), lambda points: is_clear(points, 0.25), lambda m: rng.uniform(low, high, (m, 3))
    )
    direction = rng.standard_normal((n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    reach = np.repeat(radii, sizes)[:, None] * np.cbrt(rng.random((n, 1)))
    return np.repeat(centers, sizes, axis=0) + reach * direction


#: Maker of each kind. The order sets the codes: position + 1, as 0 means no outlier.
SCENE_OUTLIERS = {make.__name__: make for make in (gaussian, uniform, mixed_pixel, ghost)}


def draw_clear(n, is_clear, propose):
    """n proposed points (rows) that are clear of the scene."""
    kept = []
    missing, proposed, usable = n, 0, 0
    while missing > 0:
        if usable < _LEAST_ACCEPTANCE * proposed and proposed > _ENOUGH:
            raise ValueError(
                f"noise leaves no room for outliers: under {_LEAST_ACCEPTANCE:.1%} of candidates "
                f"are farther than {CLEARANCE:g} standard deviations from the scene's surfaces. "
                "Lower noise or noise_growth, or set outlier_share=0."
            )
        # As many as the acceptance so far calls for, within reason.
        rate = min(1.2 * proposed / max(usable, 1), 20.0) if proposed else 1
        n_more = 64 + int(rate * missing)
        points = propose(n_more)
        clear = points[is_clear(points)]
        proposed, usable = proposed + n_more, usable + len(clear)
        kept.append(clear[:missing])
        missing -= len(kept[-1])
    return np.concatenate(kept) if kept else np.empty((0, 3))


def cluster_sizes(n, rng):
    """Sizes of 10 to 60 points that sum to n (fewer than 10 points make one small cluster)."""
    if n == 0:
        return np.zeros(0, int)
    n_clusters = max(1, round(n / 35))
    if n_clusters == 1:
        return np.array([n])
    sizes = rng.integers(10, 61, n_clusters)
    surplus = sizes.sum() - n
    if surplus > 0:
        return sizes - rng.multivariate_hypergeometric(sizes - 10, surplus, method="marginals")
    return sizes + rng.multivariate_hypergeometric(60 - sizes, -surplus, method="marginals")
