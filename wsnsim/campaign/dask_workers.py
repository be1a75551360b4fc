"""The workers of a Dask scheduler: which of them can run a campaign, and which are left out, and why."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final, final

from wsnsim.base.version import __version__
from wsnsim.campaign.dask_worker import WorkerRequirements, unmet_requirement
from wsnsim.campaign.task import describe_error

ANSWER_TIMEOUT: Final = 60.0
"""Seconds for an answer of the scheduler, or of the workers through it."""


@final
class DaskWorkers:
    """The workers of a scheduler, as a campaign sees them.

    Attributes:
        usable: addresses of the workers that can run the campaign.
        left_out: {address: why} of those that cannot; they stay here when they have gone.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self.usable: set[str] = set()
        self.left_out: dict[str, str] = {}

    def look(self, required: WorkerRequirements | None) -> None:
        """Find out which workers are there, and check those that are new; without requirements, all can be used."""
        present = set(self._client.nthreads(callback_timeout=ANSWER_TIMEOUT))
        new = present - self.usable - self.left_out.keys()
        self.usable &= present
        unmet = self.unmet(new, required) if new and required else {}
        self.left_out.update(unmet)
        self.usable |= new - unmet.keys()

    def unmet(self, workers: Iterable[str], required: WorkerRequirements) -> dict[str, str]:
        """{address: what it lacks} of those of the workers that do not meet the requirements."""
        chosen = sorted(workers)
        try:
            found = self._client.run(
                unmet_requirement, required, workers=chosen, on_error="return", callback_timeout=ANSWER_TIMEOUT
            )
        except TimeoutError:
            return dict.fromkeys(chosen, "does not answer")
        answers = {worker: one for worker, one in found.items() if one and not isinstance(one, OSError)}  # it has gone
        return {worker: unreadable(one) if isinstance(one, Exception) else one for worker, one in answers.items()}

    def leave_out(self, worker: str, why: str) -> None:
        """Leave a worker out that refused a task."""
        self.usable.discard(worker)
        self.left_out.setdefault(worker, why.removeprefix(f"worker {worker} "))

    def restriction(self) -> list[str] | None:
        """The workers to which tasks are restricted: those that can be used, once one cannot; None for all."""
        return sorted(self.usable) if self.left_out else None


def unreadable(error: Exception) -> str:
    """Why a scheduler or worker cannot use what it receives."""
    return f"cannot read what it receives: is wsnsim {__version__} installed there? ({describe_error(error)})"
