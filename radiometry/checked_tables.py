"""Tables of TOML and JSON files that people write, checked by pydantic models.

A model states keys, types, limits and defaults once. Its faults become sentences that name the file
and the key in it, all at once; an unknown key is answered with the nearest known one.
"""
from __future__ import annotations

import re
import tomllib
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
)
from pydantic.fields import FieldInfo

from spectrabox.radiometry import errors, files
from spectrabox.radiometry.system.words import nearest_names, shortened


class Table(BaseModel):
    """A table: frozen, no unknown keys, and no number taken for a word or the other way round."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


Item = TypeVar("Item")
SomeTable = TypeVar("SomeTable", bound=Table)
ListOf = Annotated[tuple[Item, ...], Field(strict=False)]  # TOML and JSON know lists alone
TYPE_NAMES = {"string_type": "str", "int_type": "a whole number", "float_type": "a number",
              "bool_type": "true or false", "tuple_type": "list", "dict_type": "table"}
MAX_TOML_BYTES = 1_000_000      # ten thousand outlined regions; the worst takes 0.4 GB to parse
MAX_TOML_DEPTH = 10             # of lists and tables, and of the parts of a key: 5 are in use
# As the standard has them up to the first fault, where every parser stops; one that does not end
# goes on to the end, so that the text is gone through once whatever it holds.
STRING_OR_COMMENT = re.compile(
    r'''"""(?:\\.|[^\\])*?(?:"{3,5}|\\?\Z)|'{3}.*?(?:'{3,5}|\Z)'''
    r'''|"(?:\\.|[^"\\\n])*"?|'[^'\n]*'?|#[^\n]*''', re.DOTALL)
BRACKET, BETWEEN_KEYS = re.compile(r"[\[\]{}]"), re.compile(r"[=,\[\]{}\n]")
Fault = Mapping[str, Any]   # as pydantic describes one


def require_plain_toml(text: str, name: str) -> None:
    """Refuse a TOML text before it is parsed if it is larger or nested deeper than people write.

    A parser makes a table of every part of a dotted key and remembers each of its beginnings: a
    key of 30,000 parts would take gigabytes, and end in the interpreter's own limit.

    Parameters
    ----------
    text : str
    name : str
        Of the file, which begins the sentence.

    Raises
    ------
    InputError
    """
    if len(text) > MAX_TOML_BYTES:
        raise errors.InputError(files.too_large(name, MAX_TOML_BYTES))
    bare = STRING_OR_COMMENT.sub("s", text)
    depth = deepest = 0
    for bracket in BRACKET.findall(bare):
        depth = depth + 1 if bracket in "[{" else max(depth - 1, 0)
        deepest = max(deepest, depth)
    parts = 1 + max(part.count(".") for part in BETWEEN_KEYS.split(bare))
    if max(parts, deepest) > MAX_TOML_DEPTH:
        what = "lists or tables within each other" if deepest >= parts else "parts in a key"
        raise errors.InputError(
            f"{name} has {max(parts, deepest)} {what}; {MAX_TOML_DEPTH} are the limit "
            "of what is read")


def read_toml(path: Path, advice: str) -> dict[str, Any]:
    """What a TOML file holds.

    Parameters
    ----------
    advice : str
        What to give in its place, for the message.

    Raises
    ------
    InputError
        If it cannot be read, is not TOML, or larger or nested deeper than people write; ``advice``
        says what to give instead.
    """
    try:
        text = files.read_text(path, limit_bytes=MAX_TOML_BYTES)
        require_plain_toml(text, path.name)
        return tomllib.loads(text)
    except OSError as error:
        raise errors.InputError(f"{path} cannot be read ({error.strerror}); {advice}") from None
    except (ValueError, RecursionError) as error:    # also numbers of 5000 digits, deep nesting
        raise errors.InputError(f"{path.name} is not valid TOML: {error}; {advice}") from None


def checked(model: type[SomeTable], written: Any, file: str) -> SomeTable:
    """The table that a file holds.

    Parameters
    ----------
    model : subclass of Table
    written : dict
        As ``tomllib`` or ``json`` gives it.
    file : str
        Name of the file, which begins every sentence.

    Raises
    ------
    InputError
        With a sentence for every fault, one a line.
    """
    try:
        return model.model_validate(written)
    except ValidationError as error:
        raise errors.InputError(*(f"{file}: {sentence}"
                                  for sentence in fault_sentences(error, model))) from None


def fault_sentences(error: ValidationError, model: type[Table]) -> list[str]:
    """Every fault of a file in a sentence, key by key.

    Parameters
    ----------
    error : ValidationError
        Of ``model``.

    Returns
    -------
    list of str
        One for each key that is at fault; without the name of the file.
    """
    by_key: dict[str, list[tuple[_Key, Fault]]] = {}
    for fault in error.errors(include_url=False):
        key = _key_of(fault["loc"], model)
        by_key.setdefault(key.name, []).append((key, fault))
    sentences = []
    for faults in by_key.values():
        # Of the kinds that a value may be, the one that was followed furthest was meant.
        deepest = max(len(fault["loc"]) for _, fault in faults)
        sentences.append(_sentence([one for one in faults if len(one[1]["loc"]) == deepest]))
    return sentences


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word that is most like another."""
    return nearest_names(word, known, shown=1, near=0.0)[0]


class _Key(NamedTuple):
    """Where a fault is: dotted name, its parts, the model around it, the key's field and kinds."""

    name: str
    names: tuple[str, ...]
    model: type[BaseModel]
    field: FieldInfo | None
    options: list[Any]


