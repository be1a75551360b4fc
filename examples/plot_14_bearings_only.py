"""
Bearings only
=============

Each node measures nothing but the direction of the target. One bearing is a ray, several cross: the figure has the rays
of one step, the estimate with its 2σ ellipse, and the target.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

import wsnsim

STEP = 60
result = wsnsim.simulate("bearing", duration="14 s", keep=["readings"])
nodes = result.table("nodes").set_index("node")
readings = result.table("readings").query(f"step == {STEP}")
estimate, truth = (table.set_index("step").loc[STEP] for table in (result.estimates, result.table("truth")))

figure, axes = plt.subplots(figsize=(6, 5.5), layout="constrained")
for row in readings.itertuples():
    x, y = nodes.loc[row.node, ["x", "y"]]
    axes.plot([x, x + 80 * np.cos(row.reading)], [y, y + 80 * np.sin(row.reading)], color="tab:blue", alpha=0.3)
    axes.plot(x, y, "o", color="tab:blue")
cov = np.array([[estimate.sd_x**2, estimate.cov_xy], [estimate.cov_xy, estimate.sd_y**2]])
sizes, ways = np.linalg.eigh(cov)
angle = np.degrees(np.arctan2(*ways[::-1, 1]))
axes.add_patch(
    Ellipse((estimate.px, estimate.py), *(4 * np.sqrt(sizes[::-1])), angle=angle, fill=False, color="tab:red")
)
axes.plot(truth.px, truth.py, "k*", markersize=12, label="target")
axes.plot(estimate.px, estimate.py, "+", color="tab:red", markersize=12, label="estimate, 2σ")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
axes.legend()
plt.show()
