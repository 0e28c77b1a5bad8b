"""Changes of the synthetic session of ``report_example``: ratios, doubts, lights, patches."""
import dataclasses
import json

import numpy as np
from compact_results import Texts, compact
from report_example import GRID, SURFACES, example_session

from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.light_scale import REPEATABILITY, with_common_error
from spectrabox.radiometry.records import (
    CalibrationDoubt,
    LeftOutPatches,
    LightPosterior,
    Outcome,
    PriorStanding,
    SurfaceMisfit,
)
from spectrabox.sampling.prior.certified import (
    BandCertificate,
    FamilyCertificate,
    FamilyStanding,
)
from spectrabox.session.box.geometry_record import MarkedView, Placement, SceneGeometry
from spectrabox.session.picture.picture_results import PictureOfSpectra
from spectrabox.session.picture.unseen import WORDS
from spectrabox.session.report.page import render_report
from spectrabox.session.store.results import ViewResult

GEOMETRY = SceneGeometry(
    (Placement("camera", "from 6 corners, rms 1.31 pixels", "mm", None,
               np.array([10.5, -210.0, 900.25]), None, np.array([0.8, 1.1, 2.4])),
     Placement("lamp", "refined on the photo", "scene's unit", np.array([0.1, 0.9, 0.4]),
               np.array([0.12, 0.87, 0.41]), np.array([0.02, -0.03, 0.01]), None)),
    (MarkedView("", np.array([[[0.1, 0.2], [0.7, 0.25]], [[0.1, 0.2], [0.15, 0.9]]]),
                ("back left", "back right"), np.array([[0.1, 0.2], [0.7, 0.26]]),
                np.array([[0.101, 0.2], [0.698, 0.255]]), np.array([0.7, 2.45])),
     MarkedView("evening", np.array([[[0.3, 0.2], [0.6, 0.4]]]), (), np.empty((0, 2)),
                np.empty((0, 2)), np.empty(0))))


def with_made(results, **changes):
    return dataclasses.replace(results, reconstruction=dataclasses.replace(
        results.reconstruction, **changes))


def with_ratio(results, ratio):
    agreement = dataclasses.replace(results.reconstruction.agreement, ratio=np.asarray(ratio))
    return with_made(results, agreement=agreement)


def with_fit(results, **changes):
    fit = dataclasses.replace(results.calibration.sensitivity, **changes)
    return dataclasses.replace(results, calibration=dataclasses.replace(
        results.calibration, sensitivity=fit))


def spread_over(worst):
    """Ratios whose worst bands have a median of ``worst``, all of them different."""
    off = worst * np.array([0.4, 0.8, 1.0, 1.1, 1.2])
    return 1 + off[:, None] * np.array([[0.3, -1.0, 0.5], [1.0, 0.2, -0.4], [0.1, -0.6, 1.0],
                                        [-1.0, 0.3, 0.2], [0.4, 0.9, 1.0]])


def a_view(results, ratio, misfits=(), name="evening"):
    """Another photo, in two bands and under a light of its own."""
    made = results.reconstruction
    agreement = dataclasses.replace(made.agreement, ratio=np.asarray(ratio),
                                    spread=made.agreement.spread[:, :2] * 1.4)
    made = dataclasses.replace(
        made, agreement=agreement, misfits=misfits,
        measured=made.measured[..., ::2] * 1.1, rendered=made.rendered[..., ::2],
        signal=made.signal[:, ::2], white_signal=made.white_signal[::2] * 1.3,
        signal_covariance=made.signal_covariance[:, ::2, ::2],
        model_covariance=made.model_covariance[:, ::2, ::2],
        light_scale=dataclasses.replace(made.light_scale, value=1.7, standard_error=0.03,
                                        source="its own grey card"))
    light = results.calibration.light
    light = dataclasses.replace(light, values=light.values[::-1].copy(), source="a lamp's reading")
    fit = results.calibration.sensitivity
    fit = dataclasses.replace(fit, curves=fit.curves[::2], **{
        field: None if getattr(fit, field) is None else getattr(fit, field)[..., ::2]
        for field in ("residuals", "held_out_residuals")},
        standard_error=None if fit.standard_error is None else fit.standard_error[::2])
    calibration = dataclasses.replace(results.calibration, light=light, sensitivity=fit,
                                      relative_covariance=np.diag([2e-4, 3e-4]))
    return ViewResult(name, ("C", "M"), calibration, results.photo_preview, made)


