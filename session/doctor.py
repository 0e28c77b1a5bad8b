"""Is this machine ready? LLVM, GPU and versions."""
from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.reconstruct.rendering import llvm
from spectrabox.session.store.keys import versions

PROBE = """
import sys
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
mi = start_mitsuba(sys.argv[1])
import drjit as dr
assert dr.all(dr.minimum(mi.Float([1.0, 2.0]), 1.5) == mi.Float([1.0, 1.5]))
print(mi.variant())
"""


def examine(device: str = "auto") -> dict[str, Any]:
    """Facts about this machine; ``ready`` is true when ``problems`` is empty.

    Dr.Jit is tried in a process of its own, since a wrong LLVM aborts the process that loads it.
    """
    problems: list[str] = []
    library = llvm.find_llvm()
    if library is None and device != "cuda":        # which needs none
        try:
            llvm.ensure_llvm()
        except EnvironmentProblem as error:
            problems.append(str(error))
    variant = _probe_variant(device, problems) if library is not None or device == "cuda" else None
    return {"ready": not problems, "problems": problems, "variant": variant,
            "llvm": None if library is None else {"version": library[1],
                                                  "library": library[0].name},
            "cores": os.cpu_count(), "python": sys.version.split()[0], "versions": versions()}


def _probe_variant(device: str, problems: list[str]) -> str | None:
    try:
        # -P: no module comes from the working folder
        outcome = subprocess.run([sys.executable, "-P", "-c", PROBE, device],
                                 capture_output=True, text=True, timeout=120, check=False)
    except subprocess.TimeoutExpired:
        problems.append("the renderer did not start within two minutes; close other programs and "
                        "try again")
        return None
    if outcome.returncode == 0:
        return outcome.stdout.split()[-1]
    last = outcome.stderr.strip().splitlines()[-1:] or ["no message"]
    how = "was aborted" if outcome.returncode < 0 else "failed"
    problems.append(f"the renderer's self-test {how} (code {outcome.returncode}): {last[0]}; "
                    f"install another LLVM, such as libllvm19, or name one with {llvm.VARIABLE}")
    return None
