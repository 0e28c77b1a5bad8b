"""Results as they were recorded, and what has moved since.

A law says what is right; a record says what is different. Tests of laws come first; the records
of this folder notice a change that no law was written for: one number of one
step that is not what it was. Whoever changes a number on purpose records anew, reads what moved
(``git diff tests/recorded``) and says why in the commit:

    python -m pytest tests/recorded/test_recorded_calibrate_curves.py --record

Anything made of numbers, texts, arrays, dictionaries, sequences, records and enumerations is
compared. Of an array longer than ``WHOLE`` its shape, its root mean square and three sums with
fixed random weights are kept: any number that moves, or two that change places, move these. Numbers
in texts are compared as numbers.
"""
from __future__ import annotations

import dataclasses
import datetime
import enum
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).parent / "results"
WHOLE = 12              # numbers of an array that are kept one by one
DIGITS = 9              # of a number kept
SUMS = 3
NOTHING = 1e-13         # what is left of a difference of two equal numbers near one
SHOWN = 12              # numbers that moved, in a message
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w])")
Leaf = str | int | float | bool | None | dict[str, Any]


def leaves(found: object, path: str = "") -> Iterator[tuple[str, Leaf]]:
    """Path and plain value of everything that a result is made of; an array is one value.

    Raises
    ------
    TypeError
        If something is neither a value nor made of values, so that it would go unnoticed.
    """
    if isinstance(found, enum.Enum):
        yield path, str(found.value)
    elif found is None or isinstance(found, bool | np.bool_):
        yield path, None if found is None else bool(found)
    elif isinstance(found, Path):
        yield path, found.name
    elif isinstance(found, str | datetime.date):
        yield path, str(found)
    elif isinstance(found, int | float | np.number) and not isinstance(found, np.complexfloating):
        yield path, _plain(found)
    elif isinstance(found, np.ndarray):
        yield from _array_leaves(found, path)
    elif dataclasses.is_dataclass(found) and not isinstance(found, type):
        for field in dataclasses.fields(found):
            yield from leaves(getattr(found, field.name), f"{path}.{field.name}")
    elif isinstance(found, tuple) and hasattr(found, "_fields"):
        for name in found._fields:
            yield from leaves(getattr(found, name), f"{path}.{name}")
    elif isinstance(found, Mapping):
        yield f"{path}:len", len(found)
        for key, value in found.items():
            yield from leaves(value, f"{path}[{key}]")
    elif isinstance(found, Set):
        yield path, ", ".join(sorted(map(str, found)))
    elif isinstance(found, Sequence) and not isinstance(found, bytes | bytearray):
        if found and all(_is_number(each) or isinstance(each, np.number) for each in found):
            yield path, _kept(found, [len(found)])
        else:
            yield f"{path}:len", len(found)
            for number, value in enumerate(found):
                yield from leaves(value, f"{path}[{number}]")
    else:
        raise TypeError(f"{path or 'the result'} is a {type(found).__name__}, which no record "
                        "keeps: give its numbers")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plain(number: Any) -> int | float | str:
    if isinstance(number, int | np.integer):
        return int(number)
    value = float(number)
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else str(value)


def _array_leaves(found: np.ndarray, path: str) -> Iterator[tuple[str, Leaf]]:
    if found.dtype.kind in "OUS":
        yield f"{path}:shape", _kept(found.shape, [found.ndim])
        for index in np.ndindex(found.shape):
            yield from leaves(found[index], f"{path}{list(index)}")
    else:
        yield path, _kept(found.astype(float).ravel(), list(found.shape))


def _kept(numbers: Sequence[float] | np.ndarray, shape: list[int]) -> dict[str, Any]:
    """What is kept of numbers: all of a few; of many their size, and sums with fixed weights."""
    if len(numbers) <= WHOLE:
        return {"shape": shape, "values": [_plain(value) for value in numbers]}
    values = np.asarray(numbers, float)
    kept: dict[str, Any] = {"shape": shape}
    finite = np.isfinite(values)
    if not finite.all():
        kept |= {"not finite": int((~finite).sum()), "first": int(np.argmin(finite))}
    values = np.where(finite, values, 0.0)
    weights = np.random.default_rng(values.size).standard_normal((SUMS, values.size))
    sums = weights @ values / math.sqrt(values.size)
    return kept | {"rms": _plain(np.sqrt(np.mean(values**2))),
                   "sums": [_plain(value) for value in sums]}


