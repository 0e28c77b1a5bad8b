"""The session folder that ``spectrabox flat`` makes of a photo and what was said of it.

Photos and spectra are copied into the folder, so that it stands for itself. A later command on the
same photo writes session.toml anew as long as nobody has edited it: its last line holds a digest of
the rest.
"""
from __future__ import annotations

import contextlib
import hashlib
import json
import re
import shutil
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from spectrabox.capture.photo.image_files import require_linear_file
from spectrabox.capture.photo.orientation import AS_READ, photo_orientation
from spectrabox.radiometry.charts.layout_names import is_layout_file
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import (
    names_a_file,
    sha256_of,
    whole_file,
    writable,
    write_text_whole,
)
from spectrabox.radiometry.spectra.spectrum_files import require_fraction
from spectrabox.radiometry.system.names import file_stem
from spectrabox.sampling.further.swatch_files import read_swatch_spectra
from spectrabox.session.config.session_schema import FILE_NAME, FIRST_PHOTO
from spectrabox.session.config.template import SCHEMA_NAME, write_schema

MARK = "# as 'spectrabox flat' wrote it: "
SUFFIX = "-flat"
CARD = "white card"
WAVELENGTHS_NM = (360, 830)


@dataclass(frozen=True)
class FurtherPhoto:
    """A further photo of the samples from the same tripod; it shows the chart too."""

    photo: Path
    light: str | None = "unknown"               # a light of its own; None: the first photo's lamp
    filter: str | None = None                   # a file of its transmittance, or "unknown"

    @property
    def name(self) -> str:
        """What it is called in the session."""
        return _name(self.photo)


@dataclass(frozen=True)
class FlatOrder:
    """What the command was asked for."""

    photo: Path                                 # in which the regions are outlined
    regions: Mapping[str, Sequence[float]]      # [x0, y0, x1, y1] by name; none yet for the page
    light: str = "unknown"
    chart: Path | None = None
    flat_field: Path | None = None
    corners_px: Sequence[Sequence[float]] | None = None
    families: Mapping[str, Sequence[str]] = field(default_factory=dict)
    surfaces: Mapping[str, str] = field(default_factory=dict)   # matt, satin or glossy, by region
    picture_surface: str | None = None
    known: Mapping[str, str] = field(default_factory=dict)      # file or number, by region
    truths: Mapping[str, str] = field(default_factory=dict)
    layout: str = ""                            # of the chart: a name or a file
    reference: str | None = None                # its reflectances: a name or a file
    picture: bool = False                       # of the spectra of every pixel
    picture_light: str | None = None            # CIE name of a light beside D65
    further: Sequence[FurtherPhoto] = ()
    swatches: Path | None = None                # spectra, named as their regions
    not_linear: bool = False                    # JPEG and PNG are decoded as sRGB
    orientation: int | None = None              # of all photos; None: as the first states


@contextlib.contextmanager
def session_of(order: FlatOrder, folder: Path | None) -> Iterator[Path]:
    """The session folder, written. One that was made for this command vanishes again if it fails.

    Parameters
    ----------
    order : FlatOrder
    folder : Path or None
        None: beside the photo, named after it.

    Raises
    ------
    InputError
        If a file is missing, or the folder holds another session or an edited one.
    """
    folder = folder or folder_beside(order.photo)
    for path in (order.photo, order.chart, order.flat_field,
                 *(further.photo for further in order.further)):
        if path is not None and not path.is_file():
            raise InputError(f"{path} is missing; give the name of a photo")
        if path is not None and not order.not_linear:
            require_linear_file(path)
    _require_several(order)
    made = not folder.exists()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; name another folder with --session")
    _require_unedited(folder)
    try:
        with writable(folder.parent):
            _write(order, folder)
        yield folder
    except BaseException:
        if made:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def folder_beside(photo: Path) -> Path:
    """The session folder of a photo: beside it and named after it.

    Parameters
    ----------
    photo : Path
    """
    return photo.with_name(f"{photo.stem}{SUFFIX}")


def _name(photo: Path) -> str:
    """What something is called that is named after a photo: a name begins with a letter or digit,
    and cameras write _DSC0001.
    """
    return re.sub(r"^[\W_]+", "", photo.stem) or FIRST_PHOTO


def _require_several(order: FlatOrder) -> None:
    """Refuse photos that are given twice, or whose names are one."""
    given: dict[str, Path] = {}
    for path in (order.photo, *(further.photo for further in order.further)):
        if (other := given.get(_name(path))) is not None:
            raise InputError(f"{path} is given twice; give each photo once"
                             if path.resolve() == other.resolve() else
                             f"{other} and {path} have one name, after which results are named; "
                             "rename one")
        given[_name(path)] = path


def _require_unedited(folder: Path) -> None:
    written = folder / FILE_NAME
    if not written.exists():
        if folder.exists() and any(folder.iterdir()):
            raise InputError(f"{folder} exists and holds no session; name another folder with "
                             "--session")
        return
    body, mark, digest = written.read_text(encoding="utf-8").rpartition(MARK)
    if not mark or digest.strip() != _digest(body):
        raise InputError(f"{written} was edited since 'spectrabox flat' wrote it, or is another "
                         f"session; run it with 'spectrabox run {folder}', or name another folder "
                         "with --session")


