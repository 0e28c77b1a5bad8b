"""Is what would be published whole? Builds it, installs it elsewhere, and runs it there.

    python docs/check_wheel.py [--platforms]

An sdist is made of this checkout, a wheel of that sdist; neither may hold a link. The wheel is
installed with pip into a new environment outside the repository, as a user would, and makes a
report there. ``--platforms`` also lets pip resolve what it would install on Linux, Windows and
macOS: nothing is installed or run, and markers such as ``sys_platform`` are read as on this
machine.
"""
from __future__ import annotations

import argparse
import json
import os
import stat
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLATFORMS = {f"Linux {machine}": [f"{tag}_{machine}" for tag in (
    "manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")]
    for machine in ("x86_64", "aarch64")}
PLATFORMS |= {"Windows": ["win_amd64"], "macOS arm64": ["macosx_14_0_arm64"],
              "macOS x86_64": ["macosx_14_0_x86_64"]}
PYTHONS = ("3.11", "3.13")
OUTSIDE = {name: value for name, value in os.environ.items()
           if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
MB = 1e6


def run(*command: object, cwd: Path, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run a command outside the checkout's environment; end with what it said if it fails."""
    done = subprocess.run([str(word) for word in command], cwd=cwd, env=OUTSIDE, text=True,
                          capture_output=True, check=False)
    if check and done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} ends in {done.returncode}\n"
                 f"{done.stdout}{done.stderr}")
    return done


def built(folder: Path) -> Path:
    """The wheel, built in ``folder`` from the sdist, neither with a link in it."""
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder, cwd=ROOT)
    sdist = next(folder.glob("*.tar.gz"))
    with tarfile.open(sdist) as archive:
        links = [member.name for member in archive if member.issym() or member.islnk()]
        archive.extractall(folder / "source", filter="data")
    source = next((folder / "source").iterdir())
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=source)
    wheel = next(folder.glob("*.whl"))
    with zipfile.ZipFile(wheel) as packed:
        links += [file.filename for file in packed.infolist()
                  if stat.S_ISLNK(file.external_attr >> 16)]
    if links:
        sys.exit(f"links in sdist or wheel: {', '.join(links)}")
    for path in (sdist, wheel):
        print(f"{path.name}: {path.stat().st_size / MB:.1f} MB, no links")
    return wheel


def install_and_run(wheel: Path, folder: Path) -> None:
    """Install the wheel into a new environment, and make a report with it."""
    environment, outside = folder / "environment", folder / "outside"
    outside.mkdir()
    # without pip: Debian's Python brings none for new environments
    run(sys.executable, "-m", "venv", "--without-pip", environment, cwd=folder)
    scripts = environment / ("Scripts" if os.name == "nt" else "bin")
    started = time.monotonic()
    run(sys.executable, "-m", "pip", "--python", scripts / "python", "install", "-q",
        "--disable-pip-version-check", wheel, cwd=outside)
    print(f"pip install: {time.monotonic() - started:.0f} s, {disk_bytes(environment) / MB:.0f} MB")
    where = run(scripts / "python", "-c", "import spectrabox; print(spectrabox.__file__)",
                cwd=outside).stdout.strip()
    if not Path(where).resolve().is_relative_to(environment.resolve()):
        sys.exit(f"spectrabox is read from {where}, not from {environment}")
    command = scripts / "spectrabox"
    print(run(command, "--version", cwd=outside).stdout.strip())
    started = time.monotonic()
    run(command, "demo", "painting", "--flat", cwd=outside)
    if not (outside / "painting" / "report.html").is_file():
        sys.exit("the flat demo wrote no report")
    print(f"spectrabox demo painting --flat: {time.monotonic() - started:.0f} s")
    print(run(command, "doctor", cwd=outside, check=False).stdout.splitlines()[0])


def disk_bytes(folder: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())


def resolve(wheel: Path, folder: Path) -> None:
    """Say for each platform whether pip finds a wheel of everything that would be installed."""
    for platform, tags in PLATFORMS.items():
        for python in PYTHONS:
            done = run(sys.executable, "-m", "pip", "install", "-q", "--dry-run", "--report", "-",
                       "--disable-pip-version-check", "--ignore-installed", "--only-binary",
                       ":all:", *(f"--platform={tag}" for tag in tags), "--python-version",
                       python, "--target", folder / "none", wheel, cwd=folder, check=False)
            faults = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
            print(f"{platform}, Python {python}: " + (
                f"{len(json.loads(done.stdout)['install'])} packages, all as wheels"
                if done.returncode == 0 else faults[-1] if faults else done.stderr.strip()),
                flush=True)


def main() -> None:
    """Check sdist, wheel and, where asked for, other platforms."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--platforms", action="store_true",
                        help="let pip resolve for Windows, macOS and Linux as well")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        wheel = built(Path(scratch))
        install_and_run(wheel, Path(scratch))
        if arguments.platforms:
            resolve(wheel, Path(scratch))


if __name__ == "__main__":
    main()
