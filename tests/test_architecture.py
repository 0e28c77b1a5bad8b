"""The import rule of docs/architecture.md, read from the code's own imports."""
import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STAGES = ("capture", "calibrate", "reconstruct", "sampling")
PACKAGES = ("radiometry", *STAGES, "measure", "session", "fixtures")
API = "spectrabox/api"      # what the public names are: they call what commands call
MAY_IMPORT = {"radiometry": {"radiometry"}, **{stage: {"radiometry", stage} for stage in STAGES},
              "measure": {"radiometry", *STAGES, "measure"}, "session": {*PACKAGES},
              "spectrabox": {*PACKAGES}, "fixtures": {"fixtures", "radiometry"}}
EXCEPTIONS = {("fixtures/demos/box_render.py", "spectrabox.reconstruct.rendering.llvm"):
              "drjit aborts on a wrong LLVM, whoever imports it"}
OWNERS = {"serial": ("capture/meter/serial_line.py",),
          "rawpy": ("capture/photo/raw.py",),
          "exifread": ("capture/photo/metadata.py",),
          "cv2": ("capture/chart/detection.py",           # pixels of a chart
                  "capture/photo/registration.py",        # pixels of two photos
                  "calibrate/geometry/projection.py"),    # a lens and its pose
          "OpenImageIO": ("capture/photo/stored_images.py", "capture/photo/image_writers.py",
                          "capture/photo/image_rows.py",    # what is too large to hold
                          "radiometry/spectra/formats/spectral_exr.py"),    # spectra, no photo
          "zarr": ("radiometry/spectra/formats/zarr_array.py",),
          "distributed": ("session/batch/workers.py",),
          "colour": ("radiometry/",),
          "mitsuba": ("reconstruct/", "fixtures/"),
          "drjit": ("reconstruct/", "fixtures/"),
          "typer": ("session/cli.py", "session/terminal/command_line.py",
                    "session/terminal/command_help.py", "session/commands/")}
EXTRA_OWNERS = {("fixtures/demos/demo_photos.py", "colour"), ("fixtures/paints.py", "colour"),
                ("fixtures/lamp.py", "colour"), ("fixtures/demos/demo_session.py", "colour"),
                # handed out as colour-science's own
                ("measure/estimate.py", "colour")}


@cache
def modules():
    rooms = (*PACKAGES, API)
    return [path for room in rooms for path in sorted((ROOT / room).rglob("*.py"))]


def all_code():
    return [*modules(), *sorted((ROOT / "tests").rglob("*.py")),
            *sorted((ROOT / "benchmarks").rglob("*.py")), *sorted((ROOT / "tools").rglob("*.py"))]


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports_of(path, top_level_only=False):
    names = []
    for node in tree_of(path).body if top_level_only else ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.append(node.module)
    return names


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def none_of(problems):
    """One test for all files, since thousands of tests take longer to list than to run."""
    problems = list(problems)
    assert not problems, "\n".join(problems)


def test_our_packages_are_imported_through_spectrabox():
    none_of(f"{name_of(path)} imports {module}: write spectrabox.{module}, or its classes exist "
            "twice and the package collides with others of that name"
            for path in all_code() for module in imports_of(path)
            if module.split(".")[0] in PACKAGES)


def test_imports_point_down():
    none_of(f"{name_of(path)} imports {module}: {package}/ may import only "
            f"{sorted(MAY_IMPORT[package])}; pass what it needs as a record from session/, or "
            "move what both need to radiometry/"
            for path in modules() for package in path.relative_to(ROOT).parts[:1]
            for module in imports_of(path) if not may_import(path, package, module))


def test_the_program_imports_no_tools():
    none_of(f"{name_of(path)} imports {module}: tools/ is not installed with the program"
            for path in modules() for module in imports_of(path)
            if module.split(".")[0] in ("tools", "tests", "benchmarks"))


def may_import(path, package, module):
    top, _, rest = module.partition(".")
    ours = rest.split(".")[0]
    return (top != "spectrabox" or ours not in PACKAGES or ours in MAY_IMPORT[package]
            or (name_of(path), module) in EXCEPTIONS)


PROCESS = {"gc", "signal", "threading", "multiprocessing", "concurrent", "atexit", "os.fork",
           "os._exit", "os.putenv", "os.environ.setdefault", "os.environ.update", "os.chdir",
           "os.umask", "np.seterr", "sys.setrecursionlimit"}