def moved(recorded: Mapping[str, Leaf], found: Mapping[str, Leaf], rtol: float) -> list[str]:
    """One sentence for everything that is not as recorded, beyond a relative tolerance.

    Numbers of one array are compared with the largest of them, sums with the root mean square.
    """
    said = [f"{path}: recorded, not found any more" for path in recorded.keys() - found.keys()]
    said += [f"{path}: not recorded yet" for path in found.keys() - recorded.keys()]
    for path in recorded.keys() & found.keys():
        before, now = recorded[path], found[path]
        if isinstance(before, dict) and isinstance(now, dict):
            said += [f"{path}{change}" for change in _moved_numbers(before, now, rtol)]
        elif not _same(before, now, rtol):
            said.append(f"{path}: {_change(before, now)}")
    return sorted(said)


def _change(before: object, now: object) -> str:
    share = (f" ({(now - before) / before:+.2g} of it)"       # type: ignore[operator]
             if _is_number(before) and _is_number(now) and before else "")
    return f"{before!r} recorded, {now!r} now{share}"


def _moved_numbers(before: dict[str, Any], now: dict[str, Any], rtol: float) -> list[str]:
    for name in ("shape", "not finite", "first"):
        if before.get(name) != now.get(name):
            return [f", {name}: {before.get(name)} recorded, {now.get(name)} now"]
    name = "values" if "values" in before else "sums"
    finite = [abs(value) for value in before[name] if _is_number(value)]
    scale = before.get("rms", max(finite, default=0.0))
    said = [f", {name} {place}: {_change(old, new)}" for place, (old, new)
            in enumerate(zip(before[name], now[name], strict=True))
            if not _same(old, new, rtol, scale)]
    if not _same(before.get("rms"), now.get("rms"), rtol):
        said.append(f", rms: {_change(before['rms'], now['rms'])}")
    return said


def _same(before: Leaf, now: Leaf, rtol: float, scale: float = 0.0) -> bool:
    if _is_number(before) and _is_number(now) and float in (type(before), type(now)):
        limit = rtol * max(scale, abs(before)) + NOTHING    # type: ignore[arg-type]
        return bool(abs(before - now) <= limit)             # type: ignore[operator]
    if isinstance(before, str) and isinstance(now, str):
        if NUMBER.sub("#", before) != NUMBER.sub("#", now):
            return False
        numbers = zip(NUMBER.finditer(before), NUMBER.finditer(now), strict=True)
        return all(_close_as_written(old.group(), new.group(), rtol) for old, new in numbers)
    return type(before) is type(now) and before == now


def _close_as_written(before: str, now: str, rtol: float) -> bool:
    """The same number, or two whose last written digit differs by one."""
    if before == now:
        return True
    if "." not in before + now:
        return False
    mantissa = before.lower().partition("e")[0]
    step = 10.0 ** -len(mantissa.partition(".")[2])
    if "e" in before.lower():
        step *= 10.0 ** int(before.lower().partition("e")[2])
    return abs(float(before) - float(now)) <= 1.01 * step + rtol * abs(float(before))


class Record:
    """The recorded results of one test file.

    Parameters
    ----------
    file : Path
        ``results/NAME.json``.
    record : bool
        Write what is found in place of comparing it.
    """

    def __init__(self, file: Path, test: str, record: bool) -> None:
        self.file, self.test, self.record = file, test, record

    def __call__(self, found: object, rtol: float = 1e-6, case: str = "") -> None:
        """Compare a result with the one recorded for this test (and case), or record it.

        Parameters
        ----------
        found : object
            See ``leaves``.
        rtol : float
            What another processor, another order of sums or another number of cores may change.
        case : str
            For more than one result in a test.
        """
        name = f"{self.test}/{case}" if case else self.test
        now = dict(leaves(found))
        known = json.loads(self.file.read_text(encoding="utf-8")) if self.file.exists() else {}
        if self.record:
            known[name] = now
            self.file.parent.mkdir(exist_ok=True)
            self.file.write_text(_written(known), encoding="utf-8")
            return
        anew = f"python -m pytest tests/recorded/{self.file.stem}.py --record"
        assert name in known, f"nothing is recorded for {name}: {anew}"
        said = moved(known[name], now, rtol)
        more = f"\n  and {len(said) - SHOWN} more" if len(said) > SHOWN else ""
        assert not said, (f"{len(said)} of {len(now)} results of {name} are not as recorded:\n  "
                          + "\n  ".join(said[:SHOWN]) + more
                          + f"\nIf that is meant, say why in the commit and record anew: {anew}")


def _written(known: Mapping[str, Mapping[str, Leaf]]) -> str:
    """JSON with one result a line, so that a difference between two versions reads well."""
    tests = [f" {json.dumps(name)}: {{\n" + ",\n".join(
        f"  {json.dumps(path)}: {json.dumps(value)}" for path, value in known[name].items())
        + "\n }" for name in sorted(known)]
    return "{\n" + ",\n".join(tests) + "\n}\n"
