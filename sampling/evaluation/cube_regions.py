"""Regions of a hyperspectral picture and the spectra in them: read in blocks of rows, so that
memory stays flat.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from spectrabox.radiometry.checked_tables import ListOf, Table, checked, read_toml
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.evaluation.cubes import Cube

BLOCK_VALUES = 4_000_000        # of the picture, read at once
KEPT = 2000                     # spectra of a region that are kept, at random
Rectangle = Annotated[ListOf[int], Field(min_length=4, max_length=4)]
Pixel = Annotated[ListOf[int], Field(min_length=2, max_length=2)]


class CubeRegionTable(Table):
    """A region in a file."""

    rect: Rectangle | None = None
    point: Pixel | None = None
    mask: str | None = None
    label: int | None = None
    truth: str | None = None

    @model_validator(mode="after")
    def lies_somewhere(self) -> CubeRegionTable:
        """Refuse a region of no pixels or of two kinds."""
        if sum(each is not None for each in (self.rect, self.point, self.mask)) != 1:
            raise ValueError("a region needs one of rect = [x0, y0, x1, y1], point = [x, y] "
                             "or mask = \"file.png\"")
        return self


class CubeRegionsFile(Table):
    """A file of regions."""

    regions: dict[str, CubeRegionTable] = Field(min_length=1)


@dataclass(frozen=True)
class CubeRegion:
    """Pixels of a picture: a box (x0, y0, x1, y1), its ends not counted, and of these the ones of a
    mask, if any.
    """

    name: str
    truth: str | None           # column of the truths; the region's name where None
    box: tuple[int, int, int, int]
    mask: np.ndarray | None     # bool, of the box


@dataclass(frozen=True)
class RegionSpectra:
    """Mean and standard deviation (C,) over a region's pixels, and up to 2000 of its spectra (n,
    C).
    """

    region: CubeRegion
    pixels: int
    left_out: int               # pixels with a value that is no number
    mean: np.ndarray
    standard_deviation: np.ndarray
    spectra: np.ndarray


def read_regions(path: Path, width: int, height: int,
                 read_mask: Callable[[Path], np.ndarray]) -> list[CubeRegion]:
    """Regions of a TOML file: [regions.NAME] with ``rect = [x0, y0, x1, y1]``, ``point = [x,
    y]``, or a ``mask``.

    A mask is a picture of one band of the cube's size beside the TOML file: its pixels above 0 or,
    with ``label = 3``, those of that value. ``truth`` names the column of the truths.

    Parameters
    ----------
    read_mask : function from a path to (H, W) integers

    Raises
    ------
    InputError
    """
    advice = "write [regions.NAME] and rect = [x0, y0, x1, y1]"
    regions = checked(CubeRegionsFile, read_toml(path, advice), path.name).regions
    return [_region(name, table, path, (width, height), read_mask)
            for name, table in regions.items()]


def point_region(text: str, width: int, height: int) -> CubeRegion:
    """One pixel, written x,y or NAME=x,y.

    Raises
    ------
    InputError
    """
    name, _, pixel = text.rpartition("=")
    try:
        x, y = (int(part) for part in pixel.split(","))
    except ValueError:
        raise InputError(
            f"--point {text!r} cannot be read; write x,y or NAME=x,y in pixels") from None
    box = _checked((x, y, x + 1, y + 1), name or pixel, (width, height))
    return CubeRegion(name or pixel, name or None, box, None)


def region_spectra(cube: Cube, regions: list[CubeRegion], full_scale: float = 1.0,
                   seed: int = 0) -> list[RegionSpectra]:
    """Spectra of all regions in one pass over the rows that they cover.

    Parameters
    ----------
    full_scale : float
        Value of the picture that stands for reflectance 1.

    Raises
    ------
    InputError
        If a region holds no pixel, or none whose values are all numbers.
    """
    rng = np.random.default_rng(seed)
    sums = [_Sums(cube.nm.size, np.sort(rng.choice(_size(region), min(KEPT, _size(region)), False)))
            for region in regions]
    step = max(1, BLOCK_VALUES // (cube.width * cube.nm.size))
    first, last = min(region.box[1] for region in regions), max(region.box[3] for region in regions)
    for top in range(first, last, step):
        bottom = min(top + step, last)
        touched = [(region, total) for region, total in zip(regions, sums, strict=True)
                   if region.box[1] < bottom and region.box[3] > top]
        if touched:
            with np.errstate(all="ignore"):     # damaged values may overflow: the result says so
                block = cube.rows(top, bottom) / full_scale
                for region, total in touched:
                    total.add(_pixels(block, top, region))
    return [total.result(region, cube.file) for region, total in zip(regions, sums, strict=True)]


class _Sums:
    """Running mean and scatter of a region's pixels (Chan, Golub and LeVeque), and the spectra to
    keep.
    """

    def __init__(self, bands: int, wanted: np.ndarray) -> None:
        self.count, self.seen, self.wanted = 0, 0, wanted
        self.mean, self.scatter = np.zeros(bands), np.zeros(bands)
        self.kept: list[np.ndarray] = []

    def add(self, pixels: np.ndarray) -> None:
        here = self.wanted[(self.wanted >= self.seen) & (self.wanted < self.seen
                                                         + len(pixels))] - self.seen
        self.seen += len(pixels)
        whole = np.all(np.isfinite(pixels), axis=1)
        self.kept.append(pixels[here][whole[here]])
        good = pixels if whole.all() else pixels[whole]
        if not len(good):
            return
        mean, total = good.mean(axis=0), self.count + len(good)
        away = mean - self.mean
        self.scatter += np.sum((good - mean)**2, axis=0) + away**2 * self.count * len(good) / total
        self.mean = self.mean + away * len(good) / total
        self.count = total

    def result(self, region: CubeRegion, file: str) -> RegionSpectra:
        if not self.count:
            raise InputError(f"region {region.name!r} of {file} holds {self.seen} pixels, none of "
                             "them with numbers at every wavelength; correct the region or the "
                             "picture")
        if not np.all(np.isfinite(self.mean)) or not np.all(np.isfinite(self.scatter)):
            raise InputError(f"region {region.name!r} of {file} holds values beyond what numbers "
                             "can hold; the picture is damaged or read with the wrong data type")
        deviation = np.sqrt(self.scatter / max(self.count - 1, 1))
        return RegionSpectra(region, self.count, self.seen - self.count, self.mean, deviation,
                             np.concatenate(self.kept))


def _pixels(block: np.ndarray, top: int, region: CubeRegion) -> np.ndarray:
    x0, y0, x1, y1 = region.box
    first, last = max(y0, top), min(y1, top + len(block))
    part = block[first - top:last - top, x0:x1]
    if region.mask is None:
        return part.reshape(-1, part.shape[2])
    return part[region.mask[first - y0:last - y0]]


def _size(region: CubeRegion) -> int:
    x0, y0, x1, y1 = region.box
    return (x1 - x0) * (y1 - y0) if region.mask is None else int(region.mask.sum())


def _region(name: str, table: CubeRegionTable, path: Path, size: tuple[int, int],
            read_mask: Callable[[Path], np.ndarray]) -> CubeRegion:
    if table.mask is not None:
        return CubeRegion(name, table.truth, *_masked(name, table.mask, table.label, path, size,
                                                      read_mask))
    if table.rect is not None:
        x0, y0, x1, y1 = table.rect
    else:
        x0, y0 = table.point or (0, 0)
        x1, y1 = x0 + 1, y0 + 1
    return CubeRegion(name, table.truth, _checked((x0, y0, x1, y1), name, size), None)


def _masked(name: str, mask: str, label: int | None, path: Path, size: tuple[int, int],
            read_mask: Callable[[Path], np.ndarray]
            ) -> tuple[tuple[int, int, int, int], np.ndarray]:
    file = (path.parent / mask).resolve()
    if not file.is_relative_to(path.parent.resolve()):
        raise InputError(f"{path.name}: the mask of region {name!r} lies outside the folder of "
                         f"{path.name}; put it beside it")
    labels = read_mask(file)
    if labels.shape != size[::-1]:
        raise InputError(f"mask {file.name} has {labels.shape[1]} x {labels.shape[0]} pixels and "
                         f"the picture {size[0]} x {size[1]}; draw the mask on the picture itself")
    chosen = labels > 0 if label is None else labels == label
    if not chosen.any():
        raise InputError(f"mask {file.name} has no pixel for region {name!r}; its values are "
                         f"{', '.join(map(str, np.unique(labels)[:12]))}")
    inside = np.argwhere(chosen)
    (y0, x0), (y1, x1) = inside.min(axis=0), inside.max(axis=0) + 1
    return (int(x0), int(y0), int(x1), int(y1)), chosen[y0:y1, x0:x1]


def _checked(box: tuple[int, int, int, int], name: str, size: tuple[int, int]) -> tuple[int, int,
                                                                                        int, int]:
    x0, y0, x1, y1 = box
    if not (0 <= x0 < x1 <= size[0] and 0 <= y0 < y1 <= size[1]):
        raise InputError(f"region {name!r} runs from {x0}, {y0} to {x1}, {y1}; the picture has "
                         f"{size[0]} x {size[1]} pixels, counted from 0")
    return box
