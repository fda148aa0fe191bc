"""How many outliers of which kind a simulated cloud holds, and the arrays that all clouds have."""

import numpy as np
from sklearn.utils import Bunch, check_random_state


def outlier_sizes(n_samples, share, kinds, possible):
    """How many outliers of each kind: a share of all points, in (nearly) equal parts.

    Raise unless kinds are some of the possible ones, each once, and regular points are left.
    """
    kinds = list(kinds)
    unknown = [kind for kind in kinds if kind not in possible]
    if unknown or len(set(kinds)) < len(kinds) or not kinds:
        raise ValueError(
            f"outlier_kinds={kinds!r} must name, once each, one or more of {list(possible)}."
        )
    n = round(share * n_samples)
    if n >= n_samples:
        raise ValueError(f"outlier_share={share:g} leaves no regular point of {n_samples}.")
    return {kind: n // len(kinds) + (i < n % len(kinds)) for i, kind in enumerate(kinds)}


def labeled_cloud(parts, kinds, sizes, names, order, *, both, regular):
    """The cloud of echoes, then outliers, in that order.

    `names` are all kinds of outliers after "regular", `kinds` (n,) the numbers of those of echoes,
    `sizes` the numbers of outliers by kind. `both` has by name the values of echoes and of
    outliers, `regular` those of echoes and what stands for whatever is not regular.
    """
    of_regular = kinds == 0
    if not of_regular.any():
        raise ValueError("No regular point is left: give more n_samples.")
    n_outliers = sum(sizes.values())

    def join(of_echoes, of_outliers):
        of_outliers = np.broadcast_to(of_outliers, (n_outliers, *of_echoes.shape[1:]))
        return np.concatenate([of_echoes, of_outliers]).astype(of_echoes.dtype)[order]

    def truth(of_echoes, nothing):
        wide = of_regular.reshape(-1, *[1] * (of_echoes.ndim - 1))
        return join(np.where(wide, of_echoes, nothing).astype(of_echoes.dtype), nothing)

    codes = np.repeat([names.index(kind) for kind in sizes], list(sizes.values()))
    return Bunch(
        target=truth(np.ones(len(kinds), np.int64), -1),
        **{name: join(echoes, outliers) for name, (echoes, outliers) in both.items()},
        **{name: truth(echoes, nothing) for name, (echoes, nothing) in regular.items()},
        outlier_kind=join(kinds.astype(np.int8), codes),
        outlier_kind_names=names,
        surface_names=[part.name for part in parts],
    )


def streams(random_state, n):
    """One stream of random numbers a purpose: true points stay whatever noise and outliers are."""
    seed = check_random_state(random_state).randint(np.iinfo(np.int32).max)
    return np.random.default_rng(seed).spawn(n)
