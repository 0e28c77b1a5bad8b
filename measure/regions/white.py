"""One photo's regions relative to white, with the errors of white and of the light upon them.

    photo(k) = exposure x level(k) x exp(field at the region) x relative signal(k) + glare(k)

Level, field and glare come from the chart fit, the field away from the chart from
``calibrate.light_field``; the exposure is 1 in the chart's own photo. All that is unknown of them
is one Gaussian. Regions of known spectrum, white cards, condition it.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.calibrate import chart_equations, light_field
from spectrabox.measure.captured import FIRST_PHOTO
from spectrabox.radiometry import chart, error_model, grid, interreflection, light_scale
from spectrabox.radiometry.covariance import common_variance, symmetric
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.calibration import Calibration, ChartWhite
from spectrabox.radiometry.records.photos import LinearImage, RegionSamples

OTHER_COLOUR, SIGMAS = 0.04, 4.0    # relative and in standard errors: the light is another
LEVEL_DOUBTED, LEVEL_REFUSED = 3.0, 5.0     # standard errors between a known level and the light's
MAP_COLUMNS = 24            # of the map of the light over a photo


@dataclass(frozen=True, eq=False)
class FlatPhoto:
    """One photo of flat samples, with the chart photo that shows its light."""

    name: str
    samples: RegionSamples | None   # None where it shows no region
    image: LinearImage              # of the photo at any size: its exposure, mean signal and shape
    chart_image: LinearImage        # of the chart photo, likewise
    chart_in_photo: bool            # both are one photo
    patches_px: np.ndarray          # (I, 4, 2) corners of the patches in the chart photo
    layout: chart.Chart
    white: ChartWhite               # in the chart photo
    calibration: Calibration        # of the camera under this light
    lamp: str | None = None         # the same for photos under one lamp that stayed; None: its own
    moved: bool = False             # the lamp of an earlier photo stands elsewhere in this one
    # (K,) bool: bands in which too little of the chart can be read; None: there is none
    lost: np.ndarray | None = None

    @property
    def lost_bands(self) -> np.ndarray:
        """The same (K,), all False where there is none."""
        return np.zeros(len(self.white.level), bool) if self.lost is None else self.lost

    @property
    def response(self) -> np.ndarray:
        """Response (K, P) of the bands to reflectances; rows sum to 1."""
        return interreflection.relative_response(self.calibration, grid.FINE_GRID)


@dataclass(frozen=True)
class FlatErrors:
    """What no photo of flat samples tells of its errors."""

    repeatability: float            # relative standard error of light and shutter between photos
    glare: float                    # standard error, of the mean signal of a photo
    # of the model and a surface, as the chart's patches show it
    disagreement: chart_equations.PatchError
    flat_field: bool = False        # the photos were divided by that of a white card
    # relative standard error of the light in the samples' plane
    plane: float = error_model.PLANE_ERROR
    # region -> what is stated of its surface, of gloss.KINDS
    surfaces: Mapping[str, str] = dataclasses.field(default_factory=dict)
    # known region -> relative standard error of its stated reflectance
    known: Mapping[str, float] = dataclasses.field(default_factory=dict)
    seed: int = 0                   # of the arrangements of lamps
    # light that the chart's patches mirror, as a share of white, which the fit takes for glare
    chart_gloss: float = 0.0


@dataclass(frozen=True, eq=False)
class PhotoWhite:
    """What white reads at R regions of a photo: values, and one Gaussian of all that is unknown.

    The unknowns, Z = 2 K + R + causes: log level, glare (both K), field (R), and the errors of the
    exposure by cause, which all regions and bands share.
    """

    samples: RegionSamples
    level: np.ndarray                   # (K,) signal of white by the chart, where ``field`` is 0
    field: np.ndarray                   # (R,) log of the light, relative to the chart's mean
    exposure: float                     # of this photo relative to the chart's
    glare: np.ndarray                   # (K,) signal in this photo
    causes: tuple[str, ...]
    mean: np.ndarray                    # (Z,) corrections to the above
    covariance: np.ndarray              # (Z, Z)
    # of each known region that tells of the light: how far its level is from the light's, in
    # standard errors of both
    level_misfits: Mapping[str, float] = dataclasses.field(default_factory=dict)
    left_out: tuple[Finding, ...] = ()  # of each known region of which nothing is concluded: why

    @property
    def level_part(self) -> slice:
        """Of the unknowns: the log level (K,)."""
        return slice(0, self.glare.size)

    @property
    def glare_part(self) -> slice:
        """Of the unknowns: the glare (K,)."""
        return slice(self.glare.size, 2 * self.glare.size)

    @property
    def field_part(self) -> slice:
        """Of the unknowns: the log field (R,)."""
        return slice(2 * self.glare.size, 2 * self.glare.size + len(self.samples.names))

    @property
    def exposure_part(self) -> slice:
        """Of the unknowns: the errors of the exposure, by cause."""
        return slice(self.field_part.stop, self.mean.size)

    def of_regions(self, samples: RegionSamples) -> PhotoWhite:
        """The same of some of its regions, by name; what they read may be another.

        Parameters
        ----------
        samples : RegionSamples
        """
        rows = [self.samples.names.index(name) for name in samples.names]
        light = self.field_part.start
        kept = np.r_[:light, [light + row for row in rows], self.field_part.stop:self.mean.size]
        return dataclasses.replace(
            self, samples=samples, field=self.field[rows], mean=self.mean[kept],
            covariance=self.covariance[np.ix_(kept, kept)], level_misfits={}, left_out=())

    def clipped(self, region: int) -> np.ndarray:
        """Bands (K,) whose mean says nothing of a region."""
        clipped = self.samples.clipped
        return np.zeros(self.glare.size, bool) if clipped is None else clipped[region]

    @property
    def white(self) -> np.ndarray:
        """Signal (R, K) of a perfect white at each region."""
        log = self.mean[self.level_part] + (self.log_field
                                            + self.mean[self.exposure_part].sum())[:, None]
        return np.asarray(self.exposure * self.level * np.exp(log))

    @property
    def log_field(self) -> np.ndarray:
        """Logarithm (R,) of the light on each region, relative to the chart's mean."""
        return np.asarray(self.field + self.mean[self.field_part])

    @property
    def field_error(self) -> np.ndarray:
        """Relative standard error (R,) of the light on each region, its plane's among it."""
        plane = self.exposure_part.start + self.causes.index(error_model.SAMPLE_PLANE)
        rows = np.eye(self.mean.size)[self.field_part]
        rows[:, plane] = 1
        return np.asarray(np.sqrt(np.einsum("rz,zy,ry->r", rows, self.covariance, rows)))

    @property
    def signal(self) -> np.ndarray:
        """Signal (R, K) relative to white."""
        glare = self.glare + self.mean[self.glare_part]
        return np.asarray((self.samples.mean - glare) / self.white)

    def jacobian(self, region: int, signal: np.ndarray | None = None) -> np.ndarray:
        """Derivative (K, Z) of a region's relative signal by the unknowns, where the signal is the
        measured one or ``signal`` (K,).
        """
        signal = self.signal[region] if signal is None else signal
        rows = np.zeros((self.glare.size, self.mean.size))
        rows[:, self.level_part] = np.diag(-signal)
        rows[:, self.glare_part] = np.diag(-1 / self.white[region])
        rows[:, self.field_part.start + region] = -signal
        rows[:, self.exposure_part] = -signal[:, None]
        return rows

    def white_and_glare(self, region: int) -> np.ndarray:
        """Covariance (2 K, 2 K) of the logarithm of white at a region, and of the glare."""
        on, covariance = self._under(region)
        rows = np.eye(2 * self.glare.size, on.size)
        rows[self.level_part, self.field_part.start:] = 1
        return np.asarray(rows @ covariance @ rows.T)

    def _under(self, region: int) -> tuple[np.ndarray, np.ndarray]:
        """Which unknowns (Y,) the white of one region rests on, and their covariance (Y, Y): all
        but the light on other regions, of which a picture has thousands.
        """
        light = self.field_part
        on = np.r_[:light.start, light.start + region, light.stop:self.mean.size]
        return on, self.covariance[np.ix_(on, on)]

    def noise(self, region: int) -> np.ndarray:
        """Covariance (K, K) of a region's relative signal by the noise of its pixels."""
        return self.samples.covariance_of_mean[region] / np.outer(self.white[region],
                                                                  self.white[region])

    def errors(self, region: int, signal: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Covariance (K, K) of a region's relative signal by cause, where the signal is the
        measured one or ``signal`` (K,); they add up to the whole.
        """
        on, covariance = self._under(region)
        rows = self.jacobian(region, signal)[:, on]
        signal = self.signal[region] if signal is None else signal
        # level and glare, the light on the region, and one by one the errors of the exposure
        ends = range(self.glare_part.stop, on.size + 1)
        totals = [rows[:, :end] @ covariance[:end, :end] @ rows[:, :end].T for end in ends]
        common = [common_variance(total, signal) for total in totals]
        steps = np.maximum(np.diff(common), 0.0)
        steps *= min(1.0, common[-1] / max(float(steps.sum()), np.finfo(float).tiny))
        both = np.outer(signal, signal)
        parts = dict(
            zip((error_model.LIGHT_FIELD, *self.causes), steps[:, None, None] * both, strict=True))
        return {
            error_model.WHITE: symmetric(totals[-1] - np.sum(list(parts.values()), axis=0)), **parts
        }


def white_at_regions(photo: FlatPhoto, known: Mapping[str, np.ndarray], errors: FlatErrors,
                     nodes_px: np.ndarray | None = None) -> PhotoWhite | None:
    """White at every region of a photo, as its chart and its regions of known spectrum tell; None
    where the photo shows no region.

    Parameters
    ----------
    photo : FlatPhoto
    known : mapping
        From the names of regions, of any photo, to their reflectances (P,) on the grid.
    errors : FlatErrors
    nodes_px : (N, 2) array, optional
        Further points of the photo, which stand after the regions, without a signal of their own.

    Raises
    ------
    InputError
        If the photos do not state how their exposures compare.
    """
    white = white_by_chart(photo, errors, nodes_px)
    return None if white is None else white_told_by(photo, white, known, errors)


def agreeing_known(photos: Sequence[FlatPhoto], known: Mapping[str, np.ndarray],
                   errors: FlatErrors) -> tuple[dict[str, np.ndarray], list[Finding]]:
    """The regions of known spectrum that a photo shows unclipped and that contradict the light of
    none, and why each other one is left out: what is stated of a card is wrong in all photos or in
    none.

    Parameters and Raises as of ``white_at_regions``.
    """
    agreeing, left_out = {}, []
    for name, spectrum in known.items():
        if _is_clipped(name, photos):
            left_out.append(Finding("flat.known-clipped", Severity.WARN, name))
        else:
            agreeing[name] = spectrum
    for photo in photos:
        white = white_at_regions(photo, agreeing, errors)
        for finding in () if white is None else white.left_out:
            del agreeing[finding.subject]
            left_out.append(finding)
    return agreeing, left_out


def _is_clipped(name: str, photos: Sequence[FlatPhoto]) -> bool:
    """Whether a region, or the chart, is saturated in every band of every photo that shows it."""
    bands = []
    for photo in photos:
        samples = photo.samples
        if samples is not None and name in samples.names:
            clipped = False if samples.clipped is None else \
                samples.clipped[samples.names.index(name)]
            bands.append(photo.lost_bands | clipped)
    return bool(bands) and bool(np.all(bands))


def white_told_by(photo: FlatPhoto, white: PhotoWhite, known: Mapping[str, np.ndarray],
                  errors: FlatErrors) -> PhotoWhite:
    """The same after the photo's regions of known spectrum told of the light.

    Parameters and Raises as of ``white_at_regions``.
    """
    on_chart = _on_chart(photo, white.samples)
    signals = {name: photo.response @ spectrum for name, spectrum in known.items()
               if name in white.samples.names and name not in on_chart}
    model = errors.disagreement.among_bands(white.glare.size)
    told = condition_on_known(white, signals, {
        name: error_model.proportional_covariance(signal, model + errors.known[name]**2)
        for name, signal in signals.items()}, "" if photo.name == FIRST_PHOTO else photo.name)
    return dataclasses.replace(told, left_out=(*told.left_out, *(
        Finding("flat.known-on-chart", Severity.WARN, name) for name in known if name in on_chart)))


def _on_chart(photo: FlatPhoto, samples: RegionSamples) -> list[str]:
    """Regions that lie on a patch of the chart: the calibration is made of it, and it says nothing
    of the light on the samples.
    """
    if not photo.chart_in_photo:
        return []
    corners = photo.patches_px
    edges = np.roll(corners, -1, axis=1) - corners
    names = []
    for name, points in zip(samples.names, samples.points_px, strict=True):
        off = points[:, None, None] - corners
        sides = edges[..., 0] * off[..., 1] - edges[..., 1] * off[..., 0]
        if np.any(np.all(sides >= 0, axis=2) | np.all(sides <= 0, axis=2)):
            names.append(name)
    return names


def white_by_chart(photo: FlatPhoto, errors: FlatErrors,
                   nodes_px: np.ndarray | None = None) -> PhotoWhite | None:
    """The same as the chart alone tells it.

    Parameters, Returns and Raises as of ``white_at_regions``.
    """
    samples = photo.samples
    if samples is None:
        return None
    if photo.lost is not None:
        samples = dataclasses.replace(samples, clipped=photo.lost | (
            np.zeros(samples.mean.shape, bool) if samples.clipped is None else samples.clipped))
    points = list(samples.points_px)
    if nodes_px is not None:
        points += list(nodes_px[:, None])
        samples = _with_nodes(samples, nodes_px)
    level, glare, field, of_light = _light_at(photo, errors, points)
    exposure, causes = (1.0, {}) if photo.chart_in_photo else _exposure(photo, errors)
    causes = causes | {error_model.SAMPLE_PLANE: errors.plane}
    # veiling glare is in proportion to the light of the whole picture
    if not photo.chart_in_photo:
        glare = glare * (photo.image.signal.mean(axis=(0, 1))
                         / photo.chart_image.signal.mean(axis=(0, 1)))
    size = len(of_light)
    covariance = np.zeros((size + len(causes),) * 2)
    covariance[:size, :size] = of_light
    covariance[range(size, size + len(causes)), range(size, size + len(causes))] = np.square(
        list(causes.values()))
    return PhotoWhite(samples, level, field, exposure, glare, tuple(causes),
                      np.zeros(len(covariance)), covariance)


def _with_nodes(samples: RegionSamples, nodes_px: np.ndarray) -> RegionSamples:
    """The regions, and after them points without a signal."""
    count = len(nodes_px)
    bands = samples.mean.shape[1]
    empty = np.zeros((count, bands))
    points = np.broadcast_to(nodes_px[:, None], (count, *samples.points_px.shape[1:]))
    return RegionSamples(
        (*samples.names, *(f"\n{number}" for number in range(count))),
        np.vstack([samples.mean, empty]),
        np.concatenate([samples.covariance_of_mean, np.zeros((count, bands, bands))]),
        np.r_[samples.pixels, np.ones(count, samples.pixels.dtype)],
        np.vstack([samples.scatter, empty]), np.concatenate([samples.points_px, points]),
        None if samples.clipped is None else np.vstack([samples.clipped, empty.astype(bool)]),
        samples.edges)


def light_map(photo: FlatPhoto, known: Mapping[str, np.ndarray],
              errors: FlatErrors) -> np.ndarray:
    """Light over a photo that shows regions, relative to the chart's mean, and its relative error,
    (2, h, w), as chart and known regions show it.

    Parameters and Raises as of ``white_at_regions``.
    """
    height, width = photo.image.signal.shape[:2]
    rows = max(round(MAP_COLUMNS * height / width), 2)
    at = [(np.arange(count) + 0.5) / count * size * photo.image.sensor_step - 0.5
          for count, size in ((MAP_COLUMNS, width), (rows, height))]
    points = np.stack(np.meshgrid(*at), axis=-1).reshape(-1, 2)
    white = white_at_regions(photo, known, errors, points)
    assert white is not None and photo.samples is not None, "the photo shows regions"
    nodes = slice(len(photo.samples.names), None)
    return np.array([np.exp(white.log_field), white.field_error])[:, nodes].reshape(
        2, rows, MAP_COLUMNS)


def condition_on_known(white: PhotoWhite, known: Mapping[str, np.ndarray],
                       errors: Mapping[str, np.ndarray], photo: str = "") -> PhotoWhite:
    """The same after regions of known spectrum said how bright the light is upon them, in the bands
    that are not clipped there.

    Nothing is concluded from a region where the light is of another colour than on the chart, or
    whose level is far beyond the errors from what the chart's light gives: it is left out.

    Parameters
    ----------
    white : PhotoWhite
    known : mapping
        From names of regions to their relative signal (K,).
    errors : mapping
        From the same names to its covariance (K, K) beside noise: statement, curves, model.
    photo : str
        Its title, for what is said of regions that are left out; empty of the first.
    """
    misfits, left_out = {}, []
    for name in known:
        region = white.samples.names.index(name)
        read = np.flatnonzero(~white.clipped(region))
        if not read.size:       # another photo shows it
            continue
        within = np.ix_(read, read)
        rows = white.jacobian(region)[read]
        target = known[name][read]
        signal = white.signal[region][read]
        error = (white.noise(region) + errors[name])[within]
        # an error of the level is one of the target's: in proportion to the reading, a difference
        # of colour would take itself for one of level
        expected = white.jacobian(region, known[name])[read]
        misfit = _level_misfit(signal / target, expected / target[:, None], white.covariance,
                               error / np.outer(target, target))
        off, band = _colour_misfit(signal / target, (expected @ white.covariance @ expected.T
                                                     + error) / np.outer(target, target))
        values = {"photo": photo, "stated": float(target.mean()), "read": float(signal.mean())}
        if off:
            left_out.append(Finding("flat.known-other-colour", Severity.WARN, name, values | {
                "off": off, "band": int(read[band]) + 1}))
            continue
        if abs(misfit) > LEVEL_REFUSED:
            left_out.append(Finding("flat.known-other-level", Severity.WARN, name, values | {
                "errors": abs(misfit)}))
            continue
        misfits[name] = misfit
        residual = target - signal
        spread = rows @ white.covariance @ rows.T + error
        gain = np.linalg.solve(spread, rows @ white.covariance).T
        white = dataclasses.replace(
            white, mean=white.mean + gain @ residual,
            covariance=symmetric(white.covariance - gain @ rows @ white.covariance))
    return dataclasses.replace(white, level_misfits=misfits, left_out=tuple(left_out))


def _level_misfit(ratio: np.ndarray, rows: np.ndarray, of_light: np.ndarray,
                  own: np.ndarray) -> float:
    """How far the level of a known region is from what the light gives, in standard errors.

    The errors are those that the signal has if the statement is right: of the light's covariance
    ``of_light`` (Z, Z) by ``rows`` (K, Z), and its ``own`` (K, K), all relative to the statement.
    Those of the light are relative and multiply; those of glare and noise add: a level that is too
    high is compared in the logarithm and one that is too low is not, so that large errors are never
    overstated.
    """
    covariance = rows @ of_light @ rows.T + own
    weights = np.linalg.solve(covariance, np.ones(len(ratio)))
    level = float(weights @ ratio / weights.sum())
    return (float(np.log(level)) if level > 1 else level - 1) * float(np.sqrt(weights.sum()))


def _light_at(photo: FlatPhoto, errors: FlatErrors,
              points_px: list[np.ndarray]
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The light at places of a photo, each the mean over its points (Q, 2) in pixels, as of
    ``light_at_regions``.
    """
    centres_px = photo.patches_px.mean(axis=1)
    to_plane = chart.plane_from_picture(centres_px, photo.layout)
    plane = [chart.plane_centres(photo.layout),
             *(chart.projected(to_plane, points) for points in points_px)]
    picture = [_in_picture(centres_px, photo.chart_image),
               *(_in_picture(points, photo.image) for points in points_px)]
    return light_field.light_at_regions(photo.white, plane, picture, errors.flat_field,
                                        errors.seed)


def _exposure(photo: FlatPhoto, errors: FlatErrors) -> tuple[float, dict[str, float]]:
    """Exposure and light of a photo relative to the chart's, and its relative errors by cause."""
    before, after = photo.chart_image, photo.image
    if before.exposure_s is None or after.exposure_s is None:
        raise InputError(f"{before.source} and {after.source} do not both state how long they "
                         "were exposed, so the samples cannot be compared with the chart; show "
                         "both in one photo, or give files that state it")
    ratio = light_scale.exposure_ratio(before, after)
    return ratio, {error_model.REPEATABILITY: errors.repeatability,
                   error_model.ROUNDED_EXPOSURES: light_scale.rounding_error(before, after)}


def _colour_misfit(ratio: np.ndarray, covariance: np.ndarray) -> tuple[float, int]:
    """How far the worst band of a known region is off the colour of the chart's light, relative to
    its level, and which it is; 0 where it is within the errors.

    ``ratio`` (K,) is what is read to what is stated. What all bands share is their level, between
    them: with errors that are common to nearly the last digit, weights below 0 would put it far
    outside. Of a light that is brighter than the chart's says, bands differ in proportion to it.
    """
    weights = np.maximum(np.linalg.solve(covariance, np.ones(len(ratio))), 0)
    weights /= weights.sum()
    level = float(weights @ ratio)
    off = (ratio - level) / max(level, 1.0)
    from_level = np.eye(len(ratio)) - weights
    errors = np.sqrt(np.diag(from_level @ covariance @ from_level.T))
    worst = int(np.argmax(np.abs(off)))
    beyond = abs(off[worst]) > OTHER_COLOUR and abs(off[worst]) > SIGMAS * errors[worst]
    return (float(off[worst]) if beyond else 0.0), worst


def _in_picture(points_px: np.ndarray, photo: LinearImage) -> np.ndarray:
    """Points (N, 2) from the middle of a photo, half of its diagonal being 1."""
    size = np.array(photo.signal.shape[1::-1]) * photo.sensor_step
    return np.asarray((points_px - (size - 1) / 2) / (np.linalg.norm(size) / 2))
