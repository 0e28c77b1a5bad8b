"""A scene replayed with known truths: do its bands hold them?

Simulation-based calibration of one scene: its own photos again, with known truths.

Talts, Betancourt, Simpson, Vehtari and Gelman 2018: where truths are drawn from the prior and data
from the truths, the rank of each truth among the draws is uniform if everything between is right.
Here what lies between is this scene's geometry, light, camera, noise and errors. Truths are made
by the models behind the prior's families, not drawn from the fitted mixture, so that bands can fail
by the prior too. Reflectances, curves of the camera, the light's readings, scale and repeatability,
glare and stray light, what surfaces mirror, surfaces that are brighter than the scene says and
uneven, and the noise of photo and tracing are drawn anew each time; the transport, traced once,
carries them to a photo, and the code of `measure` takes it from there. What the scene takes as
certain is certain here too: where the lamp stands. It shows "calibrated here" as far as the stated
errors are right.
"""


from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spectrabox.calibrate.prior.curve_posterior import sensitivity_draws
from spectrabox.measure import texts
from spectrabox.measure.scene.photo_errors import with_stray_light
from spectrabox.measure.surfaces.surface_signals import measurement, scene_signals
from spectrabox.radiometry import error_model, findings, gloss, interreflection
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import calibration, spectra
from spectrabox.radiometry.records.scenes import JointReconstruction
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct import settings, view
from spectrabox.reconstruct.fit.transport_fit import TracedView
from spectrabox.reconstruct.replay import replay, replayable
from spectrabox.sampling.prior import mixture
from spectrabox.sampling.prior.families.family_models import true_reflectances
from spectrabox.sampling.prior.signal_posterior import solve_posterior

TOLERATED = 0.02         # of coverage: less is not worth a warning
FIGURES = ("coverage", "coverage_standard_error", "rmse", "width", "ranks")     # by material


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """Rehearsals of one session with known truths: M materials over all of them."""

    level: float                        # of the bands
    seed: int
    times: int
    names: tuple[str, ...]              # of the materials
    coverage: np.ndarray                # (M,) mean share of wavelengths inside the band
    coverage_standard_error: np.ndarray
    rmse: np.ndarray                    # (M,) mean
    width: np.ndarray                   # (M,) mean, of the band
    ranks: np.ndarray                   # (M, 10) counts of the truth's rank among the draws

    @property
    def too_narrow(self) -> bool:
        """Whether some material's bands hold less than they state, beyond two standard errors and
        two percent.
        """
        return bool(np.any(self.coverage + 2 * self.coverage_standard_error
                           < self.level - TOLERATED))

    @property
    def finding(self) -> findings.Finding:
        """Whether bands hold as stated, by the worst material."""
        return findings.Finding("scene.rehearsed", findings.Severity.WARN if self.too_narrow
                                else findings.Severity.INFO, self.names[self.coverage.argmin()],
                                {"value": float(self.coverage.min()), "intended": self.level,
                                 "times": self.times, "photo": ""})

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        figures = {name: getattr(self, name).tolist() for name in FIGURES}
        return {"level": self.level, "seed": self.seed, "times": self.times, "materials": [
            dict(zip(("name", *figures), values, strict=True))
            for values in zip(self.names, *figures.values(), strict=True)]}

    @property
    def text(self) -> str:
        """A table for a person."""
        lines = [f"{self.times} rehearsals with known truths; {self.level:.0%} of wavelengths "
                 "should lie inside the bands",
                 f"{'material':<16} {'band holds':>18} {'RMSE':>8} {'width':>8}   truths by rank"]
        for name, coverage, error, rmse, width, ranks in zip(
                self.names, *(getattr(self, figure) for figure in FIGURES), strict=True):
            share = f"{coverage:.1%} +- {error:.1%}"
            lines.append(f"{name:<16} {share:>18} {rmse:>8.3f} {width:>8.3f}   "
                         + " ".join(map(str, ranks)))
        return "\n".join([*lines, texts.sentence(self.finding)])


# ---- simulation-based calibration of one scene: its own photos again, with known truths ----------

DRAWS = 399              # of each posterior: ranks 0 to 399 fall into ten bins of 40
RANK_BINS = 10
RANK_STEP = 6            # every 30 nm: closer wavelengths rank alike
MIN_TIMES = 20
TRACING = 0.1            # of the time: tracing light


