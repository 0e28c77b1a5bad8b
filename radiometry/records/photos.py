"""Photos, the patches and regions in them, and the motion of one against another."""
from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated

import numpy as np

from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.shaped import Record

CLIPPED_LIMIT = 0.01        # of the samples of a patch: with more its mean is too low
MIN_PATCHES = 8         # of a chart: fewer fix no sensitivities
STILL_PX = 0.5              # less than this is no motion


class PhotoKind(Enum):
    """Where the pixels of a photo come from."""

    RAW = "camera raw, decoded without demosaicing"
    LINEAR_FILE = "image file taken as linear"
    PROCESSED = "image processed by the camera, decoded as sRGB"


@dataclass(frozen=True, eq=False)
class GainMap(Record):
    """Gains that a file states for its pixels, at points between which they are interpolated.

    Positions of the points are relative to height and width of the picture; a map applies to rows
    and columns of an area, counted from its first by ``pitch``, and to planes from ``plane`` on.
    """

    gains: Annotated[np.ndarray, "V U P"]
    area: tuple[int, int, int, int]                 # top, left, bottom, right, pixels
    pitch: tuple[int, int]                          # rows, columns
    origin: tuple[float, float]                     # y, x of the first point
    spacing: tuple[float, float]
    plane: int
    planes: int


@dataclass(frozen=True, eq=False)
class RawFrame(Record):
    """The mosaic as the sensor gave it, in sensor orientation; of full-colour pixels one colour."""

    mosaic: Annotated[np.ndarray, "H W"]            # uint16 DN, visible area
    cfa: Annotated[np.ndarray, "a b"]               # tile from pixel (0, 0): 0 R, 1 G, 2 B
    black_level: Annotated[np.ndarray, "a b"]       # DN at each position of the tile
    white_level: float                              # DN
    exposure_s: float | None
    iso: float | None
    f_number: float | None
    camera: str                                     # make, model and serial number as far as known
    file: str
    sha256: str
    camera_from_xyz: Annotated[np.ndarray, "3 3"] | None = None    # R, G, B of X, Y, Z, any scale
    matrix_of_file: bool = False                    # stated by the file, not known to LibRaw
    taken_at: str = ""                              # "2026-11-23 14:05:09", by the camera's clock
    # DN, by which black departs from its level in each row and column
    black_rows: Annotated[np.ndarray, "H"] | None = None
    black_columns: Annotated[np.ndarray, "W"] | None = None
    gain_maps: tuple[GainMap, ...] = ()             # that the file states for its signal
    linear_limit: float = 1.0                       # of the range, up to which it states linearity
    findings: tuple[Finding, ...] = ()              # what else it states, applied or not


@dataclass(frozen=True, eq=False)
class LinearImage(Record):
    """Linear camera signal; a pixel covers ``sensor_step`` x ``sensor_step`` of the photo's."""

    signal: Annotated[np.ndarray, "H W K"]          # float32
    variance: Annotated[np.ndarray, "H W K"]        # float32, signal squared
    saturated: Annotated[np.ndarray, "H W K"]       # bool: a sample in it is at the clip point
    sensor_step: float
    exposure_s: float | None                        # None where the file does not say
    iso: float | None
    f_number: float | None
    kind: PhotoKind
    camera: str
    source: str
    sha256: str
    camera_from_xyz: Annotated[np.ndarray, "3 3"] | None = None    # as in the raw frame
    matrix_of_file: bool = False
    taken_at: str = ""                              # as in the raw frame
    # what the file states of corrections, applied or not, and what its pixels say of it
    findings: tuple[Finding, ...] = ()

    @property
    def clipped_share(self) -> float:
        """Share of pixels of which any band is saturated."""
        return float(self.saturated.any(axis=2).mean())


@dataclass(frozen=True, eq=False)
class ChartDetection(Record):
    """Where the I patches lie, in full-resolution pixels; (0, 0) is the centre of the first."""

    corners_px: Annotated[np.ndarray, "I 4 2"]      # sampled quadrilaterals, chart order
    confidence: float                               # 0 to 1: agreement with the reference
    mirrored: bool
    how_found: Finding                              # "chart.found-in-photo", "chart.corners-given"


