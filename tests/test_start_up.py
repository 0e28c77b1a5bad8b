"""No command imports what it does not use."""
import subprocess
import sys
from pathlib import Path

import pytest
from flat_example import write_flat

ROOT = Path(__file__).resolve().parent.parent
# Each takes a tenth of a second to seconds to import.
HEAVY = {"numpy", "scipy", "cv2", "colour", "matplotlib", "mitsuba", "drjit", "OpenImageIO",
         "rawpy", "exifread", "sklearn", "pydantic", "jinja2", "rich", "serial", "pandas"}
PHOTOS = {"cv2", "OpenImageIO", "rawpy", "exifread"}
SAMPLE = ["sample", "--sensitivity", "CIE 1931 2 Degree Standard Observer", "--light", "D65",
          "--signal", "0.3,0.4,0.2", "--noise", "0.01,0.01,0.01", "--samples", "1000", "--json"]
MAY_IMPORT = {
    "--help": (["--help"], set()),
    "--version": (["--version"], set()),
    "new": (["new", "{new}"], {"pydantic", "numpy"}),
    # Inputs of stages are read by the readers of photos, which take a quarter of a second.
    "status": (["status", "{session}"], {"pydantic", "numpy", "scipy", *PHOTOS}),
    # It runs what a run asks before it traces: the camera is fitted, the scene is opened.
    "check": (["check", "{session}"], {"pydantic", "numpy", "scipy", "mitsuba", "drjit", *PHOTOS}),
    "sample": (SAMPLE, {"pydantic", "numpy", "scipy"}),
    "camera fit": (["camera", "fit", "--chart", "{session}/photos/chart.dng", "--light",
                    "{session}/spectra/light.csv", "--json"],
                   {"pydantic", "numpy", "scipy", *PHOTOS}),
    "run": (["run", "{session}"], {"pydantic", "numpy", "scipy", "mitsuba", "drjit", "matplotlib",
                                   "jinja2", "rich", *PHOTOS}),
    # What is flat needs no renderer, and so no LLVM either.
    "run of flat samples": (["run", "{flat}"], {"pydantic", "numpy", "scipy", "matplotlib",
                                                "jinja2", "rich", *PHOTOS}),
}
SHOWN = 'print("MODULES", *sys.modules)'
RUN = f"""
import sys
sys.argv = ["spectrabox", *sys.argv[1:]]
from spectrabox.session.cli import main
try:
    main()
except SystemExit as left:
    assert not left.code, left.code
{SHOWN}
"""
FLAT_DEMO = f"""
import pathlib, sys
from spectrabox.session.demo import make_flat_demo
make_flat_demo(pathlib.Path(sys.argv[1]), 1)
{SHOWN}
"""


def modules_of(*arguments, code=RUN):
    """Names of the modules that a command has imported when it ends."""
    ran = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True,
                         check=False, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.splitlines()[-1].split()[1:]


@pytest.mark.parametrize("command", MAY_IMPORT)
def test_a_command_imports_what_it_uses(command, captured, calibrated_flat, tmp_path):
    arguments, allowed = MAY_IMPORT[command]
    imported = set(modules_of(*(word.format(session=captured, flat=calibrated_flat,
                                            new=tmp_path / "new") for word in arguments)))
    assert HEAVY & imported <= allowed


def test_the_flat_demo_is_made_without_a_renderer(tmp_path):
    imported = set(modules_of(str(tmp_path / "demo"), code=FLAT_DEMO))
    assert "numpy" in imported and not imported & {"mitsuba", "drjit"}


def test_the_status_of_flat_samples_computes_nothing(tmp_path):
    imported = set(modules_of("status", str(write_flat(tmp_path / "session"))))
    assert HEAVY & imported <= {"pydantic", "numpy"}
