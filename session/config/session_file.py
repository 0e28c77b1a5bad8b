"""session.toml: what the operator wrote, checked key by key."""
from __future__ import annotations

import dataclasses
import difflib
import tomllib
import types
import typing
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import InputError
from spectrabox.session.config.session_rules import inconsistencies
from spectrabox.session.config.session_schema import (
    FILE_NAME,
    LIMITS,
    NAMED_TABLES,
    SECTIONS,
    WRITTEN_AS,
    CurvesRef,
    SessionConfig,
    SpectrumRef,
)

WORDS = {tuple: "list", dict: "table"}


def read_session(folder: Path, allow_outside: bool = False) -> SessionConfig:
    """The session described in ``folder``/session.toml.

    Raises
    ------
    InputError
        Naming every fault of the file at once: unknown keys with the nearest known one, wrong
        types, missing keys.
    """
    config, problems = try_read_session(folder, allow_outside)
    if config is None:
        raise InputError("\n".join(problems))
    return config


def try_read_session(folder: Path, allow_outside: bool = False) -> tuple[SessionConfig | None,
                                                                         list[str]]:
    """The session, or None with every fault of its file in a sentence each."""
    path = folder / FILE_NAME
    if not path.is_file():
        return None, [f"{path} is missing: write one with 'spectrabox new {folder}'"]
    try:
        written = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        return None, [f"{FILE_NAME} is not valid TOML: {error}"]
    problems: list[str] = []
    values: dict[str, Any] = {"folder": folder, "allow_outside": allow_outside}
    values |= _sections(written, problems)
    if problems:
        return None, problems
    config = SessionConfig(**values)
    problems = inconsistencies(config)
    return (None, problems) if problems else (config, [])


def _sections(written: dict[str, Any], problems: list[str]) -> dict[str, Any]:
    hints = typing.get_type_hints(SessionConfig)
    values: dict[str, Any] = {}
    _report_unknown(written, SECTIONS, "", problems)
    for name, section in SECTIONS.items():
        if name in written:
            node = written[name]
            if not isinstance(node, dict):
                problems.append(f"{FILE_NAME}: {name} must be a table [{name}]")
            elif name in NAMED_TABLES:
                values[name] = {own: _build(NAMED_TABLES[name], table, f"{name}.{own}", problems)
                                for own, table in node.items()}
            else:
                values[name] = _build(hints[name], node, name, problems)
        elif section.default_factory is dataclasses.MISSING:
            problems.append(f"{FILE_NAME}: the table [{name}] is missing"
                            + (".NAME" if name == "materials" else ""))
    return values


def _build(section: Any, node: Any, place: str, problems: list[str]) -> Any:
    if not isinstance(node, dict):
        problems.append(f"{FILE_NAME}: [{place}] must be a table")
        return None
    hints = typing.get_type_hints(section)
    fields = {WRITTEN_AS.get(f.name, f.name): f for f in dataclasses.fields(section)}
    _report_unknown(node, fields, place, problems)
    values = {}
    for key, description in fields.items():
        if key in node:
            values[description.name] = _convert(hints[description.name], node[key],
                                                f"{place}.{key}", problems)
            _check_limit(place, key, values[description.name], problems)
        elif description.default is dataclasses.MISSING:
            problems.append(f"{FILE_NAME}: {place}.{key} is missing")
    if any(f.default is dataclasses.MISSING and f.name not in values for f in fields.values()):
        return None
    return section(**values)


def _report_unknown(node: dict[str, Any], known: typing.Iterable[str], place: str,
                    problems: list[str]) -> None:
    for key in node:
        if key not in known:
            near = difflib.get_close_matches(key, list(known), n=1, cutoff=0.0)
            where = f" in [{place}]" if place else ""
            problems.append(f"{FILE_NAME}: unknown key {key!r}{where}; did you mean {near[0]!r}?")


def _convert(hint: Any, value: Any, place: str, problems: list[str]) -> Any:
    """The value as the field's type, or a problem."""
    options = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    for option in options:
        if option in (SpectrumRef, CurvesRef):
            return _build(option, {"file": value} if isinstance(value, str) else value, place,
                          problems)
        if typing.get_origin(option) is dict and isinstance(value, dict):
            return {name: _convert(typing.get_args(option)[1], item, f"{place}.{name}", problems)
                    for name, item in value.items()}
        if typing.get_origin(option) is tuple and isinstance(value, list):
            return tuple(_convert(typing.get_args(option)[0], item, place, problems)
                         for item in value)
        if option is float and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if isinstance(option, type) and option is not types.NoneType and type(value) is option:
            return value
    wanted = " or ".join(WORDS.get(typing.get_origin(option), option.__name__)
                         for option in options if option is not types.NoneType)
    problems.append(f"{FILE_NAME}: {place} is {value!r}; {wanted} is needed")
    return None


def _check_limit(place: str, key: str, value: Any, problems: list[str]) -> None:
    limits = LIMITS.get((place, key))
    if limits and isinstance(value, int | float) and not limits[0] <= value <= limits[1]:
        problems.append(f"{FILE_NAME}: {place}.{key} is {value:g}; {limits[0]:g} to {limits[1]:g} "
                        "is possible")


