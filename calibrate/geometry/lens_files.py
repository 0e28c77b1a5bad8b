"""A lens as a small JSON file."""
from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.radiometry.checked_tables import ListOf, Table, fault_sentences
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import write_text_whole

FORMAT = "spectrabox lens 1"
ARRAYS = ("matrix", "distortion", "standard_error", "distortion_error")
Row = Annotated[ListOf[float], Field(min_length=3, max_length=3)]
Distortion = Annotated[ListOf[float], Field(min_length=5, max_length=5)]


class LensTable(Table):
    """A lens file."""

    format: Literal["spectrabox lens 1"]
    width: int
    height: int
    matrix: Annotated[ListOf[Row], Field(min_length=3, max_length=3)]
    distortion: Distortion
    standard_error: Annotated[ListOf[float], Field(min_length=4, max_length=4)]
    distortion_error: Distortion
    rms_px: float
    source: str

    @model_validator(mode="after")
    def focal_length_is_positive(self) -> LensTable:
        """Refuse a lens that would turn pictures inside out."""
        if not (self.matrix[0][0] > 0 and self.matrix[1][1] > 0):
            raise ValueError("its focal length is not positive")
        return self


def lens_facts(lens: Lens) -> dict[str, object]:
    """What the file holds, in pixels of the whole photo.

    Parameters
    ----------
    lens : Lens
    """
    return {"format": FORMAT, "width": lens.width, "height": lens.height,
            **{name: getattr(lens, name).tolist() for name in ARRAYS}, "rms_px": lens.rms_px,
            "source": lens.source}


def write_lens(path: Path, lens: Lens) -> None:
    """Write the lens, whole or not at all.

    Parameters
    ----------
    path : Path
    lens : Lens
    """
    write_text_whole(path, json.dumps(lens_facts(lens), indent=1) + "\n")


def read_lens(path: Path) -> Lens:
    """A lens that ``write_lens`` wrote.

    Parameters
    ----------
    path : Path
        JSON.

    Raises
    ------
    InputError
        If the file is missing, or is not such a file.
    """
    try:
        written = LensTable.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); "
                         "write one with 'spectrabox geometry lens'") from None
    except ValidationError as error:
        reasons = "; ".join(fault_sentences(error, LensTable))
        raise InputError(f"{path.name} is no lens file ({reasons}); write one with 'spectrabox "
                         "geometry lens'") from None
    facts = dict(written) | {name: np.array(getattr(written, name)) for name in ARRAYS}
    del facts["format"]
    return Lens(**facts)
