"""Writes docs/reference/python.md from the docstrings of the public names: every name of
spectrabox/__init__.pyi, in the order of GROUPS.
"""
from __future__ import annotations

import inspect
import re
from functools import cached_property
from pathlib import Path

import spectrabox as sb

PAGE = Path(__file__).resolve().parent / "reference" / "python.md"
REPOSITORY = PAGE.parents[2]
GROUPS = {
    "From a photo": ["open_photo", "find_chart", "flat", "fit_camera", "reconstruct_scene",
                     "fit_shape", "split_texture"],
    "From signals": ["sample", "uplift", "match"],
    "From a name": ["camera", "cameras", "lights"],
    "From an instrument": ["measure_spectrum"],
    "What to do next": ["advise"],
    "Sessions": ["Session"],
    "What the functions return": ["Photo", "ChartInPhoto", "CameraEstimate", "KnownCamera",
                                  "SpectrumEstimate", "SpectrumEstimates", "PixelSpectra",
                                  "MeasuredSpectra",
                                  "FlatSpectra",
                                  "SceneSpectra", "ShapeSpectra",
                                  "ColourComparison", "ChartCheck",
                                  "ColourProfile", "MatrixComparison", "MeterReading"],
    "Errors": ["SpectraboxError", "InputError", "CheckError", "ChartNotFoundError",
               "ClippedPhotoError", "CalibrationError", "ConvergenceError", "EnvironmentProblem"]}
SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "References", "Examples")
# examples that tests/test_docs.py does not run
NOT_RUN = {"measure_spectrum": "needs-meter", "MeterReading": "needs-meter",
           "fit_shape": "needs-photos", "ShapeSpectra": "needs-photos",
           "split_texture": "needs-photos"}
HEAD = """\
# Python reference

Every public name, from the docstrings (`python docs/make_python_reference.py` writes this page).
How they work together: [from Python](../how-to/python.md) and the
[notebooks](../README.md#notebooks).

```sh
spectrabox demo painting --flat
```

```python
import spectrabox as sb
```

The examples use the files of this demo and of `spectrabox demo mybox`. Shapes: K bands of the
camera, P wavelengths in nm, T draws, I chart patches, (H, W) an image. Reflectances and signals
relative to white run from 0 to 1. Where a function takes a light, it takes what the command line
takes: the name of a CIE illuminant ("D65"), the path of a spectral file, wavelengths with values
(nm, values), a SpectralDistribution of colour-science, or a record. Other spectra are taken
likewise, and a camera's curves as MultiSpectralDistributions too. No function prints (a notebook
shows a bar while a long call lasts), needs a session folder, or writes a file that was not asked
for; equal arguments and seeds give equal results, bit for bit those of the commands.

## What stays

Public is what `spectrabox.__all__` lists, with the parameters, attributes and methods on this page.
All other modules may change in any version; import nothing from them in scripts that are to last.

- **From 1.0 on** public names are stable. A name, a parameter or an attribute is removed or changes
  its meaning in a major version only (2.0), and at the earliest two minor versions and six months
  after it was deprecated. Until then it works and warns with a `DeprecationWarning` that says what
  to write instead; [CHANGELOG](../../CHANGELOG.md) lists it.
- **Minor versions** add names, parameters with a default (keyword only) and attributes.
- **Numbers** may move in a minor version where a method becomes better; CHANGELOG says by how much.
  In a patch version they move by round-off only.
- **Before 1.0** minor versions (0.3) may change public names; CHANGELOG says so, with what to write
  instead. Not to change any more: `flat`, `sample`, `fit_camera`, `reconstruct_scene`, `uplift`,
  `Session`, `open_photo`, `find_chart`, and the attributes `nm`, `mean`, `standard_deviation`,
  `band`, `bounds`, `draws`, `plot`.
- **Messages** of errors, `repr`s and pictures may change at any time; do not parse them. The
  classes of errors are stable.
"""


def reference_page() -> str:
    """The text of the page."""
    parts = [HEAD]
    for title, names in GROUPS.items():
        parts += [f"## {title}\n", _errors() if title == "Errors" else
                  "\n".join(_entry(name) for name in names)]
    return "\n".join(parts)


def sections_of(doc: str) -> dict[str, str]:
    """The text of a numpy docstring by section; the summary and what follows it under ""."""
    parts = re.split(rf"^({'|'.join(SECTIONS)})\n-+\n", inspect.cleandoc(doc), flags=re.MULTILINE)
    return {"": parts[0].strip(), **{name: text.strip("\n") for name, text
                                     in zip(parts[1::2], parts[2::2], strict=True)}}


def methods_of(owner: type) -> dict[str, object]:
    """Public methods and properties of a class that it defines itself, in their order."""
    return {name: value for name, value in vars(owner).items() if not name.startswith("_")
            and (inspect.isfunction(value) or isinstance(value, property | cached_property))}


