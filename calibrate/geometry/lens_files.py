"""A lens as a small JSON file."""
from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import write_text_whole

FORMAT = "spectrabox lens 1"
ARRAYS = {"matrix": (3, 3), "distortion": (5,), "standard_error": (4,), "distortion_error": (5,)}


def lens_facts(lens: Lens) -> dict[str, object]:
    """What the file holds, in pixels of the whole photo."""
    return {"format": FORMAT, "width": lens.width, "height": lens.height,
            **{name: getattr(lens, name).tolist() for name in ARRAYS}, "rms_px": lens.rms_px,
            "source": lens.source}


def write_lens(path: Path, lens: Lens) -> None:
    """Write the lens, whole or not at all."""
    write_text_whole(path, json.dumps(lens_facts(lens), indent=1) + "\n")


def read_lens(path: Path) -> Lens:
    """A lens that ``write_lens`` wrote.

    Raises
    ------
    InputError
        If the file is missing, or is not such a file.
    """
    try:
        written = json.loads(path.read_text(encoding="utf-8"))
        if written["format"] != FORMAT:
            raise ValueError(f"its format is {written['format']!r}")
        arrays = {name: np.array(written[name], dtype=float) for name in ARRAYS}
        for name, shape in ARRAYS.items():
            if arrays[name].shape != shape or not np.all(np.isfinite(arrays[name])):
                raise ValueError(f"{name} is not {' x '.join(map(str, shape))} numbers")
        if not (arrays["matrix"][0, 0] > 0 and arrays["matrix"][1, 1] > 0):
            raise ValueError("its focal length is not positive")
        return Lens(width=int(written["width"]), height=int(written["height"]),
                    rms_px=float(written["rms_px"]), source=str(written["source"]), **arrays)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); "
                         "write one with 'spectrabox geometry lens'") from None
    except KeyError as error:
        reason = f"{error} is missing"
    except (ValueError, TypeError) as error:
        reason = str(error)
    raise InputError(f"{path.name} is no lens file ({reason}); write one with 'spectrabox geometry "
                     "lens'")
