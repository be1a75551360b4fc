"""The commented scenario that `wsnsim new` writes. A test loads it, so that it stays true."""

from __future__ import annotations

TEMPLATE = """\
# A scenario of wsnsim. `wsnsim check {name}.yaml` finds every fault, `wsnsim run {name}.yaml` runs it.
# Bare numbers are SI units; quantities with units such as '60 m', '50 nJ/bit' or '5 min' are read exactly.
# `wsnsim list` shows every kind of every role; `wsnsim schema > scenario.schema.json` serves editors.
name: {name}                     # also of the result: results/{name}.h5
seed: 1                          # same seed, same run
replicates: 1                    # runs with other draws from the same seed
duration: 28 s                   # a whole number of steps
step: 0.04 s                     # time between readings

prior:                           # what every filter is told at the start
  sd: [5, 3, 5, 3]               # standard deviations of px, vx, py, vy
deploy:                          # where the nodes stand; the field is centred on the origin
  kind: uniform                  # also: grid, jittered_grid, file
  nodes: 256
  width: 400 m
  height: 400 m
  cover: true                    # redraw until every point is within reach of a sensor
motion:                          # how the target moves; several targets: `targets`, a list of these
  kind: bounded_velocity
  bound: 180 m                   # beyond it, the target is turned back
  start: [-45, -20, -50, -35]    # px, vx, py, vy
sensor:                          # what a node measures
  kind: acoustic_energy
  reach: 60 m
  decay: 2.2
energy:                          # what each act costs
  kind: first_order
  electronics: 50 nJ/bit
  amplifier: 100 pJ/bit/m2
  battery: 2 J
link:                            # who hears whom
  kind: disk
  reach: 75 m
clusters:                        # who leads, and until when
  kind: strongest_signal
  handover_fraction: 0.25
  minimum_active: 3
tracker:                         # the strategy: pso_mhpf, ipf, ppf, central_pf, or your own `mylab.trackers:Mine`
  kind: pso_mhpf
  particles: 400
  assumes:                       # what the filter believes
    gains: known
    noise_scale: 1
record:                          # which tables the result holds
  events: true
"""


def template(name: str) -> str:
    """The text of a scenario of this name."""
    return TEMPLATE.format(name=name)
