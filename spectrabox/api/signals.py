"""Spectra behind camera signals, and what could have given a signal."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api import arguments
from spectrabox.api.estimates import SpectrumEstimates
from spectrabox.measure.advice.advise import advice_on_estimate
from spectrabox.measure.estimate import Estimate
from spectrabox.measure.signals import matching, signal_capture
from spectrabox.measure.signals.options import SampleOptions
from spectrabox.measure.signals.sample import sample_signals
from spectrabox.radiometry import appearance, findings
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.given_spectra import KnownSpectrum, as_reflectance
from spectrabox.radiometry.system.threads import one_blas_thread
from spectrabox.sampling.evaluation.identification import VARIATION, read_spectral_libraries
from spectrabox.sampling.prior.mixture import LogitMixture

OBSERVER = "CIE 1931 2 Degree Standard Observer"


@one_blas_thread()
def sample(signals: ArrayLike | None = None, *, camera: arguments.CameraLike | None = None,
           light: arguments.LightLike | None = None, lab: ArrayLike | None = None,
           xyz: ArrayLike | None = None, srgb: ArrayLike | str | None = None,
           noise: ArrayLike | None = None,
           white: ArrayLike | None = None, light_error: float = 0.0,
           sensitivity_error: float = 0.0, families: str | Sequence[str] | None = None,
           method: str = SampleOptions.method, draws: int = SampleOptions.samples,
           seed: int = SampleOptions.seed, coefficients: int = SampleOptions.coefficients,
           level: float = SampleOptions.level, prior: str | Path | LogitMixture | None = None,
           names: Sequence[str] | None = None) -> Estimate | SpectrumEstimates:
    """Every reflectance behind one signal, or behind each of many.

    Parameters
    ----------
    signals : (K,) or (S, K) array
        Relative to what a perfect white reads; in the unit of ``white`` where that is given.
    camera : name, path, CameraEstimate, Calibration or (nm, curves)
        A measured camera or observer by name, or its sensitivities.
    light : name, path, (nm, values) or Spectrum
        That it was seen under; a CIE name, and D65 by default, of ``lab`` and ``xyz``.
    lab : (3,) or (S, 3) array, optional
        In place of signals and camera: L*a*b* of the CIE 1931 observer.
    xyz : (3,) or (S, 3) array, optional
        The same by X, Y, Z, with Y = 100 for white.
    srgb : (3,) or (S, 3) array or "#rrggbb", optional
        The same by sRGB code values under D65, integers from 0 to 255 or numbers from 0 to 1:
        surfaces that would look so in daylight. Integers are known to half a step.
    noise : float or (K,) array, optional
        Standard error of the signal in each band, in its unit; of a colour relative to white.
        Without it the signal is taken as exact, and the answer says so (``caveats``).
    white : (K,) array, optional
        What a perfect white reads in each band; 1 by default, and the answer says so.
    light_error, sensitivity_error : float
        Relative standard errors of the light's strength and of each curve.
    families : str or sequence of str, optional
        Kind of surface, if you know it: paint, textile, leaves, skin, white, earth or animal.
    method : {"prior", "uniform", "paper"}
        The learnt prior; all splines alike; or the sampler of Xia et al. 2025, Sec. 3.2.
    draws, seed, coefficients : int
        T draws of a single signal, their seed, and N of the spline class of the exact bounds.
    level : float
        Of the band, 0 to 1.
    prior : path or LogitMixture, optional
        On reflectances; the shipped one by default.
    names : sequence of S str, optional
        Of the surfaces; "signal 1", "signal 2" ... by default.

    Returns
    -------
    SpectrumEstimate or SpectrumEstimates
        One for a signal (K,), as ``spectrabox sample --signal`` draws it; else one for each row,
        as ``--signals`` computes them without draws.

    Raises
    ------
    InputError
        If signal, noise and camera are not of the same bands, or a name is not known.
    CalibrationError
        If two bands respond alike.
    ConvergenceError
        If there are too few draws for the band.

    References
    ----------
    Xia et al. 2025: signal and splines Eqs. 2 to 5, mean and deviation Eq. 7, their sampler
    Sec. 3.2. The learnt prior and exact draws: docs/explanation/sampling.md.

    Examples
    --------
    >>> spectra = sb.sample([[0.53, 0.24, 0.08]], camera="Nikon 5100 (NPL)", light="D65",
    ...                     noise=0.003)
    >>> leaf = sb.sample(lab=[45, -27, 30])
    >>> orange = sb.sample(srgb="#e08030")
    """
    origin: tuple[findings.Finding, ...] = ()
    if lab is not None or xyz is not None or srgb is not None:
        if signals is not None or camera is not None:
            raise InputError("a colour is what the CIE observer sees; leave signals and camera out")
        if white is not None:
            raise InputError("a colour is relative to white by what it is; leave white out")
        if sum(one is not None for one in (lab, xyz, srgb)) > 1:
            raise InputError("give one of lab=, xyz= and srgb=")
        camera, white = OBSERVER, np.ones(3)
        if srgb is not None:
            if light not in (None, "D65"):
                raise InputError("srgb= is a colour under D65; leave light out")
            light = "D65"
            values, rounded = arguments.as_code_values(srgb, "srgb")
            signals = appearance.signal_of_srgb(values)
            origin = signal_capture.of_colours("srgb", 255 * values)
            if rounded and noise is None:
                noise = appearance.rounding_of_srgb(values).reshape(-1, 3).max(axis=0)
        else:
            light = "D65" if light is None else light
            if not isinstance(light, str):
                raise InputError("the light of a colour is given by its CIE name, such as 'D65' "
                                 "or 'A'")
            if lab is not None:
                signals = appearance.signal_of_colour(light, lab=arguments.as_numbers(lab, "lab"))
            else:
                assert xyz is not None
                stated = arguments.as_numbers(xyz, "xyz")
                signals = appearance.signal_of_colour(light, xyz=stated)
                origin = signal_capture.of_colours("xyz", stated)
    if signals is None or camera is None or light is None:
        raise InputError("signals need the camera that saw them and their light (camera=, light=); "
                         "a colour is given as lab=, xyz= or srgb=")
    response = arguments.relative_response(camera, light)
    given = arguments.as_numbers(signals, "signals")
    bands = len(response)
    rows = np.atleast_2d(given)
    if given.ndim not in (1, 2) or rows.shape[1] != bands:
        raise InputError(f"signals of shape {given.shape} were given and the camera has {bands} "
                         f"bands; give ({bands},) or (number, {bands})")
    if not rows.size:
        raise InputError("no signal is given: signals has no row")
    errors = None if noise is None else arguments.as_numbers(noise, "noise")
    if errors is not None and errors.shape not in ((), (bands,)):
        raise InputError(f"noise of shape {errors.shape} was given for {bands} bands; give one "
                         f"standard error, or one a band ({bands},)")
    whites = None if white is None else arguments.as_numbers(white, "white")
    if whites is not None and whites.shape != (bands,):
        raise InputError(f"white of shape {whites.shape} was given for {bands} bands; give what a "
                         f"perfect white reads in each ({bands},)")
    labels = [f"signal {number}" for number in range(1, len(rows) + 1)] if names is None \
        else list(names)
    if len(labels) != len(rows) or len(set(labels)) != len(labels):
        raise InputError(f"{len(labels)} names were given for {len(rows)} signals; give one name "
                         "of its own for each")
    learnt, (fit_error, doubts) = arguments.as_prior(
        prior, arguments.families_of(families)), arguments.curve_error(camera)
    capture = signal_capture.SignalCapture(
        response, rows, tuple(labels), whites,
        None if errors is None else np.broadcast_to(errors, bands).copy(),
        arguments.as_number(light_error, "light_error"), arguments.as_number(sensitivity_error,
                                                         "sensitivity_error"), learnt,
        given=(*origin, *signal_capture.of_curves(fit_error, sensitivity_error, doubts)))
    each = sample_signals(capture, SampleOptions(method, draws, seed, coefficients,
                                                 arguments.as_number(level, "level")),
                          with_draws=given.ndim == 1)
    estimates = [replace(one, advise=partial(advice_on_estimate, one)) for one in each]
    return estimates[0] if given.ndim == 1 else SpectrumEstimates(estimates)


@one_blas_thread()
def match(signal: Estimate | ArrayLike,
          library: str | Path | Sequence[str | Path] | Mapping[str, KnownSpectrum | ArrayLike], *,
          camera: arguments.CameraLike | None = None, light: arguments.LightLike | None = None,
          noise: ArrayLike | None = None, nm: ArrayLike | None = None, variation: float = VARIATION,
          evidence_ratio: float | None = None,
          prior: str | Path | LogitMixture | None = None) -> matching.SurfaceMatch:
    """Which measured spectra could have given a signal, or that none could.

    Parameters
    ----------
    signal : SpectrumEstimate or (K,) array
        An estimate holds its camera, light and errors; an array needs ``camera`` and ``light``.
    library : path, several, or mapping of names to reflectances
        Spectral files, folders and archives as of ``spectrabox match --library``; or reflectances,
        arrays (P,) at wavelengths ``nm``, or each a file, (nm, values) or a SpectralDistribution.
    camera, light
        As of `sample`, of a signal that is given as an array.
    noise : float or (K,) array, optional
        Standard error of a signal that is given as an array; without it the signal is taken as
        exact.
    nm : (P,) array, optional
        Wavelengths of the arrays of a mapping.
    variation : float
        Standard deviation of surfaces of one material, in reflectance.
    evidence_ratio : float, optional
        How much less evident than the best a spectrum may be and still not be told apart from it,
        above 1; by default what a true spectrum exceeds with a probability of 5 %.
    prior : path or LogitMixture, optional
        On reflectances that are in no library; the shipped one by default.

    Returns
    -------
    SurfaceMatch
        The most evident first: ``names``, ``libraries``, arrays ``log_evidence``, ``misfit``,
        ``p_value`` and ``may_be``; ``indistinguishable``, how many may be it; ``none_fits``.

    Raises
    ------
    InputError
        If no spectrum of the library can be used.

    References
    ----------
    Bayes factors between spectra, and of all of them against the prior: docs/how-to/match.md.

    Examples
    --------
    >>> import numpy as np
    >>> nm = np.arange(400, 701, 5)
    >>> library = {"orange": 0.1 + 0.6 / (1 + np.exp((580 - nm) / 15)),
    ...            "grey": np.full(nm.size, 0.3)}
    >>> answer = sb.match([0.53, 0.24, 0.08], library, nm=nm, camera="Nikon 5100 (NPL)",
    ...                   light="D65", noise=0.003)
    >>> answer.says
    """
    if not isinstance(signal, Estimate):
        if camera is None or light is None:
            raise InputError("a signal that is given as numbers needs its camera and its light")
        if arguments.as_numbers(signal, "signal").ndim != 1:
            raise InputError("one signal is identified at a time: give (K,) numbers or an estimate")
        one = sample(signal, camera=camera, light=light, noise=noise, prior=prior)
        assert isinstance(one, Estimate)
        signal = one
    if signal.measurement is None:
        raise InputError(f"the spectrum of {signal.name!r} was given: there is nothing to identify")
    if not isinstance(library, str | Path | Mapping | list | tuple) or not library:
        raise InputError("the library is empty, or none; give files, folders, or reflectances by "
                         "name")
    if isinstance(library, Mapping):
        if nm is None and any(isinstance(one, np.ndarray | list) for one in library.values()):
            raise InputError("reflectances of a library need their wavelengths: give nm")
        spectra = np.array([as_reflectance(
            (nm, one) if isinstance(one, np.ndarray | list) else one, name)  # type: ignore[arg-type]
            for name, one in library.items()])
        known = matching.SpectralLibrary(tuple(library), ("given",) * len(library), spectra,
                                np.zeros_like(spectra), ())
    else:
        words = [library] if isinstance(library, str | Path) else list(library)
        known = read_spectral_libraries([str(word) for word in words], signal.measurement.grid)
    found = matching.match_signal(signal.name, signal.measurement, known, arguments.as_prior(prior),
                         variation=variation, evidence_ratio=evidence_ratio)
    return replace(found, findings=(*found.findings, *signal.of_signal))
