"""
Error against joules
====================

A tracker may buy accuracy with packets. A point down and to the left of another is better in both; the trackers for
which there is no such point form the Pareto front, here in red.
"""

import matplotlib.pyplot as plt
import pandas as pd

import wsnsim

TRACKERS = ["pso_mhpf", "ppf", "gpf", "ekf", "ckf", "information_driven"]
points = []
for tracker in TRACKERS:
    runs = wsnsim.run("jiang_field", tracker=tracker, replicates=6, duration="4 s").runs
    points.append({"tracker": tracker, "rmse": runs["rmse"].median(), "energy": runs["energy"].median()})
table = pd.DataFrame(points).sort_values("energy")
front = table[table["rmse"].cummin() == table["rmse"]]
print(table.to_string(index=False))

figure, axes = plt.subplots(figsize=(6.5, 4.2), layout="constrained")
axes.scatter(table["energy"], table["rmse"], s=40, color="tab:blue")
axes.scatter(front["energy"], front["rmse"], s=60, color="tab:red")
for row in table.itertuples():
    axes.annotate(row.tracker, (row.energy, row.rmse), xytext=(8, -4), textcoords="offset points")
axes.set(xscale="log", yscale="log", xlabel="energy of the network [J]", ylabel="median per-run RMSE [m]")
axes.set(xlim=(0.01, 10), ylim=(0.1, 20))
plt.show()
