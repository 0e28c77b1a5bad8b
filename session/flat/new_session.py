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
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from spectrabox.capture.photo import image_files, preview
from spectrabox.measure.captured import FIRST_PHOTO
from spectrabox.radiometry import checked_tables, errors, files
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.spectra import given_spectra, light_words, spectrum_files
from spectrabox.radiometry.system.words import file_stem
from spectrabox.session.config import session_file, template

MARK = "# as 'spectrabox flat' wrote it: "
SUFFIX = "-flat"
CARD = "white card"
WAVELENGTHS_NM = (360, 830)
PHOTO_KEYS = ("object", "chart", "flat", "photo")       # whose files are photos
REGIONS_ADVICE = "write [regions.NAME] and rect = [x0, y0, x1, y1] for each region"
Tables = dict[str, Any]     # of session.toml, by their names


class StatedRegion(checked_tables.Table):
    """A region of a file of its own: what ``[regions.NAME]`` of a session may say of it, where
    ``known`` may be a number.
    """

    rect: Annotated[checked_tables.ListOf[float], Field(min_length=4, max_length=4)]
    family: str | checked_tables.ListOf[str] | None = None
    surface: Literal["matt", "satin", "glossy"] | None = None
    known: float | str | None = None
    truth: str | None = None


class RegionsFile(checked_tables.Table):
    """Regions for photos that are framed alike."""

    regions: dict[str, StatedRegion] = Field(min_length=1)


@contextlib.contextmanager
def new_session(tables: Tables, folder: Path | None) -> Iterator[Path]:
    """The session folder, written. One that was made for this command vanishes again if it fails.

    Parameters
    ----------
    tables : dict of dict
        What session.toml is to say: a ``Path`` is a file that is copied into the session, None is
        left out, and a region's ``known`` may be a number. Photos are turned as the first states,
        unless ``orientation`` says otherwise.
    folder : Path or None
        None: beside the photo, named after it.

    Raises
    ------
    InputError
        If a file is missing, or the folder holds another session or an edited one.
    """
    photos = tables["photos"]
    folder = folder or folder_beside(photos["object"])
    for path in (*map(photos.get, PHOTO_KEYS),
                 *(view["photo"] for view in (tables.get("views") or {}).values())):
        if path is not None and not path.is_file():
            raise errors.InputError(f"{path} is missing; give the name of a photo")
        if path is not None and not photos.get("not_linear"):
            image_files.require_linear_file(path)
    is_new = not folder.exists()
    if folder.exists() and not folder.is_dir():
        raise errors.InputError(f"{folder} is a file; name another folder with --session")
    _require_unedited(folder)
    try:
        with files.writable(folder.parent):
            _write(tables, folder)
        yield folder
    except BaseException:
        if is_new:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def tables_without_regions(photo: Path, *others: Path) -> Tables:
    """What session.toml says of photos of flat samples before anything is outlined on them.

    Parameters
    ----------
    photo, *others : Path
        From one tripod, each under an unknown light of its own.
    """
    return {
        **tables_of_photo(photo), "light": {"spectrum": light_words.UNKNOWN}, "views":
        views_of(photo, [(other, {"light": light_words.UNKNOWN}) for other in others]) or None,
        "regions": {}
    }


def tables_of_photo(photo: Path, **stated: Any) -> Tables:
    """[session] and [photos] of a photo.

    Parameters
    ----------
    photo : Path
    **stated
        Further keys of [photos].
    """
    return {"session": {"name": _name(photo)}, "photos": {"object": photo, **stated}}


def views_of(photo: Path, further: Iterable[tuple[Path, dict[str, Any]]]) -> Tables:
    """[views] of further photos of the same samples, each named after its file.

    Parameters
    ----------
    photo : Path
        The first.
    further : iterable of (Path, dict)
        A photo, and what its table says of light and filter.

    Raises
    ------
    InputError
        If a photo is given twice, or two have one name.
    """
    given = {_name(photo): photo}
    views = dict[str, Any]()
    for path, said in further:
        name = _name(path)
        if (other := given.get(name)) is not None:
            raise errors.InputError(f"{path} is given twice; give each photo once"
                             if path.resolve() == other.resolve() else
                             f"{other} and {path} have one name, after which results are named; "
                             "rename one")
        given[name], views[name] = path, {"photo": path, **said}
    return views


def read_regions(path: Path) -> Tables:
    """[regions] of a TOML file; files that it names lie beside it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it cannot be read, or a key is unknown or of another kind.
    """
    tables: Tables = {}
    for name, region in checked_tables.checked(RegionsFile,
                                               checked_tables.read_toml(path, REGIONS_ADVICE),
                                               path.name).regions.items():
        said = {key: value for key, value in vars(region).items() if value is not None}
        for key in ("known", "truth"):
            if isinstance(said.get(key), str):
                said[key] = path.parent / said[key]
        if isinstance(region.family, str):
            said["family"] = [region.family]
        tables[name] = said
    return tables


def file_or_word(word: str) -> Path | str:
    """A file that is to be copied into the session, or a word such as D65.

    Parameters
    ----------
    word : str
    """
    return Path(word) if files.names_a_file(word) else word


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


def _require_unedited(folder: Path) -> None:
    written = folder / session_file.FILE_NAME
    if not written.exists():
        if folder.exists() and any(folder.iterdir()):
            raise errors.InputError(
                f"{folder} exists and holds no session; name another folder with "
                "--session")
        return
    body, mark, digest = written.read_text(encoding="utf-8").rpartition(MARK)
    if not mark or digest.strip() != _digest(body):
        raise errors.InputError(
            f"{written} was edited since 'spectrabox flat' wrote it, or is another "
            f"session; run it with 'spectrabox run {folder}', or name another folder "
            "with --session")


