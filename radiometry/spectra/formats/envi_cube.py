"""ENVI images written some rows at a time: a text header (.hdr) beside float32 values (.img)."""
from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from spectrabox.radiometry.files import whole_file, write_text_whole

VALUES = ".img"


@contextlib.contextmanager
def envi_rows(header: Path, height: int, width: int, nm: np.ndarray, quantity: str,
              description: str, fwhm_nm: float) -> Iterator[Callable[[int, np.ndarray], None]]:
    """A function of (first row, pixels (n, W, P)) that writes the next rows of an ENVI image; both
    its files are there once all of them are written.

    Parameters
    ----------
    header : Path
        Ends in .hdr; the values go beside it, to .img, by pixel (BIP).
    height, width : int
    nm : (P,) array
    quantity : str
        What the values are, such as reflectance.
    description : str
    fwhm_nm : float
        Full width at half maximum that the value at each wavelength stands for.

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written.
    """
    with whole_file(header.with_suffix(VALUES)) as unfinished, unfinished.open("wb") as file:
        yield lambda first, pixels: pixels.astype("<f4").tofile(file)
    write_text_whole(header, _header(height, width, nm, quantity, description, fwhm_nm))


def _header(height: int, width: int, nm: np.ndarray, quantity: str, description: str,
            fwhm_nm: float) -> str:
    words = re.sub("[{}]", " ", " ".join(description.split()))
    return "\n".join([
        "ENVI", f"description = {{{words}}}", f"samples = {width}", f"lines = {height}",
        f"bands = {nm.size}", "header offset = 0", "file type = ENVI Standard", "data type = 4",
        "interleave = bip", "byte order = 0", "wavelength units = Nanometers",
        f"quantity = {quantity}",
        f"wavelength = {{{', '.join(f'{wavelength:g}' for wavelength in nm)}}}",
        f"fwhm = {{{', '.join([f'{fwhm_nm:g}'] * nm.size)}}}"]) + "\n"
