"""What `sample` is asked of signals, and what it answers: fields are named as in ``--json``."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from spectrabox.measure import texts
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.spectra import SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.evaluation.scores_by_method import (
    ScoredSpectrum,
    SpectrumScores,
    judgement_text,
)
from spectrabox.sampling.further.more_measurements import MoreMeasurement
from spectrabox.sampling.prior.family_coverage import FamilyCoverage, coverage_facts
from spectrabox.sampling.prior.mixture import LogitMixture

NEARLY_BLACK_XYZ = 1.1      # of white where it has Y = 1: who gives such values may mean that scale
SHOWN_NM, BASELINE_NM = 25, 50      # between the wavelengths of a text
SRGB_ORIGIN = ("an sRGB colour is what a camera's processing or a designer made: these are spectra "
               "of surfaces that would look so in daylight, not of what was photographed")
NEARLY_BLACK_SRGB = ("R, G, B are taken with 255 for white, so that this colour is nearly black; "
                     "multiply them by 255 where white is 1")
NEARLY_BLACK = ("X, Y, Z are taken with Y = 100 for white, so that this colour is nearly black; "
                "multiply them by 100 where white has Y = 1")
NO_WHITE = ("no white was stated (--white, white=): the signal is taken as relative to a perfect "
            "white, which values of a raw photo are not")
NO_NOISE = ("no noise was stated (--noise, noise=): the signal is taken as exact, and the band is "
            "narrower than a photo's")
CURVES = ("mean", "standard_deviation", "lower", "upper")


def origin_of_colours(kind: str, values: np.ndarray) -> str | None:
    """What an answer has to say of colours that are given in place of signals; None of most.

    Parameters
    ----------
    kind : str
        "srgb", "lab" or "xyz".
    values : (..., 3) array
        As they were given.
    """
    if kind == "xyz":
        return NEARLY_BLACK if values.size and 0 < values.max() <= NEARLY_BLACK_XYZ else None
    if kind == "srgb":
        dark = values.size and 0 < values.max() <= 1
        return f"{NEARLY_BLACK_SRGB}\n{SRGB_ORIGIN}" if dark else SRGB_ORIGIN
    return None


def curve_caveats(error: float | None, allowed_for: float,
                  doubts: Sequence[Finding] = ()) -> tuple[str, ...]:
    """What an answer has to say of a camera that was fitted.

    Parameters
    ----------
    error : float or None
        Standard error of its curves, of their highest peak; None where it is not known.
    allowed_for : float
        Relative error of each curve that is stated to the answer.
    doubts : sequence of Finding
        Of its fit.
    """
    said = tuple(f"the camera's fit is doubtful: {texts.says(doubt)}" for doubt in doubts)
    if error and not allowed_for:
        said = (f"the camera's curves have standard errors ({100 * error:.2g} % of the highest "
                "peak, root mean square), which are not used here: the band is narrower than they "
                "make it; state an error of each curve (--sensitivity-error, sensitivity_error=), "
                "or measure by the chart of the photo itself (spectrabox flat)", *said)
    return said


def unstated(white: np.ndarray | None, noise: np.ndarray | None) -> tuple[str, ...]:
    """What was not stated of signals, and what was taken in its place, in sentences.

    Parameters
    ----------
    white, noise : (K,) arrays or None
        As of `SignalCapture`.
    """
    return (*([NO_WHITE] if white is None else []), *([NO_NOISE] if noise is None else []))


@dataclass(frozen=True, eq=False)
class SignalCapture:
    """Signals that one camera gave under one light, and what is stated of them.

    Attributes
    ----------
    relative_response : (K, 301) array
        At every nm, rows summing to 1.
    signals : (S, K) array
    names : tuple of S str
        Empty of a signal that stands alone.
    white : (K,) array, optional
        What a perfect white reads, in the signals' unit; 1 by default. Ones of colours, which are
        relative to white by what they are.
    noise : (K,) array, optional
        Standard errors in the signals' unit; none by default, which the answer says.
    light_error, sensitivity_error : float
        Relative standard errors of the light scale and of each curve.
    prior : LogitMixture, optional
        On reflectances; the one shipped by default.
    more : sequence of MoreMeasurement
        Of the same surface as each signal.
    twice : SpectralMeasurement, optional
        Light reflected twice off the surface.
    origin : str, optional
        What an answer has to say of where the signals are from.
    camera_caveats : tuple of str
        What it has to say of the camera's curves.
    """

    relative_response: np.ndarray
    signals: np.ndarray
    names: tuple[str, ...]
    white: np.ndarray | None = None
    noise: np.ndarray | None = None
    light_error: float = 0.0
    sensitivity_error: float = 0.0
    prior: LogitMixture | None = None
    more: Sequence[MoreMeasurement] = ()
    twice: SpectralMeasurement | None = None
    origin: str | None = None
    camera_caveats: tuple[str, ...] = ()

    @property
    def caveats(self) -> tuple[str, ...]:
        """Where the signals are from, what was taken of them where nothing was stated, and what is
        not known of the camera.
        """
        return (*([] if self.origin is None else [self.origin]),
                *unstated(self.white, self.noise), *self.camera_caveats)


@dataclass(frozen=True, eq=False)
class SignalEstimate:
    """The reflectance behind one signal at P wavelengths.

    Attributes
    ----------
    name : str, optional
    wavelengths_nm, mean, standard_deviation, lower, upper : (P,) arrays
        The band is central, with equal tails.
    bound_lower, bound_upper : (P,) arrays
        Exact bounds of all splines that give the signal.
    effective_samples, samples : float or None, int
        None and 0 where no draws were needed.
    outcome, conditional_on : tuple of Finding
    next_measurement_nm : float
        Where one more reading would take most off the variance.
    doubtful : list of str, optional
        Further measurements that contradict the others.
    error_budget, families : dict of float, optional
        Shares of the variance by cause, and of the families that the signal allows.
    certified, certificate : tuple of FamilyCoverage, str, optional
        What 95 % bands of those families held on unseen surfaces.
    caveat : str, optional
        Where the signal is from, and what was not stated of it: sentences, one a line.
    baselines : dict of (61,) arrays, optional
        Other authors' single spectra; None of one who finds none.
    judged : dict of SpectrumScores, optional
        This and the others' spectra by method, where the truth is known.
    seconds : float
        That it took, the mean of those estimated together.
    measurement : SpectralMeasurement
        The signal alone, with the errors of all causes.
    causes : mapping of (K, K) arrays
        Their covariances, which add up to that of the measurement.
    draws : SpectrumSamples, optional
    """

    wavelengths_nm: np.ndarray
    mean: np.ndarray
    standard_deviation: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    bound_lower: np.ndarray
    bound_upper: np.ndarray
    effective_samples: float | None
    samples: int
    level: float
    method: str
    seed: int
    outcome: tuple[Finding, ...]
    conditional_on: tuple[Finding, ...]
    next_measurement_nm: float
    bounds_from: str
    measurement: SpectralMeasurement = field(metadata={"kept": True})
    causes: Mapping[str, np.ndarray] = field(metadata={"kept": True})
    draws: SpectrumSamples | None = field(default=None, metadata={"kept": True})
    doubtful: list[str] | None = None
    error_budget: dict[str, float] | None = None
    families: dict[str, float] | None = None
    certified: tuple[FamilyCoverage, ...] | None = None
    certificate: str | None = None
    name: str | None = None
    caveat: str | None = None
    baselines: dict[str, np.ndarray | None] | None = None
    judged: dict[str, SpectrumScores] | None = None
    seconds: float = 0.0

    def facts(self) -> dict[str, object]:
        """All but draws and signal by the names of their fields; none of what does not apply."""
        values = {each.name: getattr(self, each.name) for each in fields(self)
                  if not each.metadata.get("kept")}
        for name in ("outcome", "conditional_on"):
            values[name] = texts.paragraph(values[name])
        if self.certified is not None:
            values["certified"] = coverage_facts(self.certified)
        return {name: value for name, value in values.items()
                if value is not None or name == "effective_samples"}

    def text(self) -> str:
        """Every 25 nm, and what is to be said of it, for a person."""
        lines = [f"{'nm':>5} {'mean':>7} {'sd':>7} {'band':>15} {'bounds':>15}"]
        for index, nm in enumerate(self.wavelengths_nm):
            if nm % SHOWN_NM == 0:
                lines.append(f"{nm:5.0f} {self.mean[index]:7.3f} "
                             f"{self.standard_deviation[index]:7.3f} "
                             f"{self.lower[index]:7.3f}-{self.upper[index]:.3f}  "
                             f"{self.bound_lower[index]:7.3f}-{self.bound_upper[index]:.3f}")
        if self.error_budget is not None:
            lines.append("variance from: " + ", ".join(
                f"{cause} {100 * share:.1f} %" for cause, share in self.error_budget.items()
                if share > 0))
        lines += self.doubtful or []
        lines += [said for said in (self.caveat, texts.paragraph(self.outcome), self.certificate)
                  if said is not None]
        draws = f"{self.samples} draws" if self.samples else "computed in closed form"
        lines.append(f"{draws}, {self.method}; {self.seconds:.2f} s; the next reading helps most "
                     f"at {self.next_measurement_nm:.0f} nm")
        if self.judged is not None:
            lines += ["", judgement_text([ScoredSpectrum("signal", method, scores)
                                          for method, scores in self.judged.items()])]
        elif self.baselines is not None:
            lines += ["", *self._lines_of_others(self.baselines)]
        return "\n".join(lines)

    def _lines_of_others(self, others: Mapping[str, np.ndarray | None]) -> list[str]:
        shown = np.flatnonzero(self.wavelengths_nm % BASELINE_NM == 0)
        lines = [f"{'nm':<22}" + "".join(f"{nm:7.0f}" for nm in self.wavelengths_nm[shown])]
        for name, values in {self.method: self.mean, **others}.items():
            cells = " found no spectrum" if values is None \
                else "".join(f"{value:7.3f}" for value in values[shown])
            lines.append(f"{name[:22]:<22}{cells}")
        return lines


def columns_of(estimates: Sequence[SignalEstimate]) -> dict[str, np.ndarray]:
    """Of each signal its mean, standard deviation and band (P,), as the columns of a table."""
    return {f"{one.name or ''} {curve}".strip(): getattr(one, curve)
            for one in estimates for curve in CURVES}


def draws_of(estimates: Sequence[SignalEstimate]) -> dict[str, np.ndarray]:
    """Draws (S, T, P) of signals that all have some, as the arrays of a file; (T, P) of one that
    has no name.
    """
    draws = [one.draws for one in estimates if one.draws is not None]
    if len(draws) < len(estimates):
        return {}
    arrays = {"spectra": np.array([each.spectra for each in draws]),
              "coefficients": np.array([each.coefficients for each in draws])}
    if estimates[0].name is None:
        arrays = {name: values[0] for name, values in arrays.items()}
    return arrays | {"wavelengths_nm": draws[0].grid.nm}
