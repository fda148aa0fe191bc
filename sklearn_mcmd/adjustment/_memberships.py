"""Memberships of the fuzzy approach, one function for each equation (of Eqs 11-20).

Decisions are made in complement form, ``1 - m_H`` against ``1 - C_H``: in a large cloud both
m_H and C_H differ from 1 by 1e-3 to 1e-11, and numbers so close to 1 would lose their digits.
"""

import numpy as np


def abnormal_residual_membership(statistic, redundancy, critical, width):
    """m_M: how abnormal a residual is, 1/2 at ``critical + width sqrt(r)`` (Eq. 11).

    The statistic is W_i, the redundancy r_ii, the critical value ``N_{1 - alpha/2}``. The paper
    prints the width as alpha. It is a distance on the axis of the statistic, not a probability.
    """
    with np.errstate(divide="ignore"):
        return 1 / (1 + 1 / _squared_excess(statistic, redundancy, critical, width))


def normal_residual_membership(statistic, redundancy, critical, width):
    """m_N = 1 - m_M, accurate also where m_M is about 1 (Eq. 12)."""
    return 1 / (1 + _squared_excess(statistic, redundancy, critical, width))


def normal_error_complement(effect_on_normal, normal_residual):
    """1 - m_B: error that acts on normal residuals (Eq. 16).

    m_H, the larger of m_A and m_B (Eq. 18), is always m_B:
    ``1 - r~n m_N >= 1 - m_N = m_M >= r~m m_M``. So Eqs 14 and 15 change nothing.
    """
    return effect_on_normal * normal_residual


def defuzzification_complement(complement, effect_on_normal, normal_residual, weighting):
    """1 - C_H: weighted mean of 1 - m_H (Eq. 19), with the weights P of Eq. 20's second line; its
    first never applies, see Eq. 18.

    "ratio" is the paper's ``m_B / m_N = 1 / m_N - r~n``. It has no bound: one huge outlier
    decides the limit alone and masks the others. "cut", ``1 - r~n``, is bounded.
    """
    if weighting == "cut":
        weights = 1 - effect_on_normal
        products = weights * complement
    else:
        with np.errstate(divide="ignore"):
            weights = 1 / normal_residual - effect_on_normal
        # P (1 - m_H) is simplified, because m_N may be 0.
        products = effect_on_normal * (1 - complement)
    total = weights.sum()
    return float(products.sum() / total) if total > 0 else 0.0


def _squared_excess(statistic, redundancy, critical, width):
    """``(W - N)^2 / (r width^2)``, 0 up to the critical value."""
    excess = np.maximum(statistic - critical, 0.0)
    with np.errstate(over="ignore"):
        return (excess / width) ** 2 / np.maximum(redundancy, np.finfo(float).tiny)
