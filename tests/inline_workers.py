"""Workers that do their tasks in this process, as they are given."""
from concurrent.futures import Executor, Future

from spectrabox.session.batch.executors import Workers


class Inline(Executor):
    """An executor that notes its tasks, those that run at once in one list."""

    def __init__(self, work):
        self.work, self.rounds = work, []

    def submit(self, task):
        self.rounds[-1].append(task)
        future = Future()
        future.set_result(self.work(task))
        return future

    @property
    def tasks(self):
        """All that were given, in their order."""
        return [task for together in self.rounds for task in together]


def inline_workers(work=lambda task: task(), workers=1, total_bytes=None, worker_bytes=None):
    """The executor and its ``Workers``; ``work`` is done in place of calling a task."""
    executor = Inline(work)

    def capacity():
        executor.rounds.append([])
        return workers, total_bytes, worker_bytes

    return executor, Workers("", capacity, lambda count: executor)
