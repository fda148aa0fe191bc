"""
Which part of a facade has moved, and is it surely more than noise?
===================================================================

A facade is scanned twice. Between the scans a bay has moved by 8 mm, twice the noise of one
point, and the second scan's registration is off by 1 mm. Its scanner has noise that is alike in
each of its rows. `CloudChange` takes the distance of robust planes along the normals, and tells for
each point from which distance on a movement is significant.

Wall and street stay. The car has left, so its roof has moved down to the street.
"""

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import CloudChange
from sklearn_mcmd.plotting import plot_cloud

rng = np.random.default_rng(0)


# %%
# A street of 14 m, a facade with a bay, and a car.
def scan(bay=0.0, car=True, registration=0.0):
    street = rng.uniform(0, 1, (16_000, 3)) * [14, 5, 0]
    facade = rng.uniform(0, 1, (30_000, 3)) * [14, 0, 7] + [0, 5, 0]
    inside = (np.abs(facade[:, 0] - 9.5) < 1.5) & (facade[:, 2] > 2)
    facade[inside, 1] -= 0.4 + bay
    roof = rng.uniform(0, 1, (2_500, 3)) * [4, 1.8, 0] + [2, 1.5, 1.4]
    below = (np.abs(street[:, 0] - 4) < 2) & (np.abs(street[:, 1] - 2.4) < 0.9)
    parts = [street[~below], facade, roof] if car else [street, facade]
    xyz = np.vstack(parts)
    row = (50 * xyz[:, 2]).astype(int)
    xyz += rng.normal(0, 0.004, xyz.shape)
    xyz[:, 1] += rng.normal(0, 0.001, row.max() + 1)[row] + registration
    return xyz


before, after = scan(), scan(bay=0.008, car=False, registration=0.001)
changes = CloudChange(registration=0.001, random_state=0).fit(before).compare(after)
moved = changes.significant
bay = (np.abs(before[:, 0] - 9.5) < 1.3) & (before[:, 2] > 2.2) & (before[:, 1] > 4)
wall = (before[:, 1] > 4.9) & (before[:, 2] > 0.3) & (np.abs(before[:, 0] - 9.5) > 1.7)
print(f"of the bay   {moved[bay].mean():.0%} moved, by {np.nanmedian(changes.distance[bay]):.4f} m")
print(f"of the wall  {moved[wall].mean():.1%}")
print(f"one distance alone is significant from {np.nanmedian(changes.level_of_detection):.4f} m on")

# %%
# Left: the distance, blue toward the street. Right: what is significant, in red.
figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained")
shown = changes.reason == 0
colors = plt.get_cmap("coolwarm")(0.5 + 50 * changes.distance[shown])
plot_cloud(before[shown], color=colors, ax=axes[0])
axes[0].set_title("distance, from -1 cm (blue) to 1 cm (red)", fontsize=12)
plot_cloud(before, outliers=moved, ax=axes[1])
axes[1].set_title(f"{moved.sum():,} points moved", fontsize=12)
plt.show()