def _write(order: FlatOrder, folder: Path) -> None:
    for part in ("photos", "spectra"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    photos = {"object": _copied(order.photo, folder, "photos")}
    for key, path in (("chart", order.chart), ("flat", order.flat_field)):
        if path is not None:
            photos[key] = _copied(path, folder, "photos")
    light, orientation = _spectrum(order.light, folder), _orientation(order, folder)
    lines = ["#:schema ./session.schema.json", "", "[session]",
             f"name = {_quoted(_name(order.photo))}", "", "[photos]",
             *(f"{key} = {_quoted(name)}" for key, name in photos.items()),
             # of all photos: a camera that looks down states any orientation
             *([] if orientation == AS_READ else [f"orientation = {orientation}"]),
             *(["not_linear = true"] if order.not_linear else []), "", "[light]",
             f"spectrum = {_quoted(light)}", ""]
    if chart := _chart(order, folder):
        lines += ["[chart]", *(f"{key} = {value}" for key, value in chart.items()), ""]
    for further in order.further:
        lines += [f"[views.{_quoted(further.name)}]",
                  f"photo = {_quoted(_copied(further.photo, folder, 'photos'))}",
                  'same_light_as = "photo"' if further.light is None
                  else f"light = {_quoted(_spectrum(further.light, folder))}",
                  *([] if further.filter is None
                    else [f"filter = {_quoted(_spectrum(further.filter, folder))}"]), ""]
    swatches = () if order.swatches is None else read_swatch_spectra(order.swatches,
                                                                     order.regions)
    if not order.regions:       # a flat sample, before anything is outlined on it
        lines += ["[regions]", ""]
    for name, rect in order.regions.items():
        lines += [f"[regions.{_quoted(name)}]", f"rect = {json.dumps(list(rect))}"]
        if name in order.known:
            lines.append(f"known = {_quoted(known_file(order.known[name], name, folder))}")
        if name in swatches:
            assert order.swatches is not None
            file = _copied(order.swatches, folder, "spectra")
            lines.append(f"swatch = {{ file = {_quoted(file)}, column = {_quoted(name)} }}")
        if name in order.truths:
            lines.append(f"truth = {_quoted(_copied(Path(order.truths[name]), folder, 'spectra'))}")
        if name in order.families:
            lines.append(f"family = {json.dumps(list(order.families[name]))}")
        if name in order.surfaces:
            lines.append(f"surface = {_quoted(order.surfaces[name])}")
        lines.append("")
    if order.picture:
        lines += ["[picture]", *(f"{key} = {_quoted(value)}" for key, value in (
            ("light", order.picture_light), ("surface", order.picture_surface))
            if value is not None), ""]
    body = "\n".join(lines)
    write_text_whole(folder / FILE_NAME, f"{body}{MARK}{_digest(body)}\n")
    if not (folder / SCHEMA_NAME).exists():
        write_schema(folder)


def _orientation(order: FlatOrder, folder: Path) -> int:
    """How photos are turned: as ordered, as the first states, or as in the session that is written
    anew, whose regions must not move.
    """
    written = folder / FILE_NAME
    if not written.exists():
        return order.orientation or photo_orientation(order.photo)
    with written.open("rb") as file:
        return int(tomllib.load(file)["photos"].get("orientation", AS_READ))


def _chart(order: FlatOrder, folder: Path) -> dict[str, str]:
    """What [chart] says, value by key; files are copied into the session."""
    said, reference = {}, order.reference
    if order.layout:
        layout = chart_layout(order.layout)
        by_file = is_layout_file(order.layout)
        name = _copied(Path(order.layout), folder, "spectra") if by_file else layout.name
        said["layout"] = _quoted(name)
        if reference is None and layout.reference_file is not None:
            reference = str(layout.reference_file)
    if reference is not None:
        said["reference"] = _quoted(_copied(Path(reference), folder, "spectra")
                                    if names_a_file(reference) else reference)
    if order.corners_px is not None:
        said["corners_px"] = json.dumps([list(corner) for corner in order.corners_px])
    return said


def _spectrum(word: str, folder: Path) -> str:
    """A word for a spectrum, or the name in the session of the copy of its file."""
    return _copied(Path(word), folder, "spectra") if names_a_file(word) else word


def _copied(path: Path, folder: Path, part: str) -> str:
    """A file's name in the session, where a copy of it lies; none is written over."""
    if not path.is_file():
        raise InputError(f"{path} is missing; give the name of a file")
    name = f"{part}/{path.name}"
    target = folder / name
    if target.exists():
        if sha256_of(target) != sha256_of(path):
            raise InputError(f"{target} is another file than {path}; name another folder with "
                             "--session")
        return name
    with whole_file(target) as unfinished:
        shutil.copyfile(path, unfinished)
    return name


def known_file(word: str, name: str, folder: Path) -> str:
    """The file of a known reflectance in the session: a copy, or one number at all wavelengths.

    Parameters
    ----------
    word : str
        A number such as 0.94 or 94%, or a file.
    name : str
        Of the region.
    folder : Path
        Of the session.

    Returns
    -------
    str
        Its name in the session.

    Raises
    ------
    InputError
        If a number is no reflectance, or the file is missing.
    """
    try:
        value = float(word[:-1]) / 100 if word.endswith("%") else float(word)
    except ValueError:
        return _copied(Path(word), folder, "spectra")
    require_fraction(value, name)
    file = f"spectra/{file_stem(name)} {value:g}.csv"
    low, high = WAVELENGTHS_NM
    write_text_whole(folder / file, f"# quantity: reflectance\nwavelength_nm,value\n{low},{value}\n"
                     f"{high},{value}\n")
    return file


def _quoted(text: str) -> str:
    """A TOML string, or a quoted key."""
    return json.dumps(text, ensure_ascii=False)


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]
