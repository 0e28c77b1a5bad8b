"""The demo session: time and peak memory of each part, and the accuracy that it reaches.

Prints the time of a first run beside a second one, which finds every stage up to date, in the same
process tree.
"""
from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def spectrabox(*arguments: str) -> tuple[dict, float]:
    """Answer of one command as JSON, and its wall time in seconds."""
    start = time.perf_counter()
    outcome = subprocess.run([sys.executable, "-m", "spectrabox", *arguments, "--json"],
                             capture_output=True, text=True, check=True)
    return json.loads(outcome.stdout), time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "demo"
        from spectrabox.fixtures.demo_session import write_demo_session
        start = time.perf_counter()
        write_demo_session(folder)
        written = time.perf_counter() - start
        facts, first = spectrabox("run", str(folder))
        _, second = spectrabox("run", str(folder))
    peak_gib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    numbers = {"write_s": written, "run_s": first, "run_again_s": second,
               "ratio_again": first / second,
               "run_peak_gib": peak_gib, "median_surface_error": facts["median_surface_error"],
               "materials": facts["materials"], "stages": facts["stages"]}
    if arguments.json:
        print(json.dumps(numbers))
        return
    print(f"photos, spectra and scenes written in {written:.1f} s")
    print(f"run: {first:.1f} s, peak {peak_gib:.2f} GiB; again, nothing changed: {second:.1f} s "
          f"(ratio {first / second:.1f})")
    for stage in facts["stages"]:
        print(f"  {stage['name']:<12} {stage['seconds']:6.1f} s")
    print(f"rendered signal within {facts['median_surface_error']:.2%} of the photo (median over "
          "surfaces)")
    print(f"{'material':<10} {'RMSE mean':>10} {'RMSE inverse r.':>16} {'95 % holds':>11} "
          f"{'width':>7}")
    for material in facts["materials"]:
        print(f"{material['name']:<10} {material['rmse_mean']:>10.4f} "
              f"{material['rmse_inverse_rendering']:>16.4f} {material['coverage_95']:>11.0%} "
              f"{material['band_width']:>7.3f}")


if __name__ == "__main__":
    main()