OWN_PROCESS = {("capture/transcripts/player.py", "threading"): "plays an instrument on a port",
               ("reconstruct/rendering/renderer.py", "threading"): "a lock: Mitsuba starts once",
               ("measure/pictures/picture_files.py", "concurrent"): "threads end with the call",
               ("measure/pictures/spectra_files.py", "concurrent"): "threads end with the call",
               ("reconstruct/rendering/llvm.py", "os.environ"): "Dr.Jit has no other way",
               ("reconstruct/rendering/llvm.py", "atexit"): "removes the HOME made for Dr.Jit"}


def test_the_library_leaves_the_process_alone():
    """A notebook can call any of it. Parallel work is given out by session/batch."""
    none_of(f"{name_of(path)} uses {name}: that changes the process of whoever calls it; do it in "
            "session/" for path in modules()
            if path.relative_to(ROOT).parts[0] not in ("session", "fixtures")
            for name in process_changes(path) if (name_of(path), name) not in OWN_PROCESS)


def process_changes(path):
    used = {name.split(".")[0] for name in imports_of(path)}
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Attribute):
            used.add(ast.unparse(node))
        if isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Load) \
                and ast.unparse(node.value) == "os.environ":
            yield "os.environ"
    yield from sorted(used & PROCESS)


def needed_by(path, files):
    """The files of ours that a file imports when it runs, at its top or in a function."""
    types = {each for node in ast.walk(tree_of(path)) if isinstance(node, ast.If)
             and ast.unparse(node.test) == "TYPE_CHECKING" for each in ast.walk(node)}
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom) and node.module and node not in types:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            yield from (files[name] for name in names if name in files)


def test_no_files_import_each_other_in_a_circle():
    files = {f"spectrabox.{name_of(path)[:-3].replace('/', '.')}": path for path in modules()}
    waiting = {path: set(needed_by(path, files)) for path in modules()}
    while free := {path for path, needed in waiting.items() if not needed & waiting.keys()
                   or not any(path in needed for needed in waiting.values())}:
        waiting = {path: needed for path, needed in waiting.items() if path not in free}
    none_of(f"{name_of(path)} imports {name_of(other)}, which leads back to it: move what both "
            "need into a third file" for path, needed in waiting.items()
            for other in needed & waiting.keys())


def test_the_rooms_of_the_keys_hold_all_that_the_steps_import():
    from spectrabox.session.store.keys import LIBRARY
    files = {f"spectrabox.{name_of(path)[:-3].replace('/', '.')}": path for path in modules()}
    waiting, reached = [ROOT / "measure/steps/measurement.py"], set()
    while waiting:
        path = waiting.pop()
        if path not in reached:
            reached.add(path)
            waiting += needed_by(path, files)
    none_of(f"{name_of(path)} is imported by the steps, whose keys leave its room out: an edit "
            "would not make results stale" for path in reached
            if path.relative_to(ROOT).parts[0] not in LIBRARY)


def test_the_package_links_to_each_folder_and_holds_the_public_names():
    inside = {path.name for path in (ROOT / "spectrabox").iterdir() if path.name != "__pycache__"}
    assert inside == {*PACKAGES, "api", "__init__.py", "__init__.pyi", "__main__.py", "py.typed"}
    for package in PACKAGES:
        link = ROOT / "spectrabox" / package
        assert link.is_symlink() and str(link.readlink()) == f"../{package}"


def test_a_room_can_be_taken_in_at_a_glance():
    rooms = sorted({path.parent for path in modules()})
    files = {room: [path for path in room.glob("*.py") if path.name != "__init__.py"]
             for room in rooms}
    none_of(f"{name_of(room)} holds {len(files[room])} files: give those of one job a folder of "
            "their own" for room in rooms if len(files[room]) > 18)
    none_of(f"{name_of(room)}/ needs an __init__.py that says what it is for"
            for room in rooms if not (room / "__init__.py").is_file())


def test_a_heavy_library_has_one_owner():
    imported = [(name_of(path), module.split(".")[0]) for path in modules()
                for module in imports_of(path)]
    none_of(f"{name} imports {top}, which belongs to {' and '.join(OWNERS[top])}: "
            "call the owner's function instead" for name, top in imported
            if top in OWNERS and (name, top) not in EXTRA_OWNERS
            and not name.startswith(OWNERS[top]))


def test_mitsuba_and_colour_are_not_imported_with_a_module():
    none_of(f"{name_of(path)} imports {module} at its top: import it inside the function that "
            "needs it" for path in modules() for module in imports_of(path, top_level_only=True)
            if module.split(".")[0] in {"mitsuba", "drjit", "colour"})


