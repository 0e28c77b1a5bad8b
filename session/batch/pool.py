"""What runs tasks, of a batch or of a picture: processes of this machine, or a cluster."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


class Work(Protocol):
    """A task, done on a worker by calling it; whatever goes wrong is in what it returns."""

    @property
    def tries(self) -> int:
        """How often a worker died of it, or beside it."""

    def __call__(self) -> Any:
        """Do it."""


@dataclass(frozen=True)
class Lost:
    """A task whose worker died of it, or beside it."""

    task: Any                   # Work, as it was started
    why: str


@dataclass(frozen=True)
class Finished:
    """A task and what came of it."""

    task: Any                   # Work, as it was started
    outcome: Any


def do_work(task: Work) -> Any:
    """What a worker does with a task."""
    return task()


class Pool(Protocol):
    """Workers, open between the two ends of a ``with`` block."""

    @property
    def about(self) -> str:
        """A line for the operator; empty where there is nothing to say."""

    @property
    def workers(self) -> int:
        """How many tasks run at once."""

    @property
    def budget_bytes(self) -> int | None:
        """Memory of all workers together; None where it is not known."""

    @property
    def largest_bytes(self) -> int | None:
        """Memory that one task may take; None where it is not known."""

    def start(self, task: Work) -> None:
        """Give a task to a worker that has none."""

    def wait(self) -> list[Finished | Lost]:
        """What came of tasks that have ended; waits for the first.

        Raises
        ------
        EnvironmentProblem
            If the workers are out of reach.
        """
