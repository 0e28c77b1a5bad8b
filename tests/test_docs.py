"""Every block of code in README and docs is run, as a reader would run it, on the demo's session.

The info string of a fence says what a block is: ``sh``, ``python``, ``xml``, ``text``; ``toml
session`` is a part of a session.toml, ``toml NAME`` a file of that name. A further word says why a
block is not run here (NOT_RUN); its commands and imports must exist all the same.

Most pages begin with one and the same demo: its command is run once, and each page has a copy. A
calibration or a photo that several pages measure alike is measured once.
"""
from __future__ import annotations

import ast
import collections
import functools
import importlib
import inspect
import itertools
import json
import re
import runpy
import shlex
import shutil
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import spectrabox
from spectrabox.calibrate.geometry.lens import write_lens
from spectrabox.capture.photo.image_files import read_linear_file
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.radiometry.spectra.named_spectra import test_reflectances as published_reflectances
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.terminal.command_help import EXAMPLES

from tests import test_beam as wall
from tests import test_geometry_commands as geometry

GRID = visible_grid(5)

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NOT_RUN = {"needs-setup": "sets up an environment", "needs-minutes": "takes too long for a test",
           "needs-meter": "needs a spectroradiometer", "needs-photos": "needs photos of one's own",
           "needs-browser": "serves a page until it is stopped",
           "needs-data": "needs data that do not ship with the project"}
HOW_MANY_ARE_NOT_RUN = {"needs-setup": 4, "needs-minutes": 5, "needs-meter": 6, "needs-photos": 25,
                        "needs-data": 15, "needs-browser": 3}
EXAMPLES_NOT_RUN = {
    "demo": "takes too long", "rehearse": "takes too long",
    "geometry box": "needs a measured box", "geometry light": "takes too long",
    "meter identify": "needs a meter", "meter measure": "needs a meter",
    "open": "serves a page until it is stopped"}
FENCE = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
PATH = re.compile(r"`((?:radiometry|capture|calibrate|reconstruct|sampling|session|fixtures|tests"
                  r"|benchmarks|docs)/[\w./-]*)`")
PAINTING = ["spectrabox", "demo", "painting", "--flat"]
MADE = "painting-as-made"       # what that has written, beside a reader's own files
MEASURED_ONCE = ("fit_camera", "flat", "reconstruct_scene")
# No number is taken from these renderings: narrower ones take half of the time.
NARROW = ("width=48", "width=36")
SMALL_CHART = "a patch has 56 pixels and 100 are needed"    # in the small photos of these tests


@dataclass(frozen=True)
class Block:
    """One fenced block of a page."""

    page: str
    line: int
    language: str
    mark: str
    text: str


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def blocks_of(page):
    text = page.read_text(encoding="utf-8")
    for fence in FENCE.finditer(text):
        language, _, mark = fence[1].partition(" ")
        yield Block(name_of(page), text.count("\n", 0, fence.start()) + 1, language, mark.strip(),
                    fence[2])


BLOCKS = [block for page in PAGES for block in blocks_of(page)]
RUN = {page: [block for block in BLOCKS if block.page == page and block.mark not in NOT_RUN]
       for page in dict.fromkeys(block.page for block in BLOCKS)}


def commands_in(text):
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            yield words


def run_command(words, mark):
    assert words[0] == "spectrabox", f"a {mark or 'sh'} block runs {words[0]}: mark it"
    if words == PAINTING and Path(MADE).exists():
        shutil.copytree(MADE, "painting")
        return
    result = CliRunner().invoke(app, words[1:])
    small = result.exit_code == 4 and words[1] == "chart" and SMALL_CHART in result.output
    assert result.exit_code == 0 or small, (f"{' '.join(words)} ends in {result.exit_code}\n"
                                            f"{result.output}\n{result.exception!r}")


def as_toml(table, name=""):
    """Text of a table that tomllib read, its own values before its sub-tables."""
    parts = {key: value for key, value in table.items() if isinstance(value, dict)}
    lines = [f"[{name}]"] if name else []
    lines += [f"{quoted(key)} = {inline(value)}" for key, value in table.items()
              if key not in parts]
    return "\n".join(lines + [as_toml(value, f"{name}.{quoted(key)}".lstrip("."))
                              for key, value in parts.items()])


def inline(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{quoted(key)} = {inline(own)}" for key, own in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(inline(own) for own in value) + "]"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def quoted(key):
    return f'"{key}"'


