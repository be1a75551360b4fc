"""
Energy over the field
=====================

Where do batteries empty first? The heat map has the energy that each node spent, interpolated between the nodes, and
the trajectory of the target above it: the nodes beside the target pay.
"""

import matplotlib.pyplot as plt

import wsnsim

result = wsnsim.simulate("pso_mhpf", duration="12 s")
nodes, truth = result.table("nodes"), result.table("truth")
spent = 1000 * (nodes["energy_initial"] - nodes["energy_left"])

figure, axes = plt.subplots(figsize=(6.5, 5.2), layout="constrained")
levels = axes.tricontourf(nodes["x"], nodes["y"], spent, levels=14, cmap="YlOrRd")
axes.plot(nodes["x"], nodes["y"], ".", color="black", markersize=2, alpha=0.5)
axes.plot(truth["px"], truth["py"], color="tab:blue", linewidth=2, label="target")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
axes.legend(loc="upper right")
figure.colorbar(levels, label="energy spent [mJ]")
plt.show()
