"""Damaged spectral files of every format: a sentence, or a well-formed table?

With ``--data`` and pyASDReader installed, damaged copies of a real ASD file go through both
readers.

    python benchmarks/bench_mutated_files.py [--copies 10000] [--format ASD] [--data DIR] [--json]
"""
from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from spectrabox.fixtures.mutations import mutated
from spectrabox.fixtures.spectral_files import write_examples
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.spectrum_files import read_table


def tally(path: Path, original: Path, content: bytes, copies: int) -> dict[str, float]:
    """Outcomes of reading ``copies`` damaged copies, and the longest time of one."""
    counts: Counter[str] = Counter()
    longest = 0.0
    truth = read_table(original)
    for seed in range(copies):
        path.write_bytes(mutated(content, seed))
        started = time.perf_counter()
        try:
            table = read_table(path)
        except InputError:
            counts["sentence"] += 1
        except Exception as error:  # noqa: BLE001  what must not happen is what is counted here
            counts[f"CRASH {type(error).__name__}"] += 1
        else:
            sound = (table.values.shape == (len(table.names), table.nm.size)
                     and bool(np.all(np.diff(table.nm) > 0)))
            same = (np.array_equal(table.values, truth.values, equal_nan=True)
                    and np.array_equal(table.nm, truth.nm))
            counts["unchanged" if sound and same else "what the file now says" if sound
                   else "MALFORMED"] += 1
        longest = max(longest, time.perf_counter() - started)
    return {**counts, "longest_ms": round(1000 * longest, 1)}


def tally_other(path: Path, content: bytes, copies: int) -> dict[str, float] | None:
    """The same copies through pyASDReader, or None where it is not installed."""
    try:
        from pyASDReader import ASDFile
    except ImportError:
        return None
    logging.disable(logging.CRITICAL)
    counts: Counter[str] = Counter()
    for seed in range(copies):
        path.write_bytes(mutated(content, seed))
        try:
            spectrum = ASDFile(str(path)).spectrumData
        except Exception as error:  # noqa: BLE001  another package's errors are counted, all kinds
            counts[f"raises {type(error).__name__}"] += 1
        else:
            counts["no spectrum and no error" if spectrum is None else "a spectrum"] += 1
    return dict(counts)


def real_asd(path: Path, folder: Path, copies: int) -> dict[str, dict[str, float]]:
    """Damaged copies of a real file through our reader and through pyASDReader."""
    content, copy = path.read_bytes(), folder / "real.asd"
    results = {"real ASD": tally(copy, path, content, copies)}
    other = tally_other(copy, content, copies)
    return results if other is None else results | {"by pyASDReader": other}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--copies", type=int, default=2000, help="damaged copies of each format")
    parser.add_argument("--format", help="one format only")
    parser.add_argument("--data", type=Path, help="folder of real measurements, with asd/*.asd")
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    results: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        examples = write_examples(Path(folder))
        targets = {**examples, "ENVI header": examples["ENVI"].with_suffix(".hdr")}
        for name, path in targets.items():
            if arguments.format in (None, name):
                content = path.read_bytes()
                original = Path(folder) / f"original{path.suffix}"
                original.write_bytes(content)
                if name.startswith("ENVI"):
                    for suffix in (".hdr", ".sli"):
                        original.with_suffix(suffix).write_bytes(
                            examples["ENVI"].with_suffix(suffix).read_bytes())
                results[name] = tally(path, original, content, arguments.copies)
                path.write_bytes(content)
        if arguments.data is not None:
            results |= real_asd(sorted((arguments.data / "asd").glob("*.asd"))[-1], Path(folder),
                                arguments.copies)
    bad = sum(int(count) for name, result in results.items() if "pyASD" not in name
              for key, count in result.items() if key.startswith(("CRASH", "MALFORMED")))
    if arguments.json:
        print(json.dumps({"copies": arguments.copies, "bad": bad, "formats": results}))
    else:
        for name, result in results.items():
            print(f"{name:<20}" + "   ".join(f"{key} {value:g}" for key,
                                             value in sorted(result.items())))
        read = arguments.copies * sum("pyASD" not in name for name in results)
        print(f"{bad} of {read} ended in anything but a sentence or a well-formed table")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