def _entry(name: str) -> str:
    """A function, or a class with its attributes and methods."""
    value = getattr(sb, name)
    sections = sections_of(value.__doc__)
    lines = [f"### `{name}`\n", f"```text\n{_call('sb.' + name, value)}\n```\n"] \
        if inspect.isfunction(value) or name == "Session" else [f"### `{name}`\n"]
    lines.append(_prose(sections[""]) + "\n")
    if inspect.isfunction(value):
        return "\n".join(lines + _tables(sections, name))
    own = methods_of(value)
    base = value.__mro__[1]
    if base.__name__ in dir(sb):
        lines.append(f"Has all that [`{base.__name__}`](#{base.__name__.lower()}) has, and:\n")
    properties = [(key, part) for key, part in own.items() if not inspect.isfunction(part)]
    attributes = items(sections.pop("Attributes", "")) + [
        (key, "", _property(part.__doc__ or "")) for key, part in properties]
    lines += _tables({"Parameters": sections.pop("Parameters", "")})
    lines += _table("attribute", attributes) + _tables(sections, name)
    for key, method in own.items():
        if inspect.isfunction(method):
            said = sections_of(method.__doc__ or "")
            lines += [f"#### `{name}.{key}`\n", f"```text\n{_call('.' + key, method)}\n```\n",
                      _prose(said[""]) + "\n", *_tables(said)]
    return "\n".join(lines)


def _property(doc: str) -> str:
    """What a property holds, and what reading it may raise."""
    sections = sections_of(doc)
    raised = " ".join(f"Raises `{name}` {about[:1].lower()}{about[1:]}" for name, _, about
                      in items(sections.get("Raises", "")))
    return f"{sections['']} {raised}".strip()


def _errors() -> str:
    """Table of the exceptions with the exit codes of the commands that they end."""
    rows = [(f"{name}", f"a `{getattr(sb, name).__mro__[1].__name__}`; exit code "
             f"{getattr(sb, name).exit_code}", sections_of(getattr(sb, name).__doc__)[""])
            for name in GROUPS["Errors"]]
    return ("The message of each is one sentence: what was found, what is needed, what to do. "
            "It is the sentence of the command.\n\n" + "\n".join(_table("exception", rows)))


def _call(name: str, function: object) -> str:
    """The call with its defaults, without annotations, in lines of at most 100 characters."""
    signature = inspect.signature(function)  # type: ignore[arg-type]
    words, keyword_only = [], False
    for parameter in signature.parameters.values():
        if parameter.name == "self":
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not keyword_only:
            words.append("*")
            keyword_only = True
        default = "..." if inspect.isfunction(parameter.default) else repr(parameter.default)
        words.append(parameter.name if parameter.default is parameter.empty
                     else f"{parameter.name}={default}")
    lines, line = [], f"{name}("
    for number, word in enumerate(words):
        piece = word + ("," if number < len(words) - 1 else "")
        if len(line) + len(piece) > 98:
            lines.append(line.rstrip())
            line = " " * (len(name) + 1)
        line += piece + " "
    return "\n".join([*lines, line.rstrip() + ")"])


def _tables(sections: dict[str, str], name: str = "") -> list[str]:
    lines = _table("parameter", items(sections.get("Parameters", "")))
    for section in ("Returns", "Raises"):
        if sections.get(section):
            lines += _table(section.lower(), items(sections[section]))
    if sections.get("References"):
        lines.append(f"Source: {_prose(sections['References'])}\n")
    if sections.get("Examples"):
        code = "\n".join(line[4:] for line in sections["Examples"].splitlines()
                         if line.startswith((">>> ", "... ")))
        mark = f" {NOT_RUN[name]}" if name in NOT_RUN else ""
        lines.append(f"```python{mark}\n{code}\n```\n")
    return lines


def items(text: str) -> list[tuple[str, str, str]]:
    """Name, type and description of each entry of a section."""
    items = []
    for entry in re.split(r"\n(?=\S)", text) if text else []:
        head, _, description = entry.partition("\n")
        name, _, kind = head.partition(" : ")
        items.append((name, kind, " ".join(description.split())))
    return items


def _table(title: str, items: list[tuple[str, str, str]]) -> list[str]:
    if not items:
        return []
    rows = [f"| {title} | |", "|---|---|"]
    for name, kind, description in items:
        names = f"`{name}`" if "(" in name else ", ".join(f"`{one}`" for one in name.split(", "))
        about = ". ".join(part.rstrip(".") for part in (kind, _prose(description)) if part)
        rows.append(f"| {names} | {about.replace('|', chr(92) + '|')} |")
    return ["\n".join(rows) + "\n"]


def _prose(text: str) -> str:
    """A paragraph in Markdown: double backticks as single ones, pages of docs/ as links."""
    plain = " ".join(text.split()).replace("``", "`")
    plain = re.sub(r"`(\w+)`", lambda name: f"[`{name[1]}`](#{name[1].lower()})"
                   if name[1] in sb.__all__ else name[0], plain)
    return re.sub(r"\bdocs/([\w/-]+)\.md", lambda page: f"[{page[1].rsplit('/')[-1]}]"
                  f"({'../' + page[1] if '/' in page[1] else page[1]}.md)", plain)


if __name__ == "__main__":
    PAGE.write_text(reference_page(), encoding="utf-8")
    print(f"{PAGE.relative_to(REPOSITORY)} written")
