"""Answer of ``spectrabox uplift``: an image in, the spectra behind its pixels as files out."""
from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo import image_rows, linear, processed_photos, stored_images
from spectrabox.measure.pictures import pixel_spectra, spectra_files, uplift
from spectrabox.measure.pictures.photo_white import photo_white, require_camera_signal
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.radiometry.system import strips
from spectrabox.sampling.prior import mixture
from spectrabox.session.commands.requests import OBSERVER, UpliftRequest
from spectrabox.session.signals.signal_options import numbers, response_of_names
from spectrabox.session.terminal.progress_display import StageProgress

WHITE_REMEDY = ("Give --white with what a perfect white reads in each band (a white card's values "
                "over its reflectance), or --white 1,1,1 where the picture is relative to white")
COLOUR_ERROR = "delta_e00"    # map of how far the spectra are from the colours of their pixels
MAX_SEARCHED_PX = 30_000_000        # a photo; a larger picture is not read at once for its chart


def stated_white(request: UpliftRequest) -> tuple[UpliftRequest, str, Finding | None]:
    """The request with its white, as it is stated or a chart in the photo tells it, from where, and
    what the chart says.

    Parameters
    ----------
    request : UpliftRequest

    Raises
    ------
    InputError
        If a camera's raw photo shows no chart, or a photo was decoded from sRGB.
    CheckError
        If a chart in the photo contradicts camera and light.
    """
    if request.encoded:
        return replace(request, white="1,1,1", sensitivity=OBSERVER, light="D65"), \
            "white of sRGB", None
    if request.white is not None:
        if request.image.is_file() and stored_images.is_image_file(request.image):
            require_camera_signal(
                stored_images.read_header(request.image).photo_kind, request.image.name)
        return request, "stated; no chart was looked for", None
    response = relative_response(*_camera_and_light(request), grid.FINE_GRID)
    chart = None
    if _is_searched(request.image):
        try:
            photo = linear.open_photo(request.image)
        except errors.InputError:
            photo = None            # too small to show a chart; what cannot be read is said below
        if photo is not None:
            uplift.require_bands(photo.signal.shape[2], response)
            chart = photo_white(photo, response, WHITE_REMEDY)
    if chart is None:
        return replace(request, white=",".join(["1"] * len(response))), \
            "taken as 1: no --white was given, and no chart was found", None
    white, finding = chart
    return replace(request, white=",".join(f"{float(value):.6g}" for value in white)), \
        "the chart in the photo", finding


def _is_searched(image: Path) -> bool:
    """Whether a chart is looked for: in a raw photo, which is held whole, and in small files."""
    if not image.is_file() or not stored_images.is_image_file(image):
        return not image.is_dir()
    (height, width, _), _ = _opened(image)
    return width * height <= MAX_SEARCHED_PX


def _opened(image: Path) -> tuple[tuple[int, int, int], strips.ReadRows]:
    try:
        return image_rows.open_rows(image)
    except processed_photos.NotLinearError as error:
        raise errors.InputError(f"{error}. --encoded takes a picture in sRGB for colours under "
                         "daylight") from None


def _camera_and_light(request: UpliftRequest) -> tuple[str, str]:
    assert request.sensitivity and request.light, "the command asks for both"
    return request.sensitivity, request.light


def uplift_layout(request: UpliftRequest) -> pixel_spectra.PictureLayout:
    """Wavelengths and format of the files."""
    return pixel_spectra.PictureLayout(request.step, request.full, request.to)


def uplift_answer(request: UpliftRequest,
                  progress: StageProgress) -> tuple[dict[str, Any], list[Finding], str]:
    """JSON object, findings and text of ``spectrabox uplift``, which writes its files.

    Parameters
    ----------
    request : UpliftRequest
    progress : function of (stage, share of it that is done, message)

    Raises
    ------
    InputError
    """
    source, layout = image_source(request), uplift_layout(request)
    height, width, _ = source.size

    points, sample, outside, above = pixel_spectra.survey(
        source, lambda share: progress("signals", share, ""))
    pixel_spectra.require_below_white(above, height * width, WHITE_REMEDY)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        tables = pixel_spectra.spectra_tables(source, layout, points, sample,
                                              lambda share: progress("table", share, ""), pool.map)
    off: list[int] = []         # pixels of each block without their own colour
    of_colours = uplift.of_colours(source, layout, tables, encoded=request.encoded)

    def spectra_of(block: pixel_spectra.PixelBlock) -> tuple[np.ndarray, ...]:
        mean, deviation, apart = of_colours(block)
        off.append(int(np.sum(apart > uplift.MAX_COLOUR_ERROR)))
        return mean, deviation, apart

    blocks = spectra_files.computed_blocks(height, width, source.block, spectra_of)
    paths = spectra_files.write_spectra(blocks, (height, width), request.out, layout,
                          lambda share: progress("spectra", share, ""), source.responses,
                          (COLOUR_ERROR,))
    table = uplift.table_error(source, layout, tables, sample, encoded=request.encoded)
    return uplift_summary(request, paths, height * width, outside, table,
                          uplift.colours_off(sum(off), height * width) if request.encoded else None)


def image_source(request: UpliftRequest) -> uplift.ImageSource:
    """The image of a request, open, and all that its pixels' spectra depend on.

    Raises
    ------
    InputError
    """
    span = round(mixture.PRIOR_GRID.nm[-1] - mixture.PRIOR_GRID.nm[0])
    if request.step < 1 or request.step % pixel_spectra.GRID_STEP_NM or span % request.step:
        raise errors.InputError(f"--step {request.step} does not divide 400-700 nm into steps of "
                         f"{pixel_spectra.GRID_STEP_NM} nm; take 5, 10, 15, 20, 25, 30, 50 or 60")
    uplift.require_side(request.side)
    response = response_of_names(*_camera_and_light(request))
    size, read = image_rows.open_encoded(request.image) if request.encoded \
        else _opened(request.image)
    uplift.require_bands(size[2], response)
    white = np.ones(size[2]) if request.white is None else numbers(request.white, size[2], "white")
    return uplift.ImageSource(size, read, white.astype(np.float32), response,
                              mixture.of_families(mixture.load_prior(), request.family),
                              request.noise, request.side)


def uplift_summary(request: UpliftRequest, paths: dict[str, Path], pixels: int, outside: int,
                   table: Finding | None, colours: Finding | None
                   ) -> tuple[dict[str, Any], list[Finding], str]:
    """JSON object, findings and text of an image whose spectra are written.

    Parameters
    ----------
    request : UpliftRequest
    paths : dict
        Names to files.
    pixels : int
        Of the image.
    outside : int
        Pixels with a band outside 0 to 1.
    table : Finding or None
        Of the table, where there was one.
    colours : Finding or None
        Of the colours of a picture in sRGB.
    """
    layout = uplift_layout(request)
    mean_nm, deviation_nm = layout.nm
    facts = {**{name: str(path) for name, path in paths.items()},
             "pixels": pixels, "outside_0_to_1": outside / pixels,
             "wavelengths_nm": mean_nm.tolist(), "standard_deviation_nm": deviation_nm.tolist(),
             "pixel_type": layout.pixel_type,
             "table_delta_e00": None if table is None else
             {key: table.values[key] for key in ("median", "largest", "beyond")},
             "colours_off": None if colours is None else colours.values["pixels"] / pixels}
    return facts, [one for one in (table, colours) if one is not None], (
        f"wrote {' and '.join(str(path) for path in paths.values())}; "
        f"{100 * outside / pixels:.1f} % of pixels lie outside what a reflectance between 0 and 1 "
        "can give and were taken at the edge")