def rehearse(views: Sequence[view.PhotoView], settings: settings.InversionSettings,
             calibrations: Sequence[calibration.Calibration], joint: JointReconstruction,
             families: Mapping[str, Sequence[str]], glare: np.ndarray, ambient: float,
             stated_gloss: Mapping[str, str | None], *, times: int, level: float, seed: int,
             progress: spectra.Progress) -> Rehearsed:
    """Trace the light of a reconstructed scene, replay it with known truths, and count what the
    bands hold of them.

    Parameters
    ----------
    views : sequence of PhotoView
        Every photo with all that explains it, as it was reconstructed.
    settings : InversionSettings
    calibrations : sequence of Calibration
        Of each view.
    joint : JointReconstruction
        Of the photos.
    families : mapping
        From the name of each material to the families of surfaces that it is stated to be of; none
        for any.
    glare, ambient, stated_gloss
        As of ``photo_errors.with_stray_light``.
    times : int
        T, from 20 up.
    level : float
        Of the bands.
    seed : int
        Of truths, cameras, photos and draws.
    progress : callable

    Returns
    -------
    Rehearsed
        Of every unknown material.

    Raises
    ------
    InputError
        If the scene is to be rehearsed fewer than 20 times.
    """
    if times < MIN_TIMES:
        raise InputError(f"{times} rehearsals tell nothing of coverage: {MIN_TIMES} or more are "
                         "needed, and 200 know it to about one percent")
    progress(0.0, "tracing light")
    prior = mixture.load_prior()
    # of every unknown material, of its families if stated
    priors = {name: mixture.of_families(prior, families[name])
              for name, known in zip(joint.materials, joint.known, strict=True) if not known}
    of_truths, of_photos = np.random.SeedSequence(seed).spawn(2)
    truths = {name: true_reflectances(own, times, np.random.default_rng(one)) for (name, own), one
              in zip(priors.items(), of_truths.spawn(len(priors)), strict=True)}  # (T, 61) each
    traced_views = replayable(views, settings, lambda done, what: progress(TRACING * done, what))
    cameras = _cameras(calibrations[0], times, seed)
    figures = np.zeros((3, len(priors), times))     # coverage, RMSE and width
    ranks = np.zeros((len(priors), RANK_BINS), int)
    for number, one in enumerate(of_photos.spawn(times)):
        progress(TRACING + (1 - TRACING) * (number / times), f"rehearsal {number + 1} of {times}")
        rng = np.random.default_rng(one)
        true_spectra = dict(zip(joint.materials, joint.spectra, strict=True)) | {
            name: np.interp(joint.grid.nm, mixture.PRIOR_GRID.nm, own[number])
            + (gloss.draw_gloss(stated_gloss[name], 1, rng)[0] if name in stated_gloss else 0.0)
            for name, own in truths.items()}
        responses = tuple(_response(traced, calibrations[index], joint, index, cameras[number], rng)
                          for index, traced in enumerate(traced_views))
        # as large as stated, and never less than none
        true_glare = [glare * part for part in np.abs(rng.standard_normal(len(responses)))]
        true_ambient = ambient * np.abs(rng.standard_normal(len(responses)))
        again = with_stray_light(replay(traced_views, settings, true_spectra, responses, true_glare,
                                        true_ambient.tolist(), rng), glare, ambient, stated_gloss)
        signals = scene_signals(again, calibrations)
        for index, (name, own) in enumerate(priors.items()):
            posterior = solve_posterior(own, measurement(signals, again.materials.index(name)))
            draws = posterior.draws(DRAWS, int(rng.integers(1 << 31)))
            figures[:, index, number], of_truth = _scores(draws, truths[name][number], level)
            ranks[index] += of_truth
    coverage, rmse, width = figures.mean(axis=2)
    # wavelengths of one truth are no separate trials
    error = figures[0].std(axis=1, ddof=1) / np.sqrt(times)
    return Rehearsed(level, seed, times, tuple(priors), coverage, error, rmse, width, ranks)


def _cameras(calibration: calibration.Calibration, times: int, seed: int) -> np.ndarray:
    """Curves (T, K, P) of as many cameras as there are rehearsals."""
    fit = calibration.sensitivity
    if fit.covariance is not None:
        return sensitivity_draws(calibration, times, seed)
    # measured curves: each admits a stated share of light from everywhere
    rng = np.random.default_rng(seed)
    bands = len(fit.curves)
    shares = rng.multivariate_normal(np.zeros(bands), calibration.relative_covariance, times)
    tails = fit.curves.mean(axis=1, keepdims=True) * np.ones_like(fit.curves)
    return np.asarray(fit.curves + shares[..., None] * (tails - fit.curves))


def _response(traced: TracedView, calibration: calibration.Calibration, joint: JointReconstruction,
              index: int, curves: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Response (L, K, P) of a true camera (K, P) under true light, with the true scale in it."""
    view = traced.view
    stated = calibration.light.standard_error
    noise = np.zeros_like(view.light) if stated is None else np.interp(
        view.grid.nm, calibration.light.grid.nm, stated * rng.standard_normal(stated.size))
    light = np.maximum(spectrum_on_grid(calibration.light, view.grid) + noise, 0)
    separate = traced.traced.passes.shape[2] > 1
    lights = [view.own_lights.get(name, light) for name, in view.light_groups] if separate \
        else [light]
    # what a band reads of white is calibrated, and known to the error of the scale
    scale = view.light_scale or joint.views[index].light_scale
    covariance = sum(error_model.scale_covariances(calibration, scale).values())
    white = interreflection.white_signal(view.response) * (1 + rng.multivariate_normal(
        np.zeros(len(view.bands)), covariance))
    factor = scale.value * white / interreflection.white_signal(
        interreflection.response_matrix(view.grid, curves, light))
    return np.array([interreflection.response_matrix(view.grid, curves, each) * factor[:, None]
                     for each in lights])


def _scores(draws: np.ndarray, truth: np.ndarray, level: float
            ) -> tuple[np.ndarray, np.ndarray]:
    """Coverage, RMSE of the mean and mean width as (3,), and truths (bins,) by their rank."""
    lower, upper = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
    ranks = (draws[:, ::RANK_STEP] < truth[::RANK_STEP]).sum(axis=0)
    bins = np.bincount(ranks * RANK_BINS // (DRAWS + 1), minlength=RANK_BINS)
    inside = (truth >= lower) & (truth <= upper)
    off = draws.mean(axis=0) - truth
    return np.array([inside.mean(), np.sqrt(np.mean(off**2)), np.mean(upper - lower)]), bins
