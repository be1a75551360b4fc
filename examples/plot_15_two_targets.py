"""
Two targets
===========

Two targets cross the field at the same time. Each has a track and a cluster head of its own; one node may lead both.
"""

import matplotlib.pyplot as plt

import wsnsim

result = wsnsim.simulate("two_targets", duration="14 s")
nodes, truth = result.table("nodes"), result.table("truth")

figure, axes = plt.subplots(figsize=(6, 5.4), layout="constrained")
axes.scatter(nodes["x"], nodes["y"], s=8, color="lightgrey")
for target, colour in enumerate(("tab:blue", "tab:orange")):
    track, way = result.estimates.query(f"target == {target}"), truth.query(f"target == {target}")
    heads = nodes.set_index("node").loc[track["head"].unique()]
    axes.plot(way["px"], way["py"], color="black", linewidth=1)
    axes.plot(track["px"], track["py"], color=colour, label=f"estimates of target {target}")
    axes.plot(heads["x"], heads["y"], "s", color=colour, markersize=6, label=f"its cluster heads, {len(heads)}")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
axes.legend(loc="best")
plt.show()
