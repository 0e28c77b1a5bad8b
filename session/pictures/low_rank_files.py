"""Files of pictures of low rank: a few coefficients for each pixel, and one basis of spectra.

``low_rank.zarr`` is a group of ``coefficients`` (y, x, component), ``mean_basis`` and
``standard_deviation_basis`` (row, wavelength); ``low_rank.exr`` has a channel a coefficient and the
rest in its header. A spectrum is row 0 of its basis, plus coefficients times the other rows. The
file states the errors of that.
"""
from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_rows import exr_rows, open_layers, open_rows
from spectrabox.measure.pictures.pixel_spectra import SpectraPlan
from spectrabox.measure.pictures.spectra_files import (
    SUFFIXES,
    PictureLayout,
    srgb_of_spectra,
    write_blocks,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.zarr_array import COEFFICIENTS, low_rank_rows, read_group
from spectrabox.radiometry.system.strips import WriteRows
from spectrabox.sampling.prior.low_rank import LowRank

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
    errors: dict[str, Any]          # of the low rank, as the file states them
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
        mean_nm, deviation_nm = (np.array(about[name], dtype=float) for name in NM)
        whole = about["form"] == FORM and all(
            table.shape == (rows.bands + 1, each.size)
            for table, each in zip(tables, (mean_nm, deviation_nm), strict=True))
        if not whole:
            raise InputError(f"{path.name} holds another form than '{FORM}', or parts that do not "
                             "fit together; write it again")
        return LowRankPicture(rows.height, rows.width, mean_nm, deviation_nm, about["errors"],
                              LowRank(np.hstack(tables)), rows.read)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{path.name} cannot be read as a picture of low rank ({error}); write it "
                         "again") from None


def write_low_rank(blocks: Iterable[tuple[int, int, tuple[np.ndarray, ...]]],
                   size: tuple[int, int], folder: Path, layout: PictureLayout, plan: SpectraPlan,
                   progress: Callable[[float], None]) -> dict[str, Path]:
    """Write the coefficients of all pixels and their basis, whole or not at all.

    Parameters
    ----------
    blocks : iterable of (first row, last row, (coefficients (n, N),))
    size : (height, width)
    folder : Path
    layout : PictureLayout
    plan : SpectraPlan
        With a low rank.
    progress : function of the share that is done

    Returns
    -------
    dict
        "low_rank" to its file.
    """
    path = low_rank_path(folder, layout)
    write_blocks(blocks, size, folder, [_coefficient_rows(path, size, layout, plan)], progress)
    return {STEM: path}


def low_rank_path(folder: Path, layout: PictureLayout) -> Path:
    """The file, by its format.

    Raises
    ------
    InputError
        For ENVI images, which have no place for a basis.
    """
    if layout.form == "envi":
        raise InputError("ENVI images have no place for the basis of --low-rank; give --to zarr, "
                         "exr or tiled-exr")
    return folder / f"{STEM}{SUFFIXES[layout.form]}"


def low_rank_attributes(plan: SpectraPlan) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The two bases by their names, and the other attributes of a file."""
    assert plan.low_rank is not None
    mean_nm, deviation_nm = plan.kept.nm
    tables = dict(zip(BASES, np.split(plan.low_rank.basis, [mean_nm.size], axis=1), strict=True))
    return tables, {"form": FORM, "how": HOW, "quantity": "reflectance",
                    "mean_nm": mean_nm.tolist(), "standard_deviation_nm": deviation_nm.tolist(),
                    "errors": plan.errors}


@contextlib.contextmanager
def _coefficient_rows(path: Path, size: tuple[int, int], layout: PictureLayout,
                      plan: SpectraPlan) -> Iterator[WriteRows]:
    tables, about = low_rank_attributes(plan)
    if layout.form == "zarr":
        with low_rank_rows(path, *size, not layout.full, tables, about) as write:
            yield write
        return
    basis = tables[BASES[0]]
    words = json.dumps(about | {name: [[float(f"{value:.9g}") for value in row] for row in table]
                                for name, table in tables.items()})
    colours = basis @ srgb_of_spectra(layout.nm[0])
    names = [*"RGB", *(f"{CHANNEL}{index:02d}" for index in range(len(basis) - 1))]
    with exr_rows(path, *size, names, not layout.full, {WORD: words},
                  tiles=layout.form == "tiled-exr") as write:
        yield lambda first, rows: write(first, np.dstack([colours[0] + rows @ colours[1:], rows]))
