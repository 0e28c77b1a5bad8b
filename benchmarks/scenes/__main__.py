"""Make the ten scenes, render them, invert them by ``spectrabox.reconstruct_scene``, score.

    python -m benchmarks.scenes FOLDER [--only NAME ...] [--make]

FOLDER keeps scenes and photos, and in ``answers`` what was found, in the form that
``benchmarks.scenes.score`` takes. ``--make`` stops after the photos.
"""
from __future__ import annotations

import argparse
import multiprocessing
from concurrent import futures
from pathlib import Path

from benchmarks.scenes import made, measure, score


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scenes", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", choices=made.SCENES, metavar="NAME",
                        default=list(made.SCENES))
    parser.add_argument("--make", action="store_true", help="scenes and photos, no inversion")
    asked = parser.parse_args()
    (asked.folder / "answers").mkdir(parents=True, exist_ok=True)
    rows = []
    # a process for each, so that its seconds are those of one measurement from the start
    for name in asked.only:
        with futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as maker:
            maker.submit(measure.photographed, name, asked.folder / name).result()
        if not asked.make:
            with futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as inverter:
                rows.append(inverter.submit(measure.measured, name, asked.folder).result())
            print("  ".join(rows[-1]), flush=True)
    if rows:
        print(score.markdown(measure.HEAD, rows))


if __name__ == "__main__":
    main()
