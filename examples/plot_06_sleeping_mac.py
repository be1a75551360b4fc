"""
The duty cycle of a sleeping MAC
================================

With X-MAC a radio checks the channel once per wake interval. A short interval costs listening, a long one strobes.
While a target is tracked, strobes cost most. Each point is one run: single runs of an interval differ by up to a third,
so that a conclusion needs more of them (`wsnsim.sweep`).
"""

import matplotlib.pyplot as plt

import wsnsim

FIELD = {
    "name": "sleeping", "seed": 7, "duration": 8, "step": 1,
    "deploy": {"kind": "uniform", "nodes": 64, "width": 120, "height": 120},
    "motion": {"kind": "constant_velocity", "start": [-30, 3, -30, 3]},
    "sensor": {"kind": "range", "reach": 40, "sd": 1},
    "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611"},
    "link": {"kind": "log_normal"}, "clusters": {"kind": "appointed"}, "tracker": {"kind": "information_driven"},
}  # fmt: skip
INTERVALS = [0.0625, 0.125, 0.25]
results = [wsnsim.simulate(FIELD, mac={"kind": "xmac", "interval": interval}) for interval in INTERVALS]
quantities = {
    "energy [J]": [result.runs["energy"][0] for result in results],
    "radios on [%]": [100 * result.runs["radio_on"][0] for result in results],
    "median latency [s]": [(result.estimates["issued"] - result.estimates["time"]).median() for result in results],
}
figure, row = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
for axes, (name, values) in zip(row, quantities.items(), strict=True):
    axes.plot([1000 * interval for interval in INTERVALS], values, "o-")
    axes.set(xlabel="wake interval [ms]", title=name, ylim=(0, 1.15 * max(values)))
plt.show()