def read_part_of_a_session(text, folder):
    """Put the tables of a block in place of the demo's and read the whole."""
    whole = tomllib.loads((folder / "mybox" / "session.toml").read_text(encoding="utf-8"))
    for name, table in tomllib.loads(text).items():
        whole[name] = {**whole.get(name, {}), **table}
    other = folder / "of-a-block"
    other.mkdir(exist_ok=True)
    (other / "session.toml").write_text(as_toml(whole), encoding="utf-8")
    read_session(other)


def run_block(block, folder, names):
    if block.language == "sh":
        for words in commands_in(block.text):
            run_command(words, block.mark)
    elif block.language == "python":
        source = "\n" * block.line + block.text.replace(*NARROW)
        exec(compile(source, ROOT / block.page, "exec"), names)  # noqa: S102  our own page
    elif block.language == "toml" and block.mark == "session":
        read_part_of_a_session(block.text, folder)
    elif block.language == "toml" and block.mark == "session.toml":
        (folder / "alone").mkdir(exist_ok=True)
        (folder / "alone" / block.mark).write_text(block.text, encoding="utf-8")
        read_session(folder / "alone")
    elif block.language == "toml":
        assert block.mark.endswith(".toml"), f"{block.page}:{block.line}: which file is this?"
        tomllib.loads(block.text)
        (folder / block.mark).write_text(block.text, encoding="utf-8")
    elif block.language == "xml":
        ET.fromstring(f"<scene>{block.text}</scene>")
    else:
        assert block.language == "text", f"{block.page}:{block.line}: say what this block is"


@pytest.fixture(scope="module")
def answers():
    """What was measured in the files of the demos, by function and arguments."""
    return {}


@pytest.fixture
def reader(finished_demo, finished_painting, answers, tmp_path, monkeypatch):
    """A folder with the demo's session, and the repository's transcripts."""
    shutil.copytree(finished_demo, tmp_path / "mybox")
    (tmp_path / MADE).symlink_to(finished_painting)
    (tmp_path / "fixtures").symlink_to(ROOT / "fixtures")
    monkeypatch.chdir(tmp_path)
    for name in MEASURED_ONCE:
        monkeypatch.setattr(spectrabox, name, answered_once(getattr(spectrabox, name), answers))
    return tmp_path


def answered_once(function, answers):
    """The function, which keeps what it has answered where it is given files, numbers and what
    was answered before alone.
    """
    signature = inspect.signature(function)

    def answered_before(value):
        try:
            return next(key for key, known in answers.items() if known is value)
        except StopIteration:       # a record, of which two may look alike
            raise TypeError from None

    @functools.wraps(function)
    def answer(*given, **named):
        asked = signature.bind(*given, **named)
        asked.apply_defaults()
        try:
            key = function.__name__, json.dumps(asked.arguments, default=answered_before)
        except TypeError:
            return function(*given, **named)
        if key not in answers:
            answers[key] = function(*given, **named)
        return answers[key]
    return answer


@pytest.mark.parametrize("page", [page for page, blocks in RUN.items() if blocks])
def test_the_blocks_of_a_page_run_one_after_the_other(page, reader):
    names = {"__name__": "page"}
    for block in RUN[page]:
        run_block(block, reader, names)


def test_blocks_that_are_not_run_are_counted():
    marked = collections.Counter(block.mark for block in BLOCKS if block.mark in NOT_RUN)
    assert marked == HOW_MANY_ARE_NOT_RUN, sorted(
        (block.mark, block.page, block.line) for block in BLOCKS if block.mark in NOT_RUN)


@pytest.mark.parametrize("block", [block for block in BLOCKS if block.mark in NOT_RUN],
                         ids=lambda block: f"{block.page}:{block.line}")
def test_a_block_that_is_not_run_names_commands_and_modules_that_exist(block):
    if block.language == "python":
        for node in ast.walk(ast.parse(block.text)):
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(node.module)
                assert all(hasattr(module, alias.name) for alias in node.names), ast.unparse(node)
        return
    for words in commands_in(block.text):
        if words[0] == "make":
            target = (ROOT / "Makefile").read_text(encoding="utf-8")
            assert all(re.search(rf"^{word}:", target, re.MULTILINE) for word in words[1:])
        elif words[0] == "spectrabox":
            require_options_that_exist(words)


