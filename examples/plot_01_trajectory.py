"""
Trajectory and estimates
========================

A target crosses a field of 256 nodes, and PSO-MHPF (Jiang, Song, Lin 2013) follows it. The figure has the nodes, the
ground-truth trajectory and the estimates, with a mark where a new cluster head took over.
"""

import matplotlib.pyplot as plt

import wsnsim

result = wsnsim.simulate("pso_mhpf", duration="12 s")
print(result)

nodes, truth, estimates = result.table("nodes"), result.table("truth"), result.estimates
handovers = estimates[estimates["head"].diff().fillna(0) != 0]

figure, axes = plt.subplots(figsize=(6, 5.4), layout="constrained")
axes.scatter(nodes["x"], nodes["y"], s=10, color="lightgrey", label="nodes")
axes.plot(truth["px"], truth["py"], color="black", linewidth=1.5, label="ground truth")
axes.plot(estimates["px"], estimates["py"], color="tab:blue", linewidth=1, label="estimates")
axes.plot(handovers["px"], handovers["py"], "o", color="tab:red", markersize=5, label="handovers")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="PSO-MHPF on the field of Jiang (2013)")
axes.legend(loc="upper right")
plt.show()
