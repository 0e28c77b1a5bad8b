"""Photos of flat samples by light as it goes: near lamps, lobes of gloss, shadows, other planes.

Nothing here is shared with the inversion: it works with a share of gloss, a level and smooth
fields, and this with square lamps that light every point from every part of themselves (inverse
square, both cosines), microfacets (Beckmann, with Schlick's Fresnel and Smith's shadowing) on a
diffuse base, on the chart's patches too, and a camera that looks down from a finite height. What a
surface is stated to reflect is what an instrument reads at 45 degrees from the normal, lobe
included; its gloss in a photo is what it mirrors beyond that.

Lengths are in widths of the picture, x to the right, y down and z towards the camera.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import gaussian_filter, zoom

from spectrabox.fixtures.flat_sample import (
    box,
    chart_corners,
    surface_signals,
    vignetting,
    write_photo,
)
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.chart import AFTER_2014, REFERENCES, chart_reflectances
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.spectrum_files import read_table

SIZE, REGIONS = (400, 600), 9
CHART, CARD = (0.28, 0.19, 0.44), (0.25, 0.165, 0.75, 0.505)    # grid of patches; the whole card
SQUARE, ABOVE, BELOW = 0.10, (0.22, 0.37, 0.52, 0.67), (0.20, 0.33, 0.46, 0.59, 0.72)
MIDDLE = np.array([0.5, 0.5 * SIZE[0] / SIZE[1], 0.0])
CAMERA = MIDDLE + np.array([0.0, 0.0, 2.5])
INSET = 0.02                # of a sample's outline
STEP = 5                    # pixels between those at which light is followed
EDGE = 0.09                 # y of the edge of a shadow that crosses the samples above the chart

F0 = 0.04                   # Fresnel reflection at normal incidence, refractive index 1.5
# root mean square slope of microfacets, and the part of the surface that has them
LOBES = {"matt": (0.55, 0.6), "satin": (0.18, 1.0), "glossy": (0.12, 1.0), "chart": (0.50, 0.5)}
INSTRUMENT = np.radians(45.0)

COPY_LEVEL, COPY_SHAPE = 0.018, 0.012   # what one chart departs from its edition by, relative
LATER_EDITION = 0.9         # share of charts in use


@dataclass(frozen=True)
class Lamp:
    """A square lamp that faces the middle of the picture."""

    azimuth: float              # radians, from x towards y
    elevation: float            # radians above the table
    distance: float
    side: float

    def points(self) -> np.ndarray:
        """Middles (N, 3) of its parts."""
        along = np.array([np.cos(self.azimuth) * np.cos(self.elevation),
                          np.sin(self.azimuth) * np.cos(self.elevation), np.sin(self.elevation)])
        across = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        up = np.cross(along, across)
        steps = (np.arange(4) + 0.5) / 4 - 0.5
        offsets = self.side * (steps[:, None, None] * across + steps[None, :, None] * up)
        return np.asarray((MIDDLE + self.distance * along + offsets).reshape(-1, 3))


@dataclass(frozen=True)
class Place:
    """How something lies: how high, and whither it is turned."""

    height: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Shoot:
    """What stands before the camera in all photos of a case."""

    curves: np.ndarray          # (K, P) of the camera
    chart: np.ndarray           # (24, P)
    surfaces: np.ndarray        # (REGIONS, P) as an instrument reads them
    kind: str                   # of the samples, of LOBES
    samples: Place
    card: Place
    ambient: float              # share of the light in the middle, from all sides
    glare: float                # share of the picture's mean that is everywhere
    corner: float               # light that the lens lets through in the corners


def outlines() -> list[np.ndarray]:
    """Outlines (4, 2) of the samples."""
    corners = [(x, 0.04) for x in ABOVE] + [(x, 0.53) for x in BELOW]
    return [box(x, y, x + SQUARE, y + SQUARE) for x, y in corners]


def rectangles() -> list[tuple[float, ...]]:
    """Corners (x0, y0, x1, y1) in pixels of the regions that are outlined on the samples."""
    return [tuple(float(round(value * SIZE[1])) for value in np.r_[place[0] + INSET,
                                                                   place[2] - INSET])
            for place in outlines()]


def photograph(path: Path, shoot: Shoot, lamps: list[tuple[Lamp, np.ndarray]],
               rng: np.random.Generator, *, shade: float = 0.0, edge: bool = False,
               through: np.ndarray | None = None) -> np.ndarray:
    """Write one photo.

    Parameters
    ----------
    path : Path
    shoot : Shoot
    lamps : list of (Lamp, (P,) array)
        With their spectra.
    rng : numpy.random.Generator
        Of the noise.
    shade : float
        Share of the light that something keeps from the samples.
    edge : bool
        It does so above the line EDGE alone, which crosses four samples.
    through : (P,) array, optional
        Transmittance of a filter before the lens.

    Returns
    -------
    (REGIONS,) array
        What the samples mirror beyond what an instrument reads, a share of white in this light.
    """
    mirrored = np.zeros(REGIONS)
    picture = np.zeros((*SIZE, len(shoot.curves)))
    total = sum(_irradiance(np.array([MIDDLE]), Place(), lamp)[0] for lamp, _ in lamps)
    matt, y, x = _bases(shoot), *_pixels()
    on_card = (x > CARD[0]) & (y > CARD[1]) & (x < CARD[2]) & (y < CARD[3])
    areas = outlines()
    on_sample = np.any([(x > area[0, 0]) & (y > area[0, 1]) & (x < area[2, 0]) & (y < area[2, 1])
                        for area in areas], axis=0)
    width = 0.0015 + 0.02 * lamps[0][0].side       # of the penumbra
    cover = 1 - shade / (1 + np.exp((y - EDGE) / width)) if edge else np.full(SIZE, 1 - shade)
    for lamp, spectrum in lamps:
        responses = shoot.curves * spectrum * (1.0 if through is None else through)
        even = surface_signals(SIZE, responses, matt[0], chart_corners(*CHART),
                               list(zip(areas, matt[1], strict=True)), np.full(NM.size, 0.2))
        light, lobe = (np.zeros(SIZE) for _ in range(2))
        for where, place, kind in ((~on_card & ~on_sample, Place(), None),
                                   (on_card, shoot.card, "chart"),
                                   (on_sample, shoot.samples, shoot.kind)):
            light[where] = _over_picture(_irradiance, place, lamp)[where] / total
            if kind is not None:
                lobe[where] = _over_picture(_mirrored, place, lamp, kind)[where] / total \
                    + shoot.ambient * F0 * LOBES[kind][1] / len(lamps)
        light = (1 - shoot.ambient) * light + shoot.ambient / len(lamps)
        lobe *= 1 - shoot.ambient
        light[on_sample] *= cover[on_sample]
        lobe[on_sample] *= cover[on_sample]
        picture += even * light[..., None] + lobe[..., None] * responses.sum(axis=1)
        for number, area in enumerate(areas):
            inside = (x > area[0, 0] + INSET) & (y > area[0, 1] + INSET) \
                & (x < area[2, 0] - INSET) & (y < area[2, 1] - INSET)
            mirrored[number] += lobe[inside].mean() / light[inside].mean() / len(lamps)
    picture *= vignetting(SIZE, shoot.corner)[..., None]
    haze = zoom(gaussian_filter(zoom(picture, (1 / STEP, 1 / STEP, 1), order=1),
                                (0.1 * SIZE[1] / STEP, 0.1 * SIZE[1] / STEP, 0)),
                (STEP, STEP, 1), order=1)
    picture += shoot.glare * (0.7 * picture.mean(axis=(0, 1)) + 0.3 * haze - picture)
    write_photo(path, picture, Fraction(1, 60), rng)
    return mirrored - by_instrument(shoot.kind)


def gloss_of(shoot: Shoot, lamp: Lamp) -> float:
    """What the samples mirror of one lamp beyond what an instrument reads: mean share of white."""
    points = np.array([[*area.mean(axis=0), shoot.samples.height] for area in outlines()])
    share = _mirrored(points, shoot.samples, lamp, shoot.kind) / _irradiance(points, shoot.samples,
                                                                             lamp)
    return float(share.mean()) - by_instrument(shoot.kind)


def with_gloss(shoot: Shoot, lamp: Lamp, wanted: float) -> Lamp:
    """The lamp raised until the samples mirror so much of it, on the mean."""
    low, high = np.radians(30.0), np.radians(84.0)
    for _ in range(25):
        middle = (low + high) / 2
        if gloss_of(shoot, replace(lamp, elevation=middle)) < wanted:
            low = middle
        else:
            high = middle
    return replace(lamp, elevation=(low + high) / 2)


def drawn_lamp(rng: np.random.Generator) -> Lamp:
    """A lamp as one puts it up: anywhere about, at 35 to 55 degrees above the table."""
    return Lamp(rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(35, 55)), rng.uniform(2.2, 4.0),
                rng.uniform(0.05, 0.4))


def moved(lamp: Lamp, rng: np.random.Generator) -> Lamp:
    """The same lamp in another place: at another side, at 30 to 50 degrees above the table."""
    turn = rng.choice([-1, 1]) * np.radians(rng.uniform(70, 180))
    return replace(drawn_lamp(rng), azimuth=lamp.azimuth + turn, side=lamp.side,
                   elevation=np.radians(rng.uniform(30, 50)))


def by_instrument(kind: str) -> float:
    """What an instrument reads of a lobe, lit at 45 degrees, seen from above."""
    roughness, part = LOBES[kind]
    lit = np.array([np.sin(INSTRUMENT), 0.0, np.cos(INSTRUMENT)])
    return float(np.pi * part * _lobe(lit, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]),
                                      roughness))


def drawn_chart(rng: np.random.Generator, copies: list[np.ndarray]) -> np.ndarray:
    """Reflectances (24, P) of a chart in somebody's hands: of an edition, leaning towards measured
    copies, and with departures of its own that are smooth in wavelength.

    Parameters
    ----------
    rng : numpy.random.Generator
    copies : list of (24, P) array
        From ``chart_copies``: the later edition, the earlier, and measured copies.
    """
    later, earlier, *measured = copies
    edition = later if rng.random() < LATER_EDITION else earlier
    shares = rng.dirichlet([2.0, *np.ones(len(measured))])
    log = np.tensordot(shares, np.log([edition, *measured]), 1)
    steps = np.linspace(-1, 1, NM.size)
    shape = sum(rng.standard_normal((24, 1)) * row for row in (steps, np.sin(2.2 * np.pi * steps),
                                                               np.cos(3.1 * np.pi * steps)))
    level = COPY_LEVEL * rng.standard_normal((24, 1))
    return np.exp(log + level + COPY_SHAPE / np.sqrt(1.5) * shape)


def chart_copies(data: Path) -> list[np.ndarray]:
    """Reflectances (24, P): the later edition, the earlier, and measured copies of a folder, these
    at the mean level of the later edition: some instruments saw theirs from nearer.
    """
    grid = grid_from_nm(NM)
    copies = [np.asarray(chart_reflectances(name, grid)) for name in (AFTER_2014, REFERENCES[0])]
    for file in (data / "flea3_chart" / "spectra_averaged.csv",
                 data / "chart_copies" / "beyondrgb_cc_classic.csv"):
        table = read_table(file)
        first = table.names.index("dark skin")
        copy = np.array([np.interp(NM, table.nm, row) for row in table.values[first:first + 24]])
        copies.append(copy * np.exp(np.mean(np.log(copies[0] / copy))))
    return copies


def _bases(shoot: Shoot) -> tuple[np.ndarray, np.ndarray]:
    """Diffuse reflectances of chart and samples: what is stated of them without the lobe."""
    return (np.maximum(shoot.chart - by_instrument("chart"), 0.002),
            np.maximum(shoot.surfaces - by_instrument(shoot.kind), 0.002))


def _pixels() -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[:SIZE[0], :SIZE[1]]
    return (y + 0.5) / SIZE[1], (x + 0.5) / SIZE[1]


def _over_picture(of: Callable[..., np.ndarray], place: Place, *others: Any) -> np.ndarray:
    """A smooth function of points of a plane at every pixel: straight between every fifth."""
    rows, columns = (np.arange(0, size + STEP, STEP) for size in SIZE)
    y, x = np.meshgrid((rows + 0.5) / SIZE[1], (columns + 0.5) / SIZE[1], indexing="ij")
    points = np.stack([x, y, np.full(x.shape, place.height)], axis=-1).reshape(-1, 3)
    coarse = of(points, place, *others).reshape(x.shape)
    return np.asarray(RegularGridInterpolator((rows, columns), coarse)(
        np.stack(np.mgrid[:SIZE[0], :SIZE[1]], axis=-1)))


def _parts(points: np.ndarray, place: Place, lamp: Lamp) -> tuple[np.ndarray, np.ndarray]:
    """Directions (M, N, 3) from points to the lamp's parts, and the irradiance (M, N) by each."""
    parts = lamp.points()
    way = parts - points[:, None]
    squared = np.sum(way**2, axis=-1)
    direction = way / np.sqrt(squared)[..., None]
    facing = (MIDDLE - parts.mean(axis=0)) / np.linalg.norm(MIDDLE - parts.mean(axis=0))
    leaving = np.maximum(-(direction @ facing), 0)
    arriving = np.maximum(direction @ np.array(place.normal), 0)
    return direction, leaving * arriving / squared / len(parts)