def require_options_that_exist(words):
    command, rest = get_command(app), words[1:]
    while hasattr(command, "commands"):
        command, rest = command.commands[rest[0]], rest[1:]
    known = {option for own in command.params if not getattr(own, "hidden", False)
             for option in own.opts}
    assert {word for word in rest if re.match(r"--?[a-z]", word)} <= known, words


def commands_of(group, *path):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands_of(command, *path, name)
        else:
            yield " ".join([*path, name]), command


COMMANDS = dict(commands_of(get_command(app)))


def test_every_command_has_two_examples():
    assert set(EXAMPLES) == set(COMMANDS)
    assert all(len(examples) == 2 for examples in EXAMPLES.values())


def test_the_output_has_its_short_option_in_every_command():
    outputs = [own.opts for command in COMMANDS.values() for own in command.params
               if "--out" in own.opts]
    assert len(outputs) > 15 and all("-o" in opts for opts in outputs)


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name not in EXAMPLES_NOT_RUN])
def test_the_examples_of_a_help_page_run(name, reader, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(reader / "data"))
    for example in EXAMPLES[name]:
        words = shlex.split(example.replace("\\\n", " "))
        require_options_that_exist(words)
        write_files_of(words, reader)
        run_command(words, "example")


@pytest.mark.parametrize("name", EXAMPLES_NOT_RUN)
def test_an_example_that_is_not_run_has_options_that_exist(name):
    for example in EXAMPLES[name]:
        require_options_that_exist(shlex.split(example.replace("\\\n", " ")))


def write_files_of(words, folder):
    """Those of an example's files that a reader brings along."""
    if any(word.startswith("painting") for word in words) and not (folder / "painting").exists():
        run_command(PAINTING, "")
    for file, write in FILES.items():
        if file in words and not (folder / file).exists():
            write(folder)


def write_curves(folder):
    (folder / "measured-cameras").mkdir()
    for name in ("Nikon D810", "Nikon D800E", "Canon EOS 5D", "Canon EOS 200D"):
        curves = dict(zip("RGB", sensitivities(name, GRID), strict=True))
        write_table(folder / "measured-cameras" / f"my {name}.csv", curves, Quantity.RELATIVE)


def write_paints(folder):
    (folder / "measured-paints").mkdir()
    for number, paint in enumerate(published_reflectances(GRID)["CES99"][:12]):
        write_table(folder / "measured-paints" / f"{number}.csv", {"value": paint})


