"""
Comparing trackers
==================

Three trackers on the same networks, targets and noise. Because run r of each tracker has the same random numbers, their
errors are compared run by run: each grey line is one Monte Carlo run. In one of them ``ckf`` loses the target.
"""

import matplotlib.pyplot as plt
import pandas as pd

import wsnsim

TRACKERS = ["pso_mhpf", "ckf", "information_driven"]
runs = {
    tracker: wsnsim.run("jiang_field", tracker=tracker, replicates=12, duration="4 s").runs.set_index("replicate")
    for tracker in TRACKERS
}
errors = pd.DataFrame({tracker: table["rmse"] for tracker, table in runs.items()})
print(errors.describe().round(3))

figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
axes.plot(TRACKERS, errors.to_numpy().T, color="lightgrey", linewidth=1, zorder=1)
boxes = axes.boxplot(errors, positions=range(3), widths=0.3, patch_artist=True, zorder=2, showfliers=False)
for box, colour in zip(boxes["boxes"], ("tab:blue", "tab:orange", "tab:green"), strict=True):
    box.set(facecolor=colour, alpha=0.5)
axes.set(yscale="log", ylabel="per-run RMSE [m]", title="12 Monte Carlo runs, paired", xticks=range(3))
axes.set_xticklabels(TRACKERS)
plt.show()
