"""The templates of all pages, compiled once; nothing here draws."""
from __future__ import annotations

from functools import cache
from pathlib import Path

import jinja2

from spectrabox.session.report import words
from spectrabox.session.report.checked.cells import of

TEMPLATES = Path(__file__).parent / "templates"
FILTERS = {"percent": words.percent, "signed_percent": words.signed_percent, "number": words.number,
           "fixed": words.fixed, "exposure": words.exposure, "fact": words.fact}


@cache
def compiled(template: str) -> jinja2.Template:
    """One of the templates, and those that it includes; all of them are compiled once."""
    made = templates()
    for name in made.list_templates(extensions=["j2"]):
        made.get_template(name)
    return made.get_template(template)


@cache
def templates() -> jinja2.Environment:
    """What all pages are made by, compiled once: it escapes whatever is not Markup."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True,
                                     trim_blocks=True, lstrip_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    environment.filters.update(FILTERS)
    environment.globals["of"] = of
    return environment
