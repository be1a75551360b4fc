"""
A recorded track
================

A Bluetooth beacon was carried through a room, and receivers on the walls recorded its signal strength. The same filter
runs on the recorded readings: what comes out is what a real deployment would see.
"""

import matplotlib.pyplot as plt

import wsnsim

result = wsnsim.simulate("recorded_track")
nodes, truth, estimates = result.table("nodes"), result.table("truth"), result.estimates
print(result)

figure, axes = plt.subplots(figsize=(6.5, 5), layout="constrained")
axes.plot(nodes["x"], nodes["y"], "^", color="grey", label="receivers")
axes.plot(truth["px"], truth["py"], color="black", linewidth=2, label="measured trajectory")
points = axes.scatter(estimates["px"], estimates["py"], c=estimates["error"], s=12, cmap="viridis", label="estimates")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
axes.legend(loc="best")
figure.colorbar(points, label="position error [m]")
plt.show()
