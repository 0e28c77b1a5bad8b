"""Pictures of spectra of low rank: of each pixel a few coefficients, and once a basis.

``low_rank.zarr`` is a group of ``coefficients`` (y, x, component), ``mean_basis`` and
``standard_deviation_basis`` (row, wavelength); ``low_rank.exr`` has a channel a coefficient and the
rest in its header. A spectrum is row 0 of its basis, plus coefficients times the other rows. What
that costs is stated beside it.
"""
from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_rows import exr_rows, open_layers, open_rows
from spectrabox.radiometry.appearance import TO_SRGB, adapted_tristimulus
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import writable
from spectrabox.radiometry.spectra.formats.zarr_array import (
    COEFFICIENTS,
    low_rank_rows,
    read_group,
)
from spectrabox.radiometry.system.strips import WriteRows
from spectrabox.sampling.prior.low_rank import LowRank
from spectrabox.session.signals.spectra_rows import (
    DAYLIGHT,
    SUFFIXES,
    Canvas,
    KeptWavelengths,
    Rows,
    in_order,
)

STEM = "low_rank"
FORM = "spectrabox low rank 1"
BASES, NM = ("mean_basis", "standard_deviation_basis"), ("mean_nm", "standard_deviation_nm")
CHANNEL, WORD = "coefficient.", "spectrabox:lowRank"
HOW = "spectrum = basis[0] + coefficients @ basis[1:]"


@dataclass(frozen=True)
class LowRankPicture:
    """A picture of low rank, open for reading."""

    height: int
    width: int
    mean_nm: np.ndarray             # (P,)
    standard_deviation_nm: np.ndarray   # (Q,)
    errors: dict[str, Any]          # what the low rank costs, as the file states it
    low_rank: LowRank
    coefficients: Callable[[int, int], np.ndarray]      # (first, last) -> (last - first, W, N)

    def read(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n, W, P) and standard deviation (n, W, Q) of rows ``first`` to ``last``."""
        both = self.low_rank.spectra(self.coefficients(first, last))
        return both[..., :self.mean_nm.size], both[..., self.mean_nm.size:]


def open_low_rank(path: Path | str) -> LowRankPicture:
    """A picture that ``uplift --low-rank`` wrote, read some rows at a time.

    Parameters
    ----------
    path : Path
        ``low_rank.zarr`` or ``low_rank.exr``.

    Raises
    ------
    InputError
        If it is none, or damaged.
    """
    path = Path(path)
    try:
        if path.is_dir():
            about, tables = read_group(path, BASES)
            rows = open_rows(path / COEFFICIENTS)
        else:
            rows, words = open_layers(path, CHANNEL, WORD)
            about = json.loads(words)
            tables = [np.array(about[name], dtype=np.float32) for name in BASES]
        mean_nm, spread_nm = (np.array(about[name], dtype=float) for name in NM)
        whole = about["form"] == FORM and all(
            table.shape == (rows.bands + 1, each.size)
            for table, each in zip(tables, (mean_nm, spread_nm), strict=True))
        if not whole:
            raise InputError(f"{path.name} holds another form than '{FORM}', or parts that do not "
                             "fit together; write it again")
        return LowRankPicture(rows.height, rows.width, mean_nm, spread_nm, about["errors"],
                              LowRank(np.hstack(tables)), rows.read)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{path.name} cannot be read as a picture of low rank ({error}); write it "
                         "again") from None


def write_low_rank(canvas: Canvas[Rows], folder: Path, kept: KeptWavelengths, low: LowRank,
                   errors: dict[str, object], progress: Callable[[float], None]) -> Path:
    """Write the coefficients of all pixels and their basis, whole or not at all.

    Parameters
    ----------
    canvas : Canvas
        Of coefficients (n, N).
    folder : Path
    kept : KeptWavelengths
    low : LowRank
    errors : dict
    progress : function of the share that is done

    Returns
    -------
    Path
        Of the file.
    """
    path = low_rank_path(folder, kept)
    with writable(folder), _rows_of(path, canvas, kept, low, errors) as write:
        for first, last, (coefficients,) in in_order(canvas):
            write(first, coefficients.reshape(last - first, canvas.width, -1))
            progress(last / canvas.height)
    return path


def low_rank_path(folder: Path, kept: KeptWavelengths) -> Path:
    """The file, by its format.

    Raises
    ------
    InputError
        For ENVI images, which have no place for a basis.
    """
    if kept.form == "envi":
        raise InputError("ENVI images have no place for the basis of --low-rank; give --to zarr, "
                         "exr or tiled-exr")
    return folder / f"{STEM}{SUFFIXES[kept.form]}"


def stated(kept: KeptWavelengths, low: LowRank,
           errors: dict[str, object]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The two bases, by their names, and what else a file says."""
    mean_nm, spread_nm = kept.nm
    tables = dict(zip(BASES, np.split(low.basis, [mean_nm.size], axis=1), strict=True))
    return tables, {"form": FORM, "how": HOW, "quantity": "reflectance",
                    "mean_nm": mean_nm.tolist(), "standard_deviation_nm": spread_nm.tolist(),
                    "errors": errors}


@contextlib.contextmanager
def _rows_of(path: Path, canvas: Canvas[Rows], kept: KeptWavelengths, low: LowRank,
             errors: dict[str, object]) -> Iterator[WriteRows]:
    tables, about = stated(kept, low, errors)
    size = canvas.height, canvas.width
    if kept.form == "zarr":
        with low_rank_rows(path, *size, not kept.full, tables, about) as write:
            yield write
        return
    count = len(low.basis) - 1
    words = json.dumps(about | {name: [[float(f"{value:.9g}") for value in row] for row in table]
                                for name, table in tables.items()})
    colours = tables[BASES[0]] @ (TO_SRGB @ adapted_tristimulus(kept.nm[0], DAYLIGHT)).T.astype(
        np.float32)
    with exr_rows(path, *size, [*"RGB", *(f"{CHANNEL}{index:02d}" for index in range(count))],
                  not kept.full, {WORD: words}, tiles=kept.form == "tiled-exr") as write:
        yield lambda first, made: write(first, np.dstack([colours[0] + made @ colours[1:], made]))
