"""The scenarios that `wsnsim new` writes, and a minimal scenario of each kind. Tests load them all.

    example_of(ROLES["motion"], "gauss_markov", ()).lines -> ("motion: {kind: gauss_markov}",)

A minimal scenario is the shipped scenario that it extends, its lines, and the files that these name.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from wsnsim.scenario.registry import Role

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


BASE: Final = "jiang_field"
"""The shipped scenario that most examples extend."""


@dataclass(frozen=True)
class Example:
    """A minimal scenario with one kind.

    Attributes:
        base: the shipped scenario that it extends.
        lines: its own lines, beside `extends` and `name`; the first one names the kind.
        files: the content of each file that the lines name.
    """

    base: str
    lines: tuple[str, ...]
    files: dict[str, str] = field(default_factory=dict)

    def text(self, name: str = "example") -> str:
        """Return the scenario as YAML."""
        return "\n".join([f"extends: {self.base}", f"name: {name}", *self.lines]) + "\n"


NODES: Final = "id,x,y\na,0,0\nb,50,0\nc,0,50\nd,50,50\n"
TRACK: Final = "time,x,y\n0,5,5\n10,30,20\n28,45,45\n"
READINGS: Final = "time,node,reading\n0,a,7.1\n1,b,44.1\n2,c,44.1\n3,d,62.2\n"
LINKS: Final = (
    '{"tx_length": 100, "interframe_duration": 100, "node_count": 2, "channels": [26]}\n'
    "datetime,src,dst,channel,mean_rssi,pdr,tx_count\n"
    "2026-01-01T00:00:00,0,1,26,-60.0,1.0,100\n2026-01-01T00:00:30,1,0,26,-61.0,0.9,100\n"
    "2026-01-01T00:01:00,0,1,26,-60.0,1.0,100\n2026-01-01T00:01:30,1,0,26,-61.0,0.9,100\n"
    "2026-01-01T00:02:00,0,1,26,-60.0,1.0,100\n2026-01-01T00:02:30,1,0,26,-61.0,0.9,100\n"
)
"""A recording of three rounds in the K7 format."""

_FAULT: Final = "at: 9 s, nodes: [0, 1]"
_SPECIAL: Final[dict[tuple[str, str], Example]] = {
    ("deploy", "file"): Example(
        BASE, ("deploy: {kind: file, path: nodes.csv, width: 100 m, height: 100 m, cover: false}",
        "motion: {kind: constant_velocity, start: [10, 1, 10, 1]}"), {"nodes.csv": NODES}),
    ("deploy", "anchors"): Example(
        "range_anchors", ("deploy: {kind: anchors, places: [[0, 0], [200, 0], [0, 200], [200, 200]]}",)),
    ("motion", "constant_acceleration"): Example("rkf", ("motion: {kind: constant_acceleration}",)),
    ("motion", "coordinated_turn"): Example(
        BASE, ("motion: {kind: coordinated_turn}", "prior: {sd: [5, 1, 5, 1, 0.05]}")),
    ("motion", "ungm"): Example("ungm_pf", ("motion: {kind: ungm}",)),
    ("motion", "waypoints"): Example(
        BASE, ("motion: {kind: waypoints, points: [[0, -50, 0], [10, 50, 0], [20, 50, 80]]}",)),
    ("motion", "recorded_track"): Example(
        BASE, ("motion: {kind: recorded_track, path: track.csv}",), {"track.csv": TRACK}),
    ("sensor", "range_from_origin"): Example("range_pf", ("sensor: {kind: range_from_origin}",)),
    ("sensor", "recorded"): Example(
        "range_anchors", ("sensor: {kind: recorded, path: readings.csv, law: {kind: range, sd: 1 m}}",
        "deploy: {kind: file, path: nodes.csv, cover: false}", "motion: {kind: recorded_track, path: track.csv}",
        "tracker: {kind: ekf}"), {"readings.csv": READINGS, "nodes.csv": NODES, "track.csv": TRACK}),
    ("sensor", "coordinate"): Example("range_anchors", ("sensor: {kind: coordinate}", "tracker: {kind: ekf}")),
    ("sensor", "rssi"): Example(BASE, ("sensor: {kind: rssi, reach: 60 m}",)),
    ("sensor", "squared"): Example("ungm_pf", ("sensor: {kind: squared}",)),
    ("sensor", "bearing"): Example(BASE, ("sensor: {kind: bearing, sd: 2 deg}", "tracker: {kind: ekf}")),
    ("sensor", "range_bearing"): Example(BASE, ("sensor: {kind: range_bearing}", "tracker: {kind: ekf}")),
    ("energy", "states"): Example(BASE, ("energy: {kind: states, radio: cc2420, processor: msp430f1611}",)),
    ("link", "recorded"): Example(
        "recorded_links", ("link: {kind: recorded, path: links.k7, channel: 26}",
        "deploy: {kind: grid, nodes: 2, cover: false}"), {"links.k7": LINKS}),
    ("mac", "tsch"): Example("li_tsch", ("mac: {kind: tsch, slotframe: 31, shared: 2}",)),
    ("packing", "frames"): Example("pso_mhpf_real", ("packing: {kind: frames}",)),
    ("sync", "ftsp"): Example(BASE, ("sync: {kind: ftsp}", "clock: {kind: drift}")),
    ("routing", "ctp"): Example("collection", ("routing: {kind: ctp}",)),
    ("workload", "beacons"): Example("beacons", ("workload: {kind: beacons, period: 1 s}",)),
    ("workload", "collection"): Example("collection", ("workload: {kind: collection, period: 30 s}",)),
    ("wakeup", "directed_flood"): Example("gmtt", ("wakeup: {kind: directed_flood}",)),
    ("wakeup", "experience_zones"): Example("tsstp", ("wakeup: {kind: experience_zones}",)),
    ("wakeup", "region"): Example("cluster", ("wakeup: {kind: region}",)),
    ("clusters", "moving_head"): Example("gmtt", ("clusters: {kind: moving_head}",)),
    ("fault", "drain"): Example(BASE, (f"faults: [{{kind: drain, {_FAULT}, joules: 1 J}}]",)),
    ("fault", "link_loss"): Example(BASE, (f"faults: [{{kind: link_loss, {_FAULT}, loss: 0.5}}]",)),
    ("fault", "clock_step"): Example(BASE, (f"faults: [{{kind: clock_step, {_FAULT}, offset: 10 ms}}]",)),
    ("fault", "bias"): Example(BASE, (f"faults: [{{kind: bias, {_FAULT}, offset: 0.5}}]",)),
    ("tracker", "rkf"): Example("rkf", ("tracker: {kind: rkf}",)),
    ("tracker", "imsf"): Example("imsf", ("tracker: {kind: imsf}",)),
    ("tracker", "grid"): Example("ungm_pf", ("tracker: {kind: grid}",)),
    ("tracker", "trilateration"): Example("range_anchors", ("tracker: {kind: trilateration}",)),
    ("tracker", "gmtt"): Example("gmtt", ("tracker: {kind: gmtt}",)),
    ("tracker", "tsstp"): Example("tsstp", ("tracker: {kind: tsstp}",)),
    ("tracker", "cluster"): Example("cluster", ("tracker: {kind: cluster}",)),
    ("tracker", "ris"): Example("ris", ("tracker: {kind: ris}",)),
}  # fmt: skip
"""The examples of kinds that need parameters, or another scenario than `BASE`."""


def example_of(role: Role, kind: str, required: tuple[str, ...]) -> Example:
    """Return the example of a kind; its `required` parameters have '...' as values if the kind is a plug-in's."""
    if found := _SPECIAL.get((role.name, kind)):
        return found
    if role.optional:
        return Example(BASE, (f"{role.listed}: [{{kind: {kind}, {_FAULT}}}]",))
    name = f'"{kind}"' if ":" in kind else kind
    values = ", ".join([f"kind: {name}", *(f"{parameter}: ..." for parameter in required)])
    return Example(BASE, (f"{role.name}: {{{values}}}",))
