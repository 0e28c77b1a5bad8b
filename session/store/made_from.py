"""What a report was made from, as digests: session.toml, every input file, every stored result."""
from __future__ import annotations

from typing import Any

from spectrabox.radiometry.files import sha256_of
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig
from spectrabox.session.pipeline import FinishedRun
from spectrabox.session.store.store import ARRAYS, FACTS, fingerprint


def made_from(config: SessionConfig, run: FinishedRun) -> dict[str, Any]:
    """SHA-256 by name of the file, and the fingerprint of each stage's key.

    Returns
    -------
    dict
        ``session``, ``files`` and ``results`` (names relative to the session folder), ``stages``.
    """
    files = {name: digest for stage in run.stored.values()
             for name, digest in stage.key.get("files", {}).items()}
    folder = config.results_folder.relative_to(config.folder).as_posix()
    return {"session": {FILE_NAME: config.toml_sha256}, "files": files,
            "results": {f"{folder}/{name}": digest for name, digest in digests_of(run).items()},
            "stages": {name: fingerprint(stage.key) for name, stage in run.stored.items()}}


def digests_of(finished: FinishedRun) -> dict[str, str]:
    """Digests of the stored results of all stages."""
    return {f"{name}/{part}": sha256_of(stage.folder / part)
            for name, stage in finished.stored.items() for part in (FACTS, ARRAYS)}
