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