def write_filtered(folder):
    """A chart and a lamp, without and with a filter."""
    shutil.copy(folder / "mybox" / "photos" / "chart.dng", folder / "chart.dng")
    frame = read_raw(folder / "chart.dng")
    black = np.tile(frame.black_level, np.array(frame.mosaic.shape) // 2)
    write_dng(folder / "chart-gel.dng", (black + 0.6 * (frame.mosaic - black)).astype(np.uint16),
              black=frame.black_level.ravel(), exposure_s=Fraction(frame.exposure_s))
    for name, share in (("lamp", 1.0), ("lamp-gel", 0.6)):
        write_table(folder / f"{name}.csv", {"value": share * light("A", GRID)}, Quantity.RELATIVE)


def write_board(folder):
    (folder / "board.toml").write_text(
        geometry.BOARD + "origin = [0, 1, 2]\nright = [1, 0, 0]\ndown = [0, -1, 0]\n",
        encoding="utf-8")


def write_board_photos(folder):
    write_board(folder)
    for number, tilt in enumerate(geometry.TILTS[:3], start=1):
        geometry.bent_photo(folder, tilt).rename(folder / f"board{number}.dng")


def write_box_photo(folder):
    """A board by a bent lens; the scene, the lens and points that were marked on a box."""
    write_board(folder)
    geometry.bent_photo(folder, geometry.TILTS[0]).rename(folder / "box.dng")
    (folder / "scene.xml").write_text(geometry.SCENE, encoding="utf-8")
    write_lens(folder / "lens.json", geometry.TRUE)
    geometry.points_file(folder, geometry.seen(geometry.CORNERS, geometry.TURN, geometry.BOX_SHIFT))


def write_wall(folder):
    wall.written(folder)
    (folder / "wall.exr").rename(folder / "wall.dng")
    shape = read_linear_file(folder / "wall.dng").signal.shape
    noise = 0.005 * np.random.default_rng(1).standard_normal(shape)
    write_exr(folder / "card.exr", (0.5 + noise).astype(np.float32), "RGB", 0.1)
    (folder / "card.exr").rename(folder / "white-card.dng")


def write_table(path, columns, quantity=Quantity.REFLECTANCE):
    path.write_text(table_text(GRID.nm, columns, quantity=quantity, source="example"),
                    encoding="utf-8")


FILES = {"measured-cameras": write_curves, "measured-paints": write_paints,
         "chart-gel.dng": write_filtered, "lamp-gel.csv": write_filtered,
         "board.toml": write_board, "board1.dng": write_board_photos, "box.dng": write_box_photo,
         "wall.dng": write_wall}


@pytest.mark.parametrize("name", COMMANDS)
def test_help_says_types_in_words_and_ends_in_examples(name):
    text = CliRunner().invoke(app, [*name.split(), "--help"]).output
    assert not re.search(r"<[a-z]+|\blist\[|\{(?!cct)", text)
    options, _, examples = text.partition("\nExamples:\n")
    assert [line.strip() for line in examples.splitlines() if line.startswith("  spectrabox ")] \
        == [example.splitlines()[0] for example in EXAMPLES[name]]
    for record in re.split(r"\n  (?=-)", options)[1:]:
        assert len(record.split()) > 2, record      # an option without a word on what it is


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_and_paths_of_a_page_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for link in LINK.findall(text):
        assert link.startswith("http") or (page.parent / link).exists(), link
    for path in PATH.findall(text):
        assert (ROOT / path).exists(), path


def test_the_index_leads_to_every_page():
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*/*.md"):
        assert f"({page.relative_to(ROOT / 'docs').as_posix()})" in index


def test_the_accuracy_in_the_readme_is_that_of_the_ledger():
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    ledger = tomllib.loads((ROOT / "docs" / "results" / "ledger.toml").read_text(encoding="utf-8"))

    def recorded(row, digits):
        row = ledger[f"simulated/{row}"]
        return " ± ".join(f"{row[key]:.{digits}f}" for key in ("value", "standard_error"))
    assert f"colours are right within {recorded('faultless/dE00', 1)} ΔE00" in readme
    spectra = recorded("faultless/RMSE", 3).replace("0.", ".")
    assert f"spectra within {spectra} (root mean square" in readme
    held = ledger["simulated/faultless/held"]["value"]
    assert f"hold the truth at {100 * held:.0f} % of wavelengths" in readme
    faults = [ledger[f"simulated/{fault}/dE00"]["value"] for fault in ("gloss 3 %", "shadow 10 %")]
    assert [round(value) for value in faults] == [3, 3]
    assert ("a reflection of 3 % or a shadow of 10 % that no photo shows makes it about 3 ΔE00"
            in readme)


def test_the_reference_of_public_names_is_made_from_their_docstrings():
    made = runpy.run_path(str(ROOT / "docs" / "make_python_reference.py"))
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    assert page == made["reference_page"](), "run python docs/make_python_reference.py"
    assert sorted(itertools.chain(*made["GROUPS"].values())) == sorted(spectrabox.__all__)


@pytest.mark.parametrize("name", spectrabox.__all__)
def test_a_public_name_says_what_it_takes_gives_refuses_and_where_it_comes_from(name):
    made = runpy.run_path(str(ROOT / "docs" / "make_python_reference.py"))
    public = getattr(spectrabox, name)
    sections = made["sections_of"](public.__doc__)
    if inspect.isfunction(public):
        needed = {"Parameters", "Raises"} if inspect.signature(public).parameters else set()
        assert {"Returns", "References", "Examples"} | needed <= set(sections)
        parts = {name: public}
    elif issubclass(public, spectrabox.SpectraboxError):
        assert sections[""].endswith(".")
        return
    else:
        assert {"References", "Examples"} <= set(sections)
        assert {"Parameters", "Attributes"} & set(sections)
        parts = made["methods_of"](public)
    for key, part in parts.items():
        if inspect.isfunction(part):
            said = made["sections_of"](part.__doc__)
            listed = {one for names, _, _ in made["items"](said.get("Parameters", ""))
                      for one in names.split(", ")}
            assert listed == set(inspect.signature(part).parameters) - {"self"}, key
            assert "Returns" in said or part.__annotations__["return"] == "None", key
        else:
            assert part.__doc__, key


def test_the_table_of_commands_names_every_one():
    table = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    for name, command in get_command(app).commands.items():
        for own in getattr(command, "commands", {name: command}):
            assert re.search(rf"\b{own}\b", table), f"{name} {own}"
