"""
Energy by cause
===============

What is energy spent on? On the ideal channel of the papers, nodes pay for what they send, receive and compute. On a
commercial radio nearly all energy is idle listening, and a radio that sleeps (X-MAC) spends a fraction of it.
"""

import matplotlib.pyplot as plt
import pandas as pd

import wsnsim

COMMON = {"duration": "6 s", "step": "1 s", "tracker.kind": "ekf", "deploy.nodes": 150}
CC2420 = {"energy": {"kind": "states", "radio": "cc2420", "processor": "nrf52840"}, "link": {"kind": "log_normal"}}
SETTINGS = {
    "ideal channel": COMMON,
    "CC2420, CSMA": COMMON | CC2420 | {"mac": {"kind": "csma"}},
    "CC2420, X-MAC": COMMON | CC2420 | {"mac": {"kind": "xmac", "interval": "125 ms"}},
}
joules = pd.DataFrame(
    {
        name: wsnsim.simulate("jiang_field", overrides=settings).energy.groupby("cause", observed=True)["joules"].sum()
        for name, settings in SETTINGS.items()
    }
).fillna(0)
print(joules.round(4))

figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
(joules / joules.sum()).T.iloc[::-1].mul(100).plot.barh(stacked=True, ax=axes, width=0.6, colormap="tab20")
axes.set(xlabel="share of the energy [%]", xlim=(0, 100))
axes.set_yticks(range(3), [f"{name}\n{joules[name].sum():.3g} J" for name in reversed(SETTINGS)])
axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
plt.show()
