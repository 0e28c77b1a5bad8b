"""One exception per thing an operator can fix; each knows the exit code of the command that it
ends.
"""
from __future__ import annotations

from spectrabox.radiometry.system.words import message


class SpectraboxError(Exception):
    """Base of all errors whose message is clear sentences for the operator.

    Parameters
    ----------
    *faults : str
        What is wrong, each once, one sentence for each thing to put right; most errors have one.

    Attributes
    ----------
    faults : tuple of str
        The same; the message has each on a line of its own.
    """

    exit_code = 1

    def __init__(self, *faults: str) -> None:
        # here for all: no error of ours repeats a control character or a whole file
        self.faults = tuple(dict.fromkeys(map(message, faults)))
        super().__init__("\n".join(self.faults))


class InputError(SpectraboxError):
    """A file, key or value that is missing or cannot be right."""

    exit_code = 3


class CheckError(SpectraboxError):
    """A check failed that the operator can fix: no chart in the photo, a clipped photo."""

    exit_code = 4


class ChartNotFoundError(CheckError):
    """No ColorChecker was detected in the chart photo."""


class ClippedPhotoError(CheckError):
    """Too much of the photo, or of the chart in it, is saturated."""


class UnexplainedChartError(CheckError):
    """No camera explains the patches of a chart.

    Attributes
    ----------
    worst : int
        Index, among the patches that were fitted, of the one that the others predict worst.
    alone : int or None
        Index of the one patch without which a camera explains the others, where it was looked for.
    """

    def __init__(self, sentence: str, worst: int, alone: int | None = None) -> None:
        super().__init__(sentence)
        self.worst, self.alone = worst, alone

    def __reduce__(self) -> tuple[type, tuple[str, int, int | None]]:
        return type(self), (str(self), self.worst, self.alone)


class CalibrationError(SpectraboxError):
    """The chart photo and the light do not determine what was asked of them."""

    exit_code = 5


class ConvergenceError(SpectraboxError):
    """A fit or a sampler did not reach its stated criterion."""

    exit_code = 5


class EnvironmentProblem(SpectraboxError):
    """This machine lacks something: LLVM, a GPU that was asked for, a writable folder."""

    exit_code = 7


def interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """The interrupt that an error began as: Dr.Jit wraps a Ctrl-C that falls into the tracing of a
    loop in an error of its own.
    """
    causes: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in causes:
        if isinstance(cause, KeyboardInterrupt):
            return cause
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    return None