def _key_of(loc: tuple[int | str, ...], model: type[BaseModel]) -> _Key:
    names: tuple[str, ...] = ()
    field: FieldInfo | None = None
    options: list[Any] = [model]
    for index, step in enumerate(loc):
        if len(options) > 1:    # the step says which kind was tried; only some have parts
            with_parts = tuple if loc[index + 1:] and isinstance(loc[index + 1], int) else dict
            options = [kind for kind in options if typing.get_origin(kind) is with_parts]
            continue
        kind = options[0] if options else None
        if isinstance(step, str):
            names = (*names, step)
        elif any(_is_model(part) for part in typing.get_args(kind)):
            names = (*names[:-1], f"{names[-1]} {step + 1}")    # of several tables of one name
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            model, field = kind, _fields(kind).get(str(step))
            options = _options(field.annotation) if field else []
        else:
            arguments = typing.get_args(kind)
            options = _options(arguments[typing.get_origin(kind) is dict]) if arguments else []
    return _Key(".".join(names), names, model, field, options)


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a model by the names that a file uses."""
    return {str(field.validation_alias or name): field
            for name, field in model.model_fields.items()}


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _is_table(kind: Any) -> bool:
    """Whether a kind is written as a table, or as several, by names."""
    return _is_model(kind) or (typing.get_origin(kind) is dict
                               and _is_model(typing.get_args(kind)[1]))


def _options(kind: Any) -> list[Any]:
    """The kinds that a type allows, None left out."""
    if typing.get_origin(kind) is Annotated:
        return _options(typing.get_args(kind)[0])
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return [option for part in typing.get_args(kind) for option in _options(part)]
    return [] if kind is types.NoneType else [kind]


def _sentence(faults: list[tuple[_Key, Fault]]) -> str:
    key, fault = faults[0]
    kind, value, table = fault["type"], fault["input"], ".".join(key.names[:-1])
    if kind == "extra_forbidden":
        near = nearest(key.names[-1], _fields(key.model))
        return (f"unknown key {shortened(key.names[-1])}{f' in [{table}]' if table else ''}; "
                f"did you mean {near!r}?")
    tables = [option for option in key.options if _is_table(option)]
    if not value and not tables and any(fault["type"] == "too_short" for _, fault in faults):
        needed = key.field is not None and key.field.is_required()
        return f"{key.name} is empty; name at least one{'' if needed else ', or leave it out'}"
    if kind == "missing" or (kind == "too_short" and tables):
        if not tables:
            return f"{key.name} is missing"
        return f"the table [{key.name}{'' if _is_model(tables[0]) else '.NAME'}] is missing"
    if kind == "model_type" or (kind == "dict_type" and len(faults) == 1):
        return f"[{key.name}] must be a table" if table else \
            f"{key.name} must be a table [{key.name}]"
    if kind == "literal_error":
        choices = [str(choice) for choice in typing.get_args(key.options[0])]
        return (f"{key.name} is {shortened(value)}; {', '.join(choices)} "
                f"{'are possible' if len(choices) > 1 else 'is needed'}")
    if kind in ("too_short", "too_long"):
        whole = "whole " if int in typing.get_args(key.options[0]) else ""
        count = fault["ctx"].get("min_length", fault["ctx"].get("max_length"))
        if isinstance(value, dict):
            return f"{key.name} has {len(value)} of the {count} entries that are needed"
        return f"{key.name} is {shortened(value)}; {count} {whole}numbers in brackets are needed"
    if kind in ("greater_than_equal", "less_than_equal", "finite_number"):
        number = f"{value:g}" if abs(value) < 1e300 else shortened(value)
        return f"{key.name} is {number}; {_limits(key.field)}"
    items = typing.get_args(key.options[0]) if len(key.options) == 1 else ()
    if kind == "tuple_type" and any(_is_model(item) for item in items):
        return f"write [[{key.name}]] with two brackets, once for each"
    if kind == "tuple_type" and float in items:
        return f"{key.name} is {shortened(value)}; a list of numbers is needed"
    if all(one["type"] in TYPE_NAMES for _, one in faults):
        wanted = " or ".join(dict.fromkeys(TYPE_NAMES[one["type"]] for _, one in faults))
        return f"{key.name} is {shortened(value)}; {wanted} is needed"
    # Of a validator of ours, which says it all; else what pydantic says.
    return str(fault["ctx"]["error"]) if kind == "value_error" else \
        f"{key.name} is {shortened(value)}; {fault['msg']}"


def _limits(field: FieldInfo | None) -> str:
    known = [] if field is None else [*field.metadata, *_annotations(field.annotation)]
    limits = {name: getattr(limit, name) for limit in known for name in ("ge", "le")
              if hasattr(limit, name)}
    if limits.keys() == {"ge", "le"}:
        return f"{limits['ge']:g} to {limits['le']:g} is possible"
    if "le" in limits:
        return f"{limits['le']:g} or less is possible"
    return f"{limits['ge']:g} or more is needed" if limits else "a number is needed"


def _annotations(kind: Any) -> list[Any]:
    """What is annotated anywhere inside a kind, as of a number that may be left out."""
    args = typing.get_args(kind)
    if typing.get_origin(kind) is not Annotated:
        return [each for part in args for each in _annotations(part)]
    own = [each for part in args[1:]
           for each in (part.metadata if isinstance(part, FieldInfo) else [part])]
    return own + _annotations(args[0])
