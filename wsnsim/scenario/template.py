"""The commented scenarios that `wsnsim new` writes. Tests load them, so that they stay valid."""

from __future__ import annotations

TEMPLATE = """\
# A scenario of wsnsim. `wsnsim check {name}.yaml` finds every issue, `wsnsim run {name}.yaml` runs it.
# Bare numbers are SI units; quantities with units such as '60 m', '50 nJ/bit' or '5 min' are read exactly.
# `wsnsim list` shows every kind of every role; `wsnsim schema > scenario.schema.json` serves editors.
name: {name}                     # also names the result: results/{name}.h5
seed: 1                          # same seed, same run
replicates: 1                    # Monte Carlo runs with independent random numbers
duration: 28 s                   # a whole number of steps, the first is the start
step: 0.04 s                     # time between measurements

prior:                           # initial distribution given to every filter
  sd: [5, 3, 5, 3]               # standard deviations of px, vx, py, vy
deploy:                          # where the nodes stand; the field is centred on the origin
  kind: uniform                  # also: grid, jittered_grid, file
  nodes: 256
  width: 400 m
  height: 400 m
  cover: true                    # redraw until every point is in range of a sensor
motion:                          # how the target moves; several targets: `targets`, a list of these
  kind: bounded_velocity
  bound: 180 m                   # the target turns back beyond it
  start: [-45, -20, -50, -35]    # px, vx, py, vy
sensor:                          # what a node measures
  kind: acoustic_energy
  reach: 60 m
  decay: 2.2
energy:                          # energy of each action; `wsnsim info {name}.yaml` lists it
  kind: first_order              # also: {{kind: states, radio: cc2420, processor: msp430f1611}}, with idle listening
  electronics: 50 nJ/bit
  amplifier: 100 pJ/bit/m2
  battery: 2 J
link:                            # which nodes receive each other
  kind: disk                     # also: log_normal, where links differ and weak frames are lost; recorded
  reach: 75 m
mac:                             # when a frame gets the channel
  kind: ideal                    # also: csma, tdma (slots in clusters); radios sleep with xmac, contikimac, tsch
clusters:                        # which node is cluster head, and until when
  kind: strongest_signal         # also: appointed (members near the prediction, without joins), central, moving_head
  handover_fraction: 0.25
  minimum_active: 3
tracker:                         # the strategy: `wsnsim list trackers`, or your own `mylab.trackers:Mine`
  kind: pso_mhpf
  particles: 400
  assumes:                       # assumptions of the filter
    gains: known
    noise_scale: 1
clock:                           # the errors of the nodes' clocks
  kind: perfect                  # also: drift; then `sync: {{kind: ftsp}}` keeps clocks together, by paid messages
faults: []                       # injected failures (`wsnsim list faults`): [{{kind: crash, at: 9 s, fraction: 0.1}}]
record:                          # which tables are recorded
  events: true
"""


OFFLINE = """\
# A scenario of wsnsim without a network: a filter on a state-space model, offline. Nothing is sent or spent.
# `wsnsim check {name}.yaml` finds every issue, `wsnsim run {name}.yaml` runs it, `wsnsim list` shows all kinds.
name: {name}                     # also names the result: results/{name}.h5
network: none                    # with a network: remove this line and add energy, link ...
seed: 1                          # same seed, same run
replicates: 20                   # Monte Carlo runs with independent random numbers
duration: 30 s                   # a whole number of steps, the first is the start
step: 1 s                        # time between measurements
lost: {{window: 4 s, limit: 20 m}} # a track with a larger error for this time is lost

prior:                           # initial distribution given to every filter
  sd: [2, 1, 2, 1]               # standard deviations of px, vx, py, vy
deploy:                          # where the sensors stand; default: one, at the origin
  kind: anchors
  places: [[0, 0], [200, 0], [0, 200], [200, 200]]
motion:                          # also: ungm, constant_acceleration, bounded_velocity, recorded_track
  kind: constant_velocity
  noise_input: diagonal          # independent process noise on each column of the state
  variances: [0.5]
  start: [70, 5, 21, 8]          # px, vx, py, vy
sensor:                          # also: rssi, coordinate, range_from_origin, squared, acoustic_energy, recorded
  kind: range
  sd: 1 m
  reach: .inf
tracker:                         # `wsnsim list trackers`, or your own: `mylab:Mine`, a class in mylab.py here
  kind: pf
  particles: 200
"""


def template(name: str, offline: bool = False) -> str:
    """Return the text of a scenario of this name, with a network or without (`offline`)."""
    return (OFFLINE if offline else TEMPLATE).format(name=name)