def _irradiance(points: np.ndarray, place: Place, lamp: Lamp) -> np.ndarray:
    """Of points (M, 3) by a lamp, (M,)."""
    return np.asarray(_parts(points, place, lamp)[1].sum(axis=1))


def _mirrored(points: np.ndarray, place: Place, lamp: Lamp, kind: str) -> np.ndarray:
    """What a lobe sends to the camera from points (M, 3), in what a perfect white sends per
    irradiance of 1.
    """
    roughness, part = LOBES[kind]
    seen = CAMERA - points
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    direction, arriving = _parts(points, place, lamp)
    lobe = _lobe(direction, seen[:, None], np.array(place.normal), roughness)
    return np.asarray(np.pi * part * np.sum(lobe * arriving, axis=1))


def _lobe(lit: np.ndarray, seen: np.ndarray, normal: np.ndarray, roughness: float) -> np.ndarray:
    """Microfacet reflectance of light from ``lit`` to ``seen``, unit vectors (..., 3)."""
    half = lit + seen
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    at_half = np.maximum(half @ normal, 1e-6)
    incident, leaving = np.maximum(lit @ normal, 1e-6), np.maximum(seen @ normal, 1e-6)
    slope = (1 / at_half**2 - 1) / roughness**2
    facets = np.exp(-slope) / (np.pi * roughness**2 * at_half**4)
    fresnel = F0 + (1 - F0) * (1 - np.sum(lit * half, axis=-1)) ** 5
    return np.asarray(fresnel * facets * _smith(incident, roughness) * _smith(leaving, roughness)
                      / (4 * incident * leaving))


def _smith(cosine: np.ndarray, roughness: float) -> np.ndarray:
    """Share of microfacets that others do not hide, by Schlick's approximation."""
    a = cosine / np.maximum(roughness * np.sqrt(1 - cosine**2), 1e-9)
    near = (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2)
    return np.where(a < 1.6, near, 1.0)