def left_out(held, expected=0.97):
    """Patches left out whose bands hold the reference at a share of wavelengths, about."""
    rng = np.random.default_rng(4)
    count, points = len(CLASSIC.names), GRID.nm.size
    reference = rng.uniform(0.1, 0.8, (count, points))
    mean = reference + rng.normal(0, 0.02, (count, 1)) + rng.normal(0, 0.005, (count, points))
    lower, upper = reference - 0.05, reference + 0.04
    missed = round((1 - held) * count * points)
    for at in range(missed):
        row, column = at % count, at // count
        lower[row, column], upper[row, column] = reference[row, column] + [0.01, 0.05]
    return LeftOutPatches(GRID, mean, lower, upper, reference, np.arange(count) == 5,
                          np.full(count, expected) + np.linspace(0.01, -0.01, count), 0.95)


def a_posterior():
    """A light that nobody stated."""
    mean = 0.5 + 0.2 * np.cos(GRID.nm / 70)
    return LightPosterior(GRID, ("daylight", "led"), np.array([0.3, 0.7]), mean, 0.9 * mean,
                          1.2 * mean, 0.9, ("probably an LED",))


def families(share):
    measured = FamilyCertificate(True, 3, 900, BandCertificate(0.952, 0.171),
                                 BandCertificate(0.944, 0.19))
    modelled = FamilyCertificate(False, 2, 600, BandCertificate(0.915, 0.193),
                                 BandCertificate(0.891, 0.164))
    return (FamilyStanding("textile", share, False, modelled),
            FamilyStanding("paint", 0.9 - share, False, measured),
            FamilyStanding("skin", 0.1, True, None))


def full(folder):
    """A session of everything that a report can show."""
    results = example_session(folder)
    first, second, given = results.materials
    budget = {REPEATABILITY: 0.27, "light": 0.4}
    first = dataclasses.replace(first, families=families(0.6), variance_shares=budget)
    samples = dataclasses.replace(second.samples, outcome=Outcome.UNFAMILIAR, seed=9,
                                  spectra=second.samples.spectra[:150],
                                  coefficients=second.samples.coefficients[:150],
                                  effective_samples=61.4, sentence="unlike what is known")
    summary = dataclasses.replace(second.summary, level=0.8, next_measurement_nm=611.0)
    second = dataclasses.replace(second, samples=samples, families=families(0.2), summary=summary)
    chart = dataclasses.replace(results.chart, left_out=left_out(0.9), prior=PriorStanding(
        np.linspace(0, 1, 3 * results.reconstruction.grid.nm.size).reshape(3, -1)**2,
        ("Maker A", "Maker B"), np.array([0.83, 0.17])))
    misfits = tuple(SurfaceMisfit(name, 0.02 * (at + 1), f"{name} does not fit")
                    for at, name in enumerate(SURFACES))
    calibration = dataclasses.replace(results.calibration, doubts=(CalibrationDoubt.WRONG_LIGHT,),
                                      light_posterior=a_posterior())
    picture = PictureOfSpectra(("results/picture/mean.exr", "results/picture/sd.exr"),
                               (("Colour", folder / "preview.png"),), (41, 23), 0.12,
                               (0.88, 0.05, 0.07, *[0.0] * (len(WORDS) - 3)), 0.013, 0.021, 0.034,
                               ("a note on the picture",))
    facts = {"level": 0.9, "seed": 3, "times": 40, "materials": [
        {"name": "white", "coverage": 0.84, "coverage_standard_error": 0.01, "rmse": 0.03,
         "width": 0.1, "ranks": [1, 2, 3]}]}
    inputs = [dict(results.inputs[0], facts={"exposure_s": 0.25, "f_number": 5.6}),
              results.inputs[1]]
    results = with_made(results, misfits=misfits, outcome=Outcome.STEP_LIMIT)
    ratio = spread_over(0.03)[:, :2]
    ratio[1] = np.nan
    return dataclasses.replace(
        results, materials=[first, second, given], chart=chart, calibration=calibration,
        light_scale=with_common_error(results.light_scale, REPEATABILITY, 0.017),
        views=[a_view(results, ratio), a_view(results, spread_over(0.02)[:, 1:], name="night")],
        geometry=GEOMETRY, rehearsal=facts, picture=picture, inputs=inputs,
        warnings=["a first warning", "a second one"])


def content(results):
    """The data of a page without digests, its lines, and the numbers of its read-outs."""
    rendered = render_report(results)
    page = Texts(rendered.page)
    return compact(json.loads(rendered.numbers)), page.lines, page.readouts
