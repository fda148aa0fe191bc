"""Box plots and bars, with one color for each method."""

import numpy as np

# Okabe and Ito's colors, which color-blind people can distinguish, two grays, and three of Tol's.
COLORS = {
    "PCA": "#555555",
    "RANSAC": "#E69F00",
    "MSAC": "#F0E442",
    "RPCA": "#009E73",
    "uLSIF": "#CC79A7",
    "qSp": "#999999",
    "MCMD_Z": "#0072B2",
    "MCMD_MD": "#D55E00",
    "reweighted": "#56B4E9",
    "default": "#332288",
    "LOF": "#117733",
    "IsolationForest": "#882255",
    "EllipticEnvelope": "#AA4499",
}
# Other readings of a method are drawn in its color.
FALLBACK = {
    "MCMD_MD h=.5n": "MCMD_MD",
    "MCMD_MD h=.5k": "MCMD_MD",
    "PCA, default growth": "PCA",
    "RANSAC sigma=.1": "RANSAC",
    "RPCA rrcov": "RPCA",
}


def color(name):
    return COLORS[FALLBACK.get(name, name)]


def boxes(ax, angles, title):
    """Box plots of the angles by method, with whiskers of 1.5 quartile ranges as in the paper."""
    drawn = ax.boxplot(
        list(angles.values()),
        tick_labels=list(angles),
        patch_artist=True,
        flierprops={"marker": "+", "markersize": 3, "markeredgecolor": "#888888"},
        medianprops={"color": "black"},
    )
    for box, name in zip(drawn["boxes"], angles, strict=True):
        box.set(facecolor=color(name), alpha=0.8)
    ax.tick_params(axis="x", rotation=45)
    for label in ax.get_xticklabels():
        label.set(ha="right", rotation_mode="anchor")
    ax.set(title=title, ylabel="bias angle, degrees")


def printed_means(ax, means):
    """The paper's means, as crosses on box plots."""
    ax.plot(range(1, len(means) + 1), means, "rx", label="paper's mean", zorder=5)
    ax.legend()


def bars(ax, ours, printed, title, xlabel):
    """A bar of percentages for each method; the paper's percentages are black ticks."""
    height = np.arange(len(ours))
    ax.barh(height, list(ours.values()), 0.6, color=[color(name) for name in ours])
    ticks = [printed.get(name, np.nan) for name in ours]
    ax.plot(ticks, height, "k|", markersize=16, markeredgewidth=2)
    ax.set_yticks(height, list(ours))
    ax.set(title=title, xlim=(0, 102), xlabel=xlabel)
