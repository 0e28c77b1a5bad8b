"""Is this machine ready? LLVM, GPU, versions, and whether the package names belong to spectrabox."""
from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from radiometry.errors import EnvironmentProblem
from reconstruct.llvm import ensure_llvm, find_llvm
from session.provenance import versions

OUR_PACKAGES = ("radiometry", "capture", "calibrate", "reconstruct", "sampling", "session", "fixtures")
PROBE = """
import sys
sys.path.insert(0, sys.argv[1])
from reconstruct.renderer import start_mitsuba
mi = start_mitsuba(sys.argv[2])
import drjit as dr
assert dr.all(dr.minimum(mi.Float([1.0, 2.0]), 1.5) == mi.Float([1.0, 1.5]))
print(mi.variant())
"""


def examine(device: str = "auto") -> dict[str, Any]:
    """Facts about this machine; ``ready`` is true when ``problems`` is empty.

    Dr.Jit is tried in a process of its own, since a wrong LLVM aborts the process that loads it.
    """
    problems: list[str] = []
    found = find_llvm()
    if found is None:
        try:
            ensure_llvm()
        except EnvironmentProblem as error:
            problems.append(str(error))
    variant = _probe_variant(device, problems) if found is not None or device == "cuda" else None
    problems += _strangers()
    return {"ready": not problems, "problems": problems, "variant": variant,
            "llvm": None if found is None else {"version": found[1], "library": found[0].name},
            "cores": os.cpu_count(), "python": sys.version.split()[0], "versions": versions()}


def _probe_variant(device: str, problems: list[str]) -> str | None:
    root = Path(__file__).resolve().parent.parent
    try:
        outcome = subprocess.run([sys.executable, "-c", PROBE, str(root), device], capture_output=True, text=True,
                                 timeout=120, check=False)
    except subprocess.TimeoutExpired:
        problems.append("the renderer did not start within two minutes; close other programs and try again")
        return None
    if outcome.returncode == 0:
        return outcome.stdout.split()[-1]
    last = outcome.stderr.strip().splitlines()[-1:] or ["no message"]
    how = "was aborted" if outcome.returncode < 0 else "failed"
    problems.append(f"the renderer's self-test {how} (code {outcome.returncode}): {last[0]}; "
                    "install another LLVM, such as libllvm19, and run 'make setup' again")
    return None


def _strangers() -> list[str]:
    """Packages that carry one of our names but lie elsewhere."""
    root = Path(__file__).resolve().parent.parent
    sentences = []
    for name in OUR_PACKAGES:
        spec = importlib.util.find_spec(name)
        if spec is None or spec.origin is None:
            sentences.append(f"the package {name!r} of spectrabox cannot be found: install spectrabox again")
        elif not Path(spec.origin).resolve().is_relative_to(root):
            sentences.append(f"another installed package is also called {name!r} and hides ours: "
                             "install spectrabox in an environment of its own")
    return sentences
