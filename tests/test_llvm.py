import subprocess
import sys
from pathlib import Path

import pytest

from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.reconstruct.rendering import llvm

ROOT = Path(__file__).resolve().parent.parent


def test_this_machine_has_a_usable_llvm():
    library, version = llvm.ensure_llvm()
    assert version >= llvm.oldest_usable() and library.is_file()


def test_a_wrong_choice_is_named_with_what_to_do(monkeypatch, tmp_path):
    fake = tmp_path / "libLLVM-19.so"
    fake.write_text("no library")
    monkeypatch.setenv(llvm.VARIABLE, str(fake))
    with pytest.raises(EnvironmentProblem,
                       match=r"not a usable LLVM: version 15 or newer is needed; install one"):
        llvm.ensure_llvm()


def test_no_llvm_at_all_is_said(monkeypatch):
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "PATTERNS", ())
    with pytest.raises(EnvironmentProblem, match="no usable LLVM was found"):
        llvm.ensure_llvm()


@pytest.mark.parametrize("platform, file", [
    ("linux", "prefix/lib/libLLVM-19.so"), ("linux", "base/lib/libLLVM.so.20.1"),
    ("darwin", "prefix/lib/libLLVM.19.1.dylib"), ("win32", "prefix/Library/bin/LLVM-C.dll"),
    ("win32", "Programs/LLVM/bin/LLVM-C.dll")])
def test_llvm_is_looked_for_where_installers_and_conda_put_it(platform, file, tmp_path,
                                                              monkeypatch):
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text("library")
    patterns = llvm.search_patterns(platform, {"ProgramFiles": str(tmp_path / "Programs")},
                                    (str(tmp_path / "prefix"), str(tmp_path / "base")))
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "PATTERNS", [pattern for pattern in patterns
                                           if pattern[0].is_relative_to(tmp_path)])
    assert llvm.llvm_name() == f"{Path(file).name}, 7 bytes"
    with pytest.raises(EnvironmentProblem, match="winget install") as said:
        llvm.ensure_llvm()      # what is there cannot be loaded
    assert str(tmp_path / "prefix") in str(said.value)


@pytest.mark.parametrize("drjit, oldest", [("1.4.0", 15), ("1.5.0", 17), ("2.0.1", 17)])
def test_the_floor_follows_the_installed_drjit(monkeypatch, drjit, oldest):
    monkeypatch.setattr(llvm.importlib.metadata, "version", lambda name: drjit)
    assert llvm.oldest_usable() == oldest


def test_setting_up_without_llvm_ends_in_one_sentence(monkeypatch, capsys):
    monkeypatch.setattr(llvm, "PATTERNS", ())
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "fetch_llvm", lambda: None)
    assert llvm.main() == 7
    assert "install one (Debian or Ubuntu: apt install libllvm19" in capsys.readouterr().err


def test_finding_llvm_needs_the_standard_library_only():
    code = ("import sys; import spectrabox.reconstruct.rendering.llvm; "
            "sys.exit(bool({'numpy', 'drjit', 'mitsuba'} & set(sys.modules)))")
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
