"""The files that ``spectrabox camera fit`` writes."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.measure.camera import CameraFit
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import whole_file, write_text_whole
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text


def require_outputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse outputs that are folders or would replace an input, before anything is computed.

    Raises
    ------
    InputError
    """
    for path in outputs:
        if path.is_dir():
            raise InputError(f"{path} is a folder; give the name of a file to write")
        if path.resolve() in {source.resolve() for source in inputs}:
            raise InputError(f"{path} is an input of this command and would be replaced; give "
                             "another name")


def write_curves(path: Path, camera: CameraFit) -> None:
    """Curves and their standard errors, a column each."""
    write_text_whole(path, table_text(camera.sensitivity.grid.nm, camera.columns(),
                                      quantity=Quantity.RELATIVE, source=camera.source))


def write_draws(path: Path, camera: CameraFit) -> None:
    """Draws of all curves together as an NPZ."""
    if camera.band is None or camera.band.draws is None:
        raise InputError("draws come with the method prior only; leave --draws-file out")
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, wavelengths_nm=camera.sensitivity.grid.nm,
                            curves=camera.band.draws)
