"""
Packet loss against distance
============================

On a log-normal link two nodes at the same distance have different links. In a network of beacons every node counts what
it receives from every other one: a dot is a link, the line the mean over links of similar length.
"""

import matplotlib.pyplot as plt
import numpy as np

import wsnsim

result = wsnsim.simulate("beacons", duration="20 s", link={"kind": "log_normal"}, keep=["links"])
links = result.table("links")
links["ratio"] = links["received"] / links["sent"]
edges = np.arange(0, links["distance"].max(), 10)
means = links.groupby(np.digitize(links["distance"], edges))["ratio"].mean()

figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
axes.plot(links["distance"], 100 * links["ratio"], ".", color="tab:blue", alpha=0.05)
axes.plot(edges[means.index - 1] + 5, 100 * means, color="tab:red", linewidth=2, label="mean over links")
axes.set(xlabel="distance [m]", ylabel="packet delivery ratio [%]")
axes.legend()
plt.show()
