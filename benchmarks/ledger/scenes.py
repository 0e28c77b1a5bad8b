"""Two of the public scenes, by the files that anybody gets (benchmarks/scenes)."""
from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.ledger.task import Task
from benchmarks.scenes import made, measure, render, score

SCENES = ("environment", "cornell-painted")
SPP = 256               # of the photo


def tasks(data: Path | None) -> Iterator[Task]:
    """One task for each scene."""
    for name in SCENES:
        yield Task(f"simulated/scene {name}", "00", scene, (name,))


def scene(name: str) -> dict[str, float]:
    """Figures of a scene, means over its materials."""
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written)
        made.write(name, folder)
        render.photograph(folder, SPP)
        nm, answer, _ = measure.inverted(folder)
        found = score.scored(nm, answer, *score.to_find(folder))
    return {"held": found.held, "RMSE": found.rmse, "width": found.width}
