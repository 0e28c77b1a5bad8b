"""The import rule of docs/architecture.md, read from the code's own imports."""
import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
STAGES = ("capture", "calibrate", "reconstruct", "sampling")
PACKAGES = ("radiometry", *STAGES, "session", "fixtures")
MAY_IMPORT = {"radiometry": {"radiometry"}, **{stage: {"radiometry", stage} for stage in STAGES},
              "session": {*PACKAGES}, "fixtures": {"fixtures", "radiometry"}}
EXCEPTIONS = {("fixtures/box_render.py", "reconstruct.llvm"): "drjit aborts on a wrong LLVM, whoever imports it"}
OWNERS = {"serial": ("capture/serial_line.py",), "rawpy": ("capture/raw.py",), "exifread": ("capture/metadata.py",),
          "cv2": ("capture/chart_detection.py", "calibrate/geometry.py"),  # pixels of a chart; a lens and its pose
          "OpenImageIO": ("capture/image_files.py",), "colour": ("radiometry/",),
          "mitsuba": ("reconstruct/", "fixtures/"), "drjit": ("reconstruct/", "fixtures/"),
          "typer": ("session/cli.py", "session/command_line.py", "session/commands/")}
EXTRA_OWNERS = {("fixtures/demo_photos.py", "colour"), ("fixtures/paints.py", "colour"),
                ("fixtures/lamp.py", "colour"), ("fixtures/demo_session.py", "colour")}


def modules():
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def imports_of(path, top_level_only=False):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = tree.body if top_level_only else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def name_of(path):
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_imports_point_down(path):
    package = path.relative_to(ROOT).parts[0]
    for module in imports_of(path):
        top = module.split(".")[0]
        if top in PACKAGES and (name_of(path), module) not in EXCEPTIONS:
            assert top in MAY_IMPORT[package], (
                f"{name_of(path)} imports {module}: {package}/ may import only {sorted(MAY_IMPORT[package])}; "
                "pass what it needs as a record from session/, or move what both need to radiometry/")


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_a_heavy_library_has_one_owner(path):
    for module in imports_of(path):
        top = module.split(".")[0]
        if top in OWNERS and (name_of(path), top) not in EXTRA_OWNERS:
            assert name_of(path).startswith(OWNERS[top]), (
                f"{name_of(path)} imports {top}, which belongs to {' and '.join(OWNERS[top])}: "
                "call the owner's function instead")


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_mitsuba_and_colour_are_not_imported_with_a_module(path):
    heavy = {"mitsuba", "drjit", "colour"}
    found = heavy.intersection(module.split(".")[0] for module in imports_of(path, top_level_only=True))
    assert not found, f"{name_of(path)} imports {found} at its top: import it inside the function that needs it"


def test_the_command_line_imports_nothing_heavy_before_a_command_runs():
    files = [ROOT / "session" / "cli.py", ROOT / "session" / "command_line.py",
             *(ROOT / "session" / "commands").glob("*.py")]
    top = {module.split(".")[0] for path in files for module in imports_of(path, top_level_only=True)}
    assert not top & {"numpy", "scipy", "mitsuba", "cv2", "rawpy", "matplotlib", "colour"}


@pytest.mark.parametrize("package", [*PACKAGES, "session/report", "session/commands", "capture/instruments",
                                     "radiometry/spectral_formats"])
def test_a_package_file_holds_a_docstring_only(package):
    tree = ast.parse((ROOT / package / "__init__.py").read_text(encoding="utf-8"))
    assert len(tree.body) == 1 and ast.get_docstring(tree), f"{package}/__init__.py must hold its docstring only"
