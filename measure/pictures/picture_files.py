"""Files of a picture of spectra: mean, standard deviation and maps of them."""
from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from spectrabox.capture.photo.image_writers import write_png
from spectrabox.measure.pictures import (
    lit_photo,
    picture_maps,
    pixel_flags,
    pixel_spectra,
    spectra_files,
)
from spectrabox.measure.records import PictureRecords
from spectrabox.measure.shoot.options import PictureOptions
from spectrabox.sampling.prior.local_posteriors import MAX_CENTRES

PIXELS_A_POINT = 500        # a point of the table takes as long as how many pixels looked up


def write_picture(
    photo: lit_photo.LitPhoto, section: PictureOptions, folder: Path,
    progress: Callable[[float], None],
    also: Callable[[int, int, np.ndarray, np.ndarray, np.ndarray], None] = lambda *rows: None
) -> PictureRecords:
    """Write the spectra of all pixels and maps of them.

    Parameters
    ----------
    photo : LitPhoto
    section : PictureOptions
    folder : Path
    progress : function of the share that is done
    also : function of (first row, last row, flags, mean, standard deviation), optional
        Takes the spectra of some rows, from the top to the bottom.
    """
    layout = layout_of(section)
    height, width, _ = photo.size
    of_scene = photo.flags is not None and photo.band_sets is None
    maps = picture_maps.maps_of(layout.nm[0], section.light, flags=of_scene)
    reduced = picture_maps.Reduced(height, width, maps)
    points, sample, _, _ = pixel_spectra.survey(photo)
    in_pixels = PIXELS_A_POINT * int(points.sum() or MAX_CENTRES)
    table_share = in_pixels / (in_pixels + height * width)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        tables = pixel_spectra.spectra_tables(photo, layout, points, sample,
                                              lambda share: progress(table_share * share), pool.map)
    before = table_share if tables else 0.0
    counts = np.zeros(3)        # beyond white, unlike, and the sum of standard deviations
    reasons = np.zeros(pixel_flags.HIGHLIGHT + 1)

    with picture_maps.map_rows(folder, height, width, maps, reduced) as write_maps:
        def blocks() -> Iterator[tuple[int, int, tuple[np.ndarray, ...]]]:
            for first, last, (block, spectra) in spectra_files.computed_blocks(
                    height, width,
                    lambda first, last: photo.block(first, last, direct=not tables),
                    lambda block: (block, lit_photo.photo_spectra(photo, layout, tables, block))):
                mean, deviation, novelty = spectra
                write_maps(first, block.flags, spectra)
                also(first, last, block.flags, mean, deviation)
                seen = block.seen
                counts[:] += [(block.beyond_white[seen] > 1).sum(), (novelty[seen] > 1).sum(),
                              deviation.mean(axis=1)[seen].sum()]
                reasons[:] += np.bincount(block.flags, minlength=reasons.size)
                yield first, last, (mean, deviation)

        spectra_files.write_spectra(blocks(), (height, width), folder, layout,
                      lambda share: progress(before + (1 - before) * share),
                      photo.errors.responses)
    for each in maps:
        write_png(folder / f"preview-{each.file}", picture_maps.reduced_picture(reduced, each))
    total = height * width
    masked, beyond, novel = (np.array([total - reasons[pixel_flags.SEEN], *counts[:2]])
                             / total).tolist()
    return PictureRecords(
        (*spectra_files.files_of(layout.form), *(each.file for each in maps)),
        tuple(each.title for each in maps), tuple(f"preview-{each.file}" for each in maps),
        (width, height), masked, beyond, novel, reasons / total,
        float(counts[2] / max(reasons[pixel_flags.SEEN], 1)))


def layout_of(section: PictureOptions) -> pixel_spectra.PictureLayout:
    """Wavelengths and format of a picture's files."""
    return pixel_spectra.PictureLayout(section.step_nm, form=section.format)