def test_the_command_line_imports_nothing_heavy_before_a_command_runs():
    files = [ROOT / "session" / "cli.py", ROOT / "session" / "terminal" / "command_line.py",
             *(ROOT / "session" / "commands").glob("*.py")]
    top = {module.split(".")[0] for path in files for module in imports_of(path,
                                                                           top_level_only=True)}
    assert not top & {"numpy", "scipy", "mitsuba", "cv2", "rawpy", "matplotlib", "colour"}


def test_a_package_file_holds_a_docstring_only():
    none_of(f"{name_of(path)} must hold its docstring only" for path in modules()
            if path.name == "__init__.py"
            and not (len(tree_of(path).body) == 1 and ast.get_docstring(tree_of(path))))


WRITES = {"write_text", "write_bytes", "tofile", "save", "savez", "savez_compressed", "savefig",
          "imwrite", "imsave", "write_ply", "copy", "copy2", "copyfile", "create"}
WRITES_OF = {"save": "np", "copy": "shutil", "create": "ImageOutput"}   # others have such names too
OWN_WAY = {"radiometry/files.py": "is the one way",
           "radiometry/published/make_tables.py": "is run by developers",
           "session/store/record_files.py": "fills a folder that is replaced whole",
           "session/store/surface_files.py": "writes in such a block, a function for each format",
           "capture/transcripts/transcript.py": "is written line by line, so that nothing is lost"}


def _opens_to_write(call):
    mode = [*call.args, *(each.value for each in call.keywords if each.arg == "mode")]
    return any(isinstance(each, ast.Constant) and each.value in ("w", "wb", "x", "xb", "a", "ab",
                                                                 "r+", "r+b") for each in mode)


def writes_of(node, whole=False):
    """Calls that write a file outside of a block of ``whole_file``."""
    if isinstance(node, ast.With):
        whole = whole or any("whole_file" in ast.dump(item.context_expr) for item in node.items)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and not whole:
        name, owner = node.func.attr, ast.unparse(node.func.value)
        if ((name in WRITES and WRITES_OF.get(name, owner) in owner)
                or (name == "open" and _opens_to_write(node))):
            yield node
    for child in ast.iter_child_nodes(node):
        yield from writes_of(child, whole)


def test_a_file_is_written_whole_or_not_at_all():
    none_of(f"{name_of(path)}:{call.lineno} writes a file by itself: do it in a block of "
            "radiometry.files.whole_file, which leaves the old one or the new one and follows no "
            "link" for path in modules()
            if name_of(path) not in OWN_WAY and not name_of(path).startswith("fixtures/")
            for call in writes_of(tree_of(path)))


def test_writing_by_oneself_is_seen():
    code = "path.open('w')\nnp.save(a, b)\nwith whole_file(a) as b:\n    b.write_bytes(c)\n"
    assert [call.lineno for call in writes_of(ast.parse(code))] == [1, 2]


CHANGING = {"reconstruct/tracer/path_tracer.py": "PathState",
            "sampling/polytope/simplex.py": "_State"}    # written to while they are worked out


def test_records_cannot_be_changed_and_those_of_arrays_are_not_compared():
    """Arrays have no one truth value, so that two records of them are equal or not by identity."""
    wrong = []
    for path in modules():
        for node in ast.walk(tree_of(path)):
            if not isinstance(node, ast.ClassDef) or CHANGING.get(name_of(path)) == node.name:
                continue
            bases = {ast.unparse(base) for base in node.bases}
            for decorator in node.decorator_list:
                said = ast.unparse(decorator)
                if said.startswith("dataclass") and ("frozen=True" not in said or (
                        "Record" in bases and "eq=False" not in said)):
                    wrong.append(f"{name_of(path)}: {node.name} is @{said}; write "
                                 "@dataclass(frozen=True, eq=False) for a Record, frozen=True else")
    assert not wrong, "\n".join(wrong)


def test_a_module_gives_each_name_once():
    """A second constant or function of a name would silently take the place of the first."""
    def names(node):
        if isinstance(node, ast.FunctionDef):
            overloads = [each for each in node.decorator_list
                         if isinstance(each, ast.Name) and each.id == "overload"]
            return [] if overloads else [node.name]
        if isinstance(node, ast.ClassDef):
            return [node.name]
        targets = node.targets if isinstance(node, ast.Assign) else \
            [node.target] if isinstance(node, ast.AnnAssign) else []
        return [part.id for target in targets for part in ast.walk(target)
                if isinstance(part, ast.Name)]

    def twice():
        for path in modules():
            given = [name for node in tree_of(path).body for name in names(node)]
            for name in {name for name in given if given.count(name) > 1}:
                yield f"{name_of(path)} gives the name {name} twice"
    none_of(twice())