@dataclass(frozen=True, eq=False)
class PatchSamples(Record):
    """Statistics of the I patches of a chart, row by row as printed on it."""

    mean: Annotated[np.ndarray, "I K"]              # signal
    covariance_of_mean: Annotated[np.ndarray, "I K K"]
    pixels: Annotated[np.ndarray, "I"]              # samples used in each patch
    saturated_fraction: Annotated[np.ndarray, "I K"]
    gradient: Annotated[np.ndarray, "I K"]          # relative change across the patch
    camera_from_xyz: Annotated[np.ndarray, "3 3"] | None = None    # where LibRaw knows the camera
    taken_at: str = ""                              # as in the raw frame

    @property
    def clipped(self) -> np.ndarray:
        """Bands (I, K) of which the mean says nothing: too many samples are saturated."""
        return np.asarray(self.saturated_fraction > CLIPPED_LIMIT)

    @property
    def saturated(self) -> np.ndarray:
        """Whether every band of each patch (I,) is clipped, which leaves nothing to read."""
        return np.asarray(self.clipped.all(axis=1))

    @property
    def standard_error(self) -> np.ndarray:
        """Of each patch's mean (I, K), by the noise of its pixels."""
        return np.sqrt(np.diagonal(self.covariance_of_mean, axis1=1, axis2=2))

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (I, K) of single pixels about a plane fitted to each patch."""
        return np.asarray(self.standard_error * np.sqrt(self.pixels)[:, None])


class EdgeKind(Enum):
    """What an edge inside a region can be, by how the bands step across it."""

    SHADOW = "shadow or fold"               # all bands by one ratio: two greys do, too
    PAINTS = "two paints"                   # each band by its own
    ONE_BAND = "shadow, fold or two paints"     # only one band tells


@dataclass(frozen=True, eq=False)
class RegionEdge(Record):
    """A step of the signal across a line inside a region."""

    kind: EdgeKind
    # of the smaller part against the larger, relative; NaN where a band tells nothing
    step: Annotated[np.ndarray, "K"]
    line_px: Annotated[np.ndarray, "2 2"]       # ends of the line, full resolution
    # x0, y0, x1, y1: the largest rectangle on the larger side; None: too small for one
    larger_part_px: Annotated[np.ndarray, "4"] | None


@dataclass(frozen=True, eq=False)
class RegionSamples(Record):
    """Statistics of R outlined regions of one photo."""

    names: tuple[str, ...]
    mean: Annotated[np.ndarray, "R K"]              # signal
    covariance_of_mean: Annotated[np.ndarray, "R K K"]  # by the noise of the pixels
    pixels: Annotated[np.ndarray, "R"]
    scatter: Annotated[np.ndarray, "R K"]           # relative, beyond noise and a plane
    points_px: Annotated[np.ndarray, "R Q 2"]       # spread over each region, full resolution
    # bool: bands of which the mean says nothing, being saturated; None: none is
    clipped: Annotated[np.ndarray, "R K"] | None = None
    edges: dict[str, RegionEdge] = field(default_factory=dict)  # of the regions that have one


@dataclass(frozen=True, eq=False)
class Registration(Record):
    """From pixels of the first photo to those of another: ``matrix @ (x, y, 1)``."""

    matrix: Annotated[np.ndarray, "2 3"]    # a turn and a shift, full resolution
    shift_px: float                         # of the middle of the photo
    residual_px: float | None               # median over parts of the photo; None: none tells
    chart_px: float | None                  # rms of the chart's corners; None: not in both photos

    def moved(self, points_px: np.ndarray) -> np.ndarray:
        """Points (..., 2) of the first photo in the pixels of the other."""
        return points_px if self.still else np.asarray(
            points_px @ self.matrix[:, :2].T + self.matrix[:, 2])

    @property
    def still(self) -> bool:
        """Whether the photo moved by less than half a pixel."""
        return self.shift_px < STILL_PX
