"""Find an LLVM that Dr.Jit can use, before drjit is imported; fetch one where there is none.

Dr.Jit reads DRJIT_LIBLLVM_PATH once, at import. The pinned Dr.Jit 1.4 (Mitsuba 3.9.0) works with
LLVM 15 and newer; Dr.Jit 1.5 accepts 15 and 16 and then aborts the process, so for it the floor is
17. What is fetched is Debian's package. Standard library only: this file also runs while the
environment is being set up (``python -m spectrabox.reconstruct.rendering.llvm``).
"""
from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.radiometry.files import whole_file

VARIABLE = "DRJIT_LIBLLVM_PATH"
ENVIRONMENT_FOLDER = Path(sys.prefix) / "lib" / "llvm"
RENDERER_NEEDS = "libatomic1"
RUNTIME_PACKAGES = ("libc6", "libgcc", "gcc-", "libstdc++", "libcrypt", "debconf", "perl", "dpkg")
DEBIAN_PACKAGES = ("libllvm19", "libllvm18", "libllvm17", "libllvm16", "libllvm15", "libllvm20")
ADVICE = ("install one (Debian or Ubuntu: apt install libllvm19; macOS: brew install llvm; "
          "Windows: winget install LLVM.LLVM; conda: conda install -c conda-forge libllvm19) "
          f"or set {VARIABLE} to the file libLLVM, on Windows LLVM-C.dll")


def search_patterns(platform: str, environment: Mapping[str, str],
                    prefixes: Sequence[str]) -> tuple[tuple[Path, str], ...]:
    """Folders in which an LLVM may lie, and patterns of its file in them.

    Parameters
    ----------
    platform : str
        As ``sys.platform``.
    environment : mapping
        Variables of the environment.
    prefixes : sequence of str
        Of this Python and of the one that its environment was made from: conda keeps LLVM there.
    """
    folders = [Path(prefix) for prefix in dict.fromkeys(prefixes)]
    if platform == "win32":
        programs = Path(environment.get("ProgramFiles", "C:/Program Files"))
        return (*((folder / "Library" / "bin", "LLVM-C.dll") for folder in folders),
                (programs / "LLVM" / "bin", "LLVM-C.dll"))
    if platform == "darwin":
        return (*((folder / "lib", "libLLVM*.dylib") for folder in folders),
                (Path("/opt/homebrew/opt"), "llvm*/lib/libLLVM.dylib"),
                (Path("/usr/local/opt"), "llvm*/lib/libLLVM.dylib"),
                (Path("/opt/local/libexec"), "llvm-*/lib/libLLVM.dylib"))
    return ((ENVIRONMENT_FOLDER, "libLLVM*"),
            *((folder / "lib", "libLLVM*.so*") for folder in folders),
            (Path("/usr/lib"), "*-linux-gnu/libLLVM*.so*"),
            (Path("/usr/lib"), "llvm-*/lib/libLLVM*.so*"),
            (Path("/usr/lib64"), "libLLVM*.so*"))


PATTERNS = search_patterns(sys.platform, os.environ, (sys.prefix, sys.base_prefix))


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


def llvm_name() -> str:
    """Name and size of the libLLVM that would be chosen by its name, which none is loaded for."""
    named = [(int(match[1]) if match else 0, file) for file in _candidates()
             for match in [re.search(r"libLLVM[-.a-z]*(\d+)", file.name)]]
    if not named:
        return "none"
    _, file = max(named)
    return f"{file.name}, {file.stat().st_size} bytes"


def _candidates() -> set[Path]:
    chosen = os.environ.get(VARIABLE)
    candidates = [Path(chosen)] if chosen else [file for folder, pattern in PATTERNS
                                                for file in folder.glob(pattern)]
    return {file.resolve() for file in candidates if file.is_file()}


def find_llvm() -> tuple[Path, int] | None:
    """The newest usable libLLVM of this machine with its major version, or None.

    An operator's own choice, in the environment variable, counts alone.
    """
    # the libraries unpacked with LLVM first: the linker then finds them by name
    waiting = [file for file in sorted(ENVIRONMENT_FOLDER.glob("lib*.so*"))
               if not file.name.startswith("libLLVM")]
    while waiting:
        left = [file for file in waiting if not _load(file)]
        if len(left) == len(waiting):
            break
        waiting = left
    versions = [(version, file) for file in _candidates()
                if (version := llvm_version(file)) is not None]
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
    newest = find_llvm()
    if newest is None:
        chosen = os.environ.get(VARIABLE)
        what = (f"{VARIABLE} points to {chosen}, which is not a usable LLVM" if chosen
                else "no usable LLVM was found in " + (_searched() or "any folder"))
        raise EnvironmentProblem(f"{what}: version {oldest_usable()} or newer is needed; {ADVICE}")
    os.environ[VARIABLE] = str(newest[0])
    return newest