def _write(tables: Tables, folder: Path) -> None:
    for part in ("photos", "spectra"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    orientation = _orientation(tables["photos"], folder)
    photos = tables["photos"] | {
        "orientation": None if orientation == preview.AS_READ else orientation
    }
    regions = {name: region | ({"known": known_file(str(region["known"]), name, folder)}
                               if "known" in region else {})
               for name, region in tables["regions"].items()}
    body = toml_text(_in_session(tables | {"photos": photos, "regions": regions}, folder))
    files.write_text_whole(folder / session_file.FILE_NAME, f"{body}{MARK}{_digest(body)}\n")
    if not (folder / template.SCHEMA_NAME).exists():
        template.write_schema(folder)


def _orientation(photos: Mapping[str, Any], folder: Path) -> int:
    """How photos are turned: as stated, as the first states, or as in the session that is written
    anew, whose regions must not move.
    """
    written = folder / session_file.FILE_NAME
    if not written.exists():
        return photos.get("orientation") or preview.photo_orientation(photos["object"])
    return int(
        checked_tables.read_toml(written,
                                 "move it away")["photos"].get("orientation", preview.AS_READ))


def _in_session(value: Any, folder: Path, key: str = "") -> Any:
    """Tables whose files have been copied into the session, by their names there."""
    if isinstance(value, dict):
        return {each: _in_session(own, folder, each) for each, own in value.items()
                if own is not None}
    if isinstance(value, Path):
        return _copied(value, folder, "photos" if key in PHOTO_KEYS else "spectra")
    return value


def toml_text(tables: Tables) -> str:
    """A session.toml: a table for each of [views] and [regions], one line for every key.

    Parameters
    ----------
    tables : dict of dict
        Of text, numbers, truths, lists of them, and small tables.
    """
    lines = [f"#:schema ./{template.SCHEMA_NAME}"]
    for section, table in tables.items():
        several = section in ("views", "regions") and table
        for header, keys in ({f"{section}.{_toml(name)}": own for name, own in table.items()}
                             if several else {section: table}).items():
            lines += ["", f"[{header}]", *(f"{key} = {_toml(own)}" for key, own in keys.items())]
    return "\n".join([*lines, ""])


def _toml(value: Any) -> str:
    """A value or a quoted key."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(own)}' for key, own in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)


def _copied(path: Path, folder: Path, part: str) -> str:
    """A file's name in the session, where a copy of it lies; none is written over."""
    if not path.is_file():
        raise errors.InputError(f"{path} is missing; give the name of a file")
    name = f"{part}/{path.name}"
    target = folder / name
    if target.exists():
        if files.sha256_of(target) != files.sha256_of(path):
            raise errors.InputError(
                f"{target} is another file than {path}; name another folder with "
                "--session")
        return name
    with files.whole_file(target) as unfinished:
        shutil.copyfile(path, unfinished)
    return name


def known_file(word: str, name: str, folder: Path) -> str:
    """The file of a known reflectance in the session: a copy, or one number at all wavelengths.

    Parameters
    ----------
    word : str
        A number such as 0.94 or 94%, or with its standard error 0.94+-0.01; or a file.
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
        numbers = given_spectra.typed_reflectance(word)
    except ValueError:
        return _copied(Path(word), folder, "spectra")
    for number in numbers:
        spectrum_files.require_fraction(number, name)
    file = f"spectra/{file_stem(name)} {' +- '.join(f'{number:g}' for number in numbers)}.csv"
    columns = ("wavelength_nm", "value", "standard_error")[:1 + len(numbers)]
    rows = [(end, *numbers) for end in WAVELENGTHS_NM]
    files.write_text_whole(folder / file, "# quantity: reflectance\n" + "".join(
        ",".join(map(str, row)) + "\n" for row in (columns, *rows)))
    return file


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]


# ---- a picture of a photo with the pixels of the photo on its axes, to read regions from ---------

WIDTH_PX, WIDTH_IN = 1400, 14.0


def write_picture(image: LinearImage, picture: Path,
                  patches_px: np.ndarray | None = None) -> tuple[int, int]:
    """Write a PNG of a photo with axes that count its pixels.

    Parameters
    ----------
    image : LinearImage
    picture : Path
        Ends in .png.
    patches_px : (I, 4, 2) array, optional
        Of the chart, in pixels of the photo: they are drawn.

    Returns
    -------
    tuple of int
        Width and height of the photo in pixels.
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MultipleLocator
    rows, columns = image.signal.shape[:2]
    width, height = round(columns * image.sensor_step), round(rows * image.sensor_step)
    if columns > WIDTH_PX:
        image = preview.bin_image(image, WIDTH_PX, round(WIDTH_PX * rows / columns))
    with style.context("default"):      # not as a matplotlibrc of the working folder has it
        drawing = Figure(figsize=(WIDTH_IN, WIDTH_IN * height / width), layout="constrained")
        axes = drawing.add_subplot()
        axes.imshow(preview.signal_rgb8(image.signal),
                    extent=(-0.5, width - 0.5, height - 0.5, -0.5))
        for quad in () if patches_px is None else patches_px:
            for colour, line_width in (("white", 2.0), ("black", 0.7)):
                axes.fill(*quad.T, fill=False, edgecolor=colour, linewidth=line_width)
        step = 10.0 ** np.floor(np.log10(width / 4))
        axes.xaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_locator(MultipleLocator(step))
        axes.grid(color="white", alpha=0.5, linewidth=0.5)
        axes.tick_params(labeltop=True, labelright=True)
        FigureCanvasAgg(drawing).print_png(str(picture))
    return width, height
