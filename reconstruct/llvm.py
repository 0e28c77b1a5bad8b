"""Find an LLVM that Dr.Jit can use, before drjit is imported; fetch Debian's package where there is none.

Dr.Jit reads DRJIT_LIBLLVM_PATH once, at import. The pinned Dr.Jit 1.4 (Mitsuba 3.9.0) works with LLVM 15 and newer;
Dr.Jit 1.5 accepts 15 and 16 and then aborts the process, so for it the floor is 17. Standard library only: this file
also runs while the environment is being set up (``python -m reconstruct.llvm``).
"""
from __future__ import annotations

import ctypes
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from radiometry.errors import EnvironmentProblem

VARIABLE = "DRJIT_LIBLLVM_PATH"
ENVIRONMENT_FOLDER = Path(sys.prefix) / "lib" / "llvm"
DEBIAN_PACKAGES = ("libllvm19", "libllvm18", "libllvm17", "libllvm16", "libllvm15", "libllvm20")
PATTERNS = (
    (Path(sys.prefix) / "lib" / "llvm", "libLLVM*"),
    (Path("/usr/lib"), "*-linux-gnu/libLLVM*.so*"),
    (Path("/usr/lib"), "llvm-*/lib/libLLVM*.so*"),
    (Path("/usr/lib64"), "libLLVM*.so*"),
    (Path("/opt/homebrew/opt"), "llvm*/lib/libLLVM.dylib"),
)
ADVICE = ("install one (Debian or Ubuntu: apt install libllvm19; macOS: brew install llvm) "
          f"or set {VARIABLE} to the libLLVM file")


def oldest_usable() -> int:
    """Major version of the oldest LLVM that the installed Dr.Jit works with."""
    try:
        major, minor = (int(part) for part in importlib.metadata.version("drjit").split(".")[:2])
    except importlib.metadata.PackageNotFoundError:
        return 15
    return 15 if (major, minor) < (1, 5) else 17


def llvm_version(library: Path) -> int | None:
    """Major version of a libLLVM file, None where it cannot be loaded."""
    try:
        handle = ctypes.CDLL(str(library))
    except OSError:
        return None
    try:
        get_version = handle.LLVMGetVersion  # exported from LLVM 16 on
    except AttributeError:
        named = re.search(r"libLLVM[-.a-z]*(\d+)", library.resolve().name)
        return int(named[1]) if named else None
    parts = [ctypes.c_uint() for _ in range(3)]
    get_version(*(ctypes.byref(part) for part in parts))
    return parts[0].value


def find_llvm() -> tuple[Path, int] | None:
    """The newest usable libLLVM of this machine with its major version; an operator's own choice comes first."""
    chosen = os.environ.get(VARIABLE)
    candidates = [Path(chosen)] if chosen else [file for folder, pattern in PATTERNS for file in folder.glob(pattern)]
    unique = {file.resolve() for file in candidates if file.is_file()}
    versions = [(version, file) for file in unique if (version := llvm_version(file)) is not None]
    usable = [(version, file) for version, file in versions if version >= oldest_usable()]
    if not usable:
        return None
    version, file = max(usable)
    return file, version


def ensure_llvm() -> tuple[Path, int]:
    """Point Dr.Jit at a usable LLVM; call before the first import of drjit or mitsuba.

    Raises
    ------
    EnvironmentProblem
        If this machine has none.
    """
    found = find_llvm()
    if found is None:
        chosen = os.environ.get(VARIABLE)
        what = f"{VARIABLE} points to {chosen}, which is not a usable LLVM" if chosen else "no usable LLVM was found"
        raise EnvironmentProblem(f"{what}: version {oldest_usable()} or newer is needed; {ADVICE}")
    os.environ[VARIABLE] = str(found[0])
    return found


def fetch_llvm(folder: Path = ENVIRONMENT_FOLDER) -> None:
    """Unpack Debian's libLLVM into the environment; needs apt-get and dpkg-deb, but no root."""
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        return
    for package in DEBIAN_PACKAGES:
        with tempfile.TemporaryDirectory() as scratch:
            quiet = {"cwd": scratch, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            if subprocess.run(["apt-get", "download", "-qq", package], **quiet).returncode != 0:  # type: ignore[call-overload]
                continue
            archives = list(Path(scratch).glob("*.deb"))
            if not archives:
                continue
            subprocess.run(["dpkg-deb", "-x", str(archives[0]), "unpacked"], check=True, **quiet)  # type: ignore[call-overload]
            folder.mkdir(parents=True, exist_ok=True)
            for library in Path(scratch, "unpacked").glob("usr/lib/*/libLLVM*.so*"):
                if library.is_file() and not library.is_symlink():
                    shutil.copy2(library, folder / library.name)
        if find_llvm() is not None:
            return


def main() -> int:
    """Set-up step: make sure that the environment has a usable LLVM."""
    if find_llvm() is None:
        fetch_llvm()
    found = find_llvm()
    if found is None:
        print(f"no usable LLVM (version {oldest_usable()} or newer) was found or could be fetched: {ADVICE}",
              file=sys.stderr)
        return EnvironmentProblem.exit_code
    print(f"LLVM {found[1]}: {found[0]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
