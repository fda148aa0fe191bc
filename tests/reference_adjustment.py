"""The second paper's equations as they are printed: dense matrices, one line an equation.

The oracle of the tests of `sklearn_mcmd.adjustment`; no code is shared with it.
"""

import numpy as np
from scipy import stats


def frame(X, p, surface):
    """A, l for all points, the plane being that of weights p."""
    if surface == "vertical":
        center = np.average(X, axis=0, weights=p)
        local = X - center
        scale = np.sqrt(np.average(local**2, axis=0, weights=p))[:-1]
        scale[scale <= 1e-12 * np.abs(center[:-1])] = np.inf
        scale[scale == 0] = np.inf
        return np.column_stack([local[:, :-1] / scale, np.ones(len(X))]), local[:, -1]
    center = np.average(X, axis=0, weights=p)
    local = X - center
    axes = np.linalg.svd(local * np.sqrt(p)[:, None], full_matrices=True)[2]
    scale = np.sqrt(np.average((local @ axes[:-1].T) ** 2, axis=0, weights=p))
    return np.column_stack([local @ axes[:-1].T / scale, np.ones(len(X))]), local @ axes[-1]


def redundancy_matrix(X, p=None, surface="vertical"):
    """R = I - A (A'PA)^-1 A'P (Eq. 9)."""
    p = np.ones(len(X)) if p is None else p
    A, _ = frame(X, p, surface)
    N = A.T @ (p[:, None] * A)
    return np.eye(len(X)) - A @ np.linalg.pinv(N, rcond=1e-11, hermitian=True) @ (A * p[:, None]).T


def adjustment(X, p=None, surface="vertical"):
    """Residuals l - A x, redundancy numbers, v'Pv and rank."""
    p = np.ones(len(X)) if p is None else p
    A, observed = frame(X, p, surface)
    R = redundancy_matrix(X, p, surface)
    v = R @ observed
    rank = np.linalg.matrix_rank(A * np.sqrt(p)[:, None], tol=1e-5 * np.sqrt(p.sum()))
    return v, np.diag(R), v @ (p * v), rank


def local_level(alpha, n, correction):
    if correction == "none":
        return alpha
    return alpha / n if correction == "bonferroni" else 1 - (1 - alpha) ** (1 / n)


def critical(test, level, f):
    """Table 1."""
    if test == "w":
        return stats.norm.isf(level / 2)
    if f < 1:
        return np.inf
    if f == 1:
        return 1.0 if test == "tau" else np.inf
    t = stats.t(f - 1).isf(level / 2)
    return t if test == "t" else np.sqrt(f * t**2 / (f - 1 + t**2))


def statistic(v, r, p, omega, f, test, sigma0):
    """Table 1, for a diagonal weight matrix."""
    size = np.where(r > 1e-10, np.sqrt(p) * np.abs(v) / np.sqrt(np.maximum(r, 1e-300)), 0.0)
    if test == "w":
        return size / sigma0
    tau = size / np.sqrt(omega / f)
    if test == "tau":
        return tau
    # The scale with observation i left out.
    left_out = (omega - size**2) / (f - 1)
    return size / np.sqrt(np.maximum(left_out, 1e-300))


def snoop(
    X, p=None, *, alpha, test="w", sigma0=1.0, correction="sidak", single=True, surface="vertical"
):
    """Rounds of removal, each with a full adjustment; returns the round of each point."""
    p = np.ones(len(X)) if p is None else p
    step, support, k = np.zeros(len(X), dtype=int), p > 0, 0
    while True:
        members = np.flatnonzero(support)
        v, r, omega, u = adjustment(X[members], p[members], surface)
        f = len(members) - u
        level = local_level(alpha, len(members), correction)
        T = statistic(v, r, p[members], omega, f, test, sigma0)
        bad = critical(test, level, f) < T
        if test != "w" and f == 1:  # tau is 1, and so is its limit
            bad[:] = False
        if not bad.any():
            return step
        k += 1
        out = members[[np.argmax(T.max() * (1 - 1e-10) <= T)]] if single else members[bad]
        step[out] = k
        if len(members) - len(out) <= u:
            return step
        support[out] = False


def fuzzy(X, p=None, *, alpha, width, weighting="ratio", sigma0=1.0, test="w", surface="vertical"):
    """Eqs 9-21 with the n x n matrix; labels and every membership."""
    n = len(X)
    p = np.ones(n) if p is None else p
    R = redundancy_matrix(X, p, surface)
    v, r, omega, u = adjustment(X, p, surface)
    W = statistic(v, r, p, omega, n - u, test, sigma0)
    N = critical(test, alpha, n - u)
    m_M = np.zeros(n)
    above = W > N
    m_M[above] = 1 / (1 + r[above] * (width / (W[above] - N)) ** 2)  # Eq. 11
    # Eq. 12, in the form that keeps the digits of a small m_N.
    m_N = np.ones(n)
    q = r[above] * (width / (W[above] - N)) ** 2
    m_N[above] = q / (1 + q)
    relative = np.abs(R) / np.abs(R).max()  # Eq. 13
    M5 = m_M >= 0.5
    r_m = relative[M5].max(axis=0, initial=0.0)  # Eq. 14
    r_n = relative[~M5].max(axis=0, initial=0.0)  # Eq. 17
    m_A = r_m * m_M  # Eq. 15
    m_B = 1 - r_n * m_N  # Eq. 16
    m_H = np.maximum(m_A, m_B)  # Eq. 18
    G = r_n * m_N
    P = 1 / m_N - r_n if weighting == "ratio" else 1 - r_n  # Eq. 20
    K = (P * G).sum() / P.sum() if P.sum() > 0 else 0.0  # 1 - Eq. 19
    labels = np.where(G <= K, -1, 1) if M5.any() else np.ones(n, dtype=int)  # Eq. 21
    return {
        "labels": labels,
        "m_M": m_M,
        "m_A": m_A,
        "m_B": m_B,
        "m_H": m_H,
        "complement": K,
        "M5": M5,
    }