@contextlib.contextmanager
def writable_home() -> Iterator[None]:
    """A HOME for the start of Dr.Jit, which keeps its compiled kernels there and aborts where it
    cannot: the user's home folder, or one that vanishes with this process.

    Cron and systemd start commands without HOME.
    """
    before = os.environ.get("HOME")
    os.environ["HOME"] = str(_home_for_kernels(before))
    try:
        yield
    finally:
        if before is None:
            del os.environ["HOME"]
        else:
            os.environ["HOME"] = before


@functools.cache
def _home_for_kernels(home: str | None) -> Path:
    candidates = [Path(home)] if home else []
    with contextlib.suppress(RuntimeError):     # no such user
        candidates.append(Path.home())
    for folder in candidates:
        with contextlib.suppress(OSError):
            (folder / ".drjit").mkdir(exist_ok=True)
            if os.access(folder / ".drjit", os.W_OK | os.X_OK):
                return folder
    scratch = tempfile.mkdtemp(prefix="spectrabox-")
    atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    return Path(scratch)


def fetch_llvm() -> None:
    """Unpack Debian's libLLVM, and the libraries that it and the renderer need, into the
    environment.

    Needs apt-get and dpkg-deb, without which it does nothing, but no root: package lists are kept
    in a scratch folder.
    """
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        return
    with tempfile.TemporaryDirectory() as scratch:
        options = _private_apt(Path(scratch))
        _quietly(["apt-get", *options, "update"], scratch)
        for package in DEBIAN_PACKAGES:
            wanted = [package, *_needed_packages(package, options), RENDERER_NEEDS]
            if _quietly(["apt-get", *options, "download", package], scratch):
                _quietly(["apt-get", *options, "download", *wanted], scratch)
                break
        for archive in Path(scratch).glob("*.deb"):
            _quietly(["dpkg-deb", "-x", str(archive), "unpacked"], scratch)
        copies: dict[Path, str] = {}
        for library in sorted(Path(scratch, "unpacked").rglob("lib*.so*")):
            if not (library.parent.name.endswith("-linux-gnu") and library.is_file()):
                continue
            copied = copies.setdefault(library.resolve(), library.name)
            if copied == library.name:
                with whole_file(ENVIRONMENT_FOLDER / copied) as unfinished:
                    shutil.copyfile(library, unfinished)
            else:       # each name must be found, but 130 MB need not lie there twice
                linked = ENVIRONMENT_FOLDER / library.name
                linked.unlink(missing_ok=True)
                os.link(ENVIRONMENT_FOLDER / copied, linked)


def _private_apt(scratch: Path) -> list[str]:
    """Options that let apt work in a scratch folder, as any user."""
    for name in ("state/lists/partial", "cache/archives/partial"):
        (scratch / name).mkdir(parents=True)
    return ["-qq", "-o", f"Dir::State={scratch}/state", "-o", f"Dir::Cache={scratch}/cache",
            "-o", "Dir::State::status=/var/lib/dpkg/status", "-o", "Debug::NoLocking=true"]


def _needed_packages(package: str, options: list[str]) -> list[str]:
    """Packages that a package depends on, but for the C and C++ runtime that Python itself
    needs.
    """
    command = ["apt-cache", *options[1:], "depends", "--recurse", "--no-recommends",
               "--no-suggests", "--no-conflicts", "--no-breaks", "--no-replaces", "--no-enhances",
               package]
    listed = subprocess.run(command, capture_output=True, text=True,
                            check=False).stdout.splitlines()
    names = {line for line in listed if line and not line.startswith((" ", "<", "|"))}
    return sorted(name for name in names - {package} if not name.startswith(RUNTIME_PACKAGES))


def _quietly(command: list[str], folder: str) -> bool:
    outcome = subprocess.run(command, cwd=folder, stdout=subprocess.DEVNULL,
                             stderr=subprocess.DEVNULL, check=False)
    return outcome.returncode == 0


def _load(library: Path) -> bool:
    try:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    except OSError:
        return False
    return True


def _searched() -> str:
    return ", ".join(str(folder / pattern) for folder, pattern in PATTERNS)


def main() -> int:
    """Set-up step: make sure that the environment has a usable LLVM."""
    if find_llvm() is None or not _load(Path("libatomic.so.1")):
        fetch_llvm()
    newest = find_llvm()
    if newest is None:
        print(f"no usable LLVM (version {oldest_usable()} or newer) was found in "
              f"{_searched() or 'any folder'}, or could be fetched: {ADVICE}", file=sys.stderr)
        return EnvironmentProblem.exit_code
    print(f"LLVM {newest[1]}: {newest[0]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
