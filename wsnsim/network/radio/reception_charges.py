"""What receptions cost: receivers pay for the share of a frame that they listened to, and each of them is logged."""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.event_log import EACH, event
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.transmission import Transmission

DROP: Final = KIND["drop"]
NONE, RX, OVERHEARD = (EVENT_CAUSE[name] for name in ("none", "rx", "overhear"))
LEDGER: Final = {RX: CAUSE["rx"], OVERHEARD: CAUSE["overhear"]}
WHOLE: Final = 1.0


class ReceptionCharges:
    """Books receptions in the energy ledger and in the event log."""

    def __init__(self, radio: RadioServices) -> None:
        self._env = radio.env
        self._nodes = radio.nodes
        self._log = radio.log

    def charge(self, sent: Transmission, chosen: Bools, shares: Floats | None, kind: int, cause: int) -> None:
        """Charge and log the chosen neighbours, each for the share of the frame that it listened to; None: whole."""
        ids = sent.neighbours.ids[chosen]
        if not ids.size:
            return
        if shares is None:
            self._charge_group(sent, ids, WHOLE, kind, cause)
            return
        chosen_shares = shares[chosen]
        for share in np.unique(chosen_shares).tolist():
            self._charge_group(sent, ids[chosen_shares == share], share, kind, cause)

    def _charge_group(self, sent: Transmission, ids: Ints, share: float, kind: int, cause: int) -> None:
        """Charge and log different nodes (n,) for the same share of a frame."""
        nodes = self._nodes
        bits, joules, airtime = int(sent.frame.bits * share), sent.costs[2] * share, sent.costs[3] * share
        if bits == 0 or nodes.can_all_receive(ids, joules):
            self.book_group(sent, ids, share, kind, cause)
            return
        for node in ids.tolist():
            paid = nodes.spend_receive(node, joules, bits, LEDGER[cause], airtime)
            alive = nodes.alive[node]
            spent = joules * paid / bits
            self.log_each(sent, kind if alive else DROP, np.array([node]), paid, spent, cause if paid else NONE)

    def book_group(self, sent: Transmission, ids: Ints, share: float, kind: int, cause: int) -> None:
        """Charge and log different nodes (n,) for the same share of a frame, of which none of them can die."""
        bits, joules = int(sent.frame.bits * share), sent.costs[2] * share
        if bits == 0:
            self.log_each(sent, kind, ids, 0, 0.0, NONE)
            return
        self._nodes.receive_all(ids, joules, LEDGER[cause], sent.costs[3] * share)
        self.log_each(sent, kind, ids, bits, joules, cause)

    def log_each(self, sent: Transmission, kind: int, ids: Ints, bits: int, joules: float, cause: int) -> None:
        """Log the same event at each of different nodes (n,)."""
        frame = sent.frame
        self._log.add_all(
            event(self._env.now, self._log.step, frame.target, EACH, kind, frame.code, sent.number, frame.sequence,
                  sent.source, frame.packets, bits, joules, cause),
            ids,
        )  # fmt: skip
