"""A session gives the same bits on one core as on several."""
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ONE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
RUN = """
import os, sys
from pathlib import Path
os.sched_setaffinity(0, {int(core) for core in sys.argv[2].split(",")})
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages
run_stages(read_session(Path(sys.argv[1])), device="auto", only=None, force=False,
           progress=lambda *_: None)
"""


def stored_files(folder):
    """Contents of the results by file, but for what says when and how fast they were made."""
    return {str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file() and path.suffix in {".npz", ".exr", ".csv", ".xml"}}


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is one core only")
def test_one_core_gives_the_bits_of_several(captured, tmp_path):
    cores = sorted(os.sched_getaffinity(0))
    again = shutil.copytree(captured, tmp_path / "again" / "box")
    as_ever = {name: value for name, value in os.environ.items() if name not in ONE}
    for folder, chosen, environment in ((captured, cores[:1], as_ever | ONE),
                                        (again, cores, as_ever)):
        subprocess.run([sys.executable, "-c", RUN, str(folder), ",".join(map(str, chosen))],
                       cwd=ROOT, check=True, env=environment, capture_output=True)
    alone, together = (stored_files(folder / "results") for folder in (captured, again))
    assert {Path(name).parts[0] for name in together} >= {"photo", "reconstruct", "sample"}
    assert [name for name in together if alone[name] != together[name]] == []
