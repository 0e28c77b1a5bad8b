"""The schema that editors read, the template and the documentation say what the models say."""
import json
import re
import runpy
import tomllib
from pathlib import Path

import jsonschema
import pytest
from typer.testing import CliRunner

from spectrabox.calibrate.sensitivity import METHODS as SENSITIVITY_METHODS
from spectrabox.fixtures.demos.demo_session import SESSION_TOML
from spectrabox.measure.shoot.shoot import Shoot, meaning
from spectrabox.reconstruct.settings import ENGINES, InversionSettings
from spectrabox.sampling.draw_methods import METHODS as SAMPLING_METHODS
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import try_read_session
from spectrabox.session.config.template import (
    SCHEMA_NAME,
    SESSION_TEMPLATE,
    session_schema,
    write_template,
)

SCHEMA = json.loads(session_schema())
DEMO = SESSION_TOML.format(seed=1, materials='[materials.white]\nbsdf = "white"\n')
ROOT = Path(__file__).parent.parent
DOCS = (ROOT / "docs/reference/session.md").read_text(encoding="utf-8")


def complaints(text):
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [error.message for error in validator.iter_errors(tomllib.loads(text))]


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("text", [SESSION_TEMPLATE, DEMO])
def test_the_schema_accepts_what_we_write(text):
    assert complaints(text) == []


@pytest.mark.parametrize("before, after", [
    ("[photos]", "[photo]"), ("seed = 1", "sed = 1"), ("seed = 1", "seed = -1"),
    ("draws = 4000", "draws = \"many\""), ("level = 0.95", "level = 95"),
    ('bsdf = "white"', 'bsfd = "white"'),
    ('from = "chart"                     # fit', "from = 3 #"),
    ("[reconstruct]", "[reconstruct]\nengine = \"warp\"")])
def test_schema_and_reader_refuse_the_same(tmp_path, before, after):
    assert before in DEMO
    text = DEMO.replace(before, after)
    (tmp_path / "session.toml").write_text(text, encoding="utf-8")
    assert complaints(text) and try_read_session(tmp_path)[1]


@pytest.mark.parametrize("line", [
    'object = "a.dng"', 'object = ["a.dng", "b.dng"]',
    'object = { "450 nm" = "a.dng", "550 nm" = ["b.dng", "c.dng"] }'])
def test_every_way_to_write_a_photo_is_in_the_schema(line):
    assert complaints(re.sub(r"^object = .*$", line, SESSION_TEMPLATE, flags=re.MULTILINE)) == []


def test_a_spectrum_is_a_name_or_a_table_in_the_schema():
    table = 'spectrum = { file = "a.csv", column = 2 }'
    assert complaints(re.sub(r"^spectrum = .*$", table, SESSION_TEMPLATE,
                             flags=re.MULTILINE)) == []
    typo = 'spectrum = { file = "a.csv", colum = 2 }'
    assert complaints(re.sub(r"^spectrum = .*$", typo, SESSION_TEMPLATE, flags=re.MULTILINE))


def test_the_template_comes_with_the_schema_that_it_names(tmp_path):
    path = write_template(tmp_path)
    assert path.read_text(encoding="utf-8").startswith(f"#:schema ./{SCHEMA_NAME}\n")
    assert json.loads((tmp_path / SCHEMA_NAME).read_text(encoding="utf-8")) == SCHEMA


def every_key():
    for table, section in Shoot.model_fields.items():
        of_names, alone = table in ("materials", "regions", "views"), section.annotation
        model = alone.__args__[1] if of_names else next(
            (part for part in getattr(alone, "__args__", ()) if part is not type(None)), alone)
        for name, field in model.model_fields.items():
            yield table, str(field.validation_alias or name), field


@pytest.mark.parametrize("table, key, field", [pytest.param(*one, id=f"{one[0]}.{one[1]}")
                                               for one in every_key()])
def test_every_key_has_a_meaning_and_a_line_in_the_documentation(table, key, field):
    assert field.description
    rows = [row for row in DOCS.splitlines()
            if row.startswith(f"| `{table}.") and f"{key}`" in row.split("|")[1]]
    assert len(rows) == 1, f"{table}.{key} needs one row in docs/reference/session.md"
    if isinstance(field.default, int | float | str) and field.default != "":
        shown = json.dumps(field.default) if isinstance(field.default, bool) else \
            f"{field.default:g}" if isinstance(field.default, float) else str(field.default)
        assert shown in rows[0].split("|")[2], f"the default of {table}.{key} is {shown}"


def test_the_reference_is_written_from_the_model():
    made = runpy.run_path(str(ROOT / "docs" / "make_session_reference.py"))
    assert made["reference_page"](DOCS) == DOCS, "run python docs/make_session_reference.py"
    named = {key for key, _, _ in made["keys"](SCHEMA)}
    assert {*made["REMARKS"], *made["DEFAULTS"]} <= named


def test_options_say_what_their_keys_mean():
    shown = " ".join(CliRunner().invoke(app, ["flat", "--help"]).output.split())
    for key in ("regions.family", "chart.reference", "light.spectrum"):
        assert meaning(key) in shown
    for key in (f"{table}.{key}" for table, key, _ in every_key()):
        assert meaning(key)


def test_the_choices_are_those_of_the_stages():
    def choices(table, key):
        found = SCHEMA["$defs"][table]["properties"][key]
        return set(found["enum"])
    assert choices("Inversion", "engine") == set(ENGINES)
    assert choices("Sampling", "method") == set(SAMPLING_METHODS)
    assert choices("SensitivitySection", "method") == set(SENSITIVITY_METHODS)


def test_the_defaults_are_those_of_the_stages():
    tables = Shoot.model_fields
    reconstruct = tables["reconstruct"].default.settings()
    settings = InversionSettings()
    assert {name: getattr(settings, name) for name in reconstruct} == reconstruct
