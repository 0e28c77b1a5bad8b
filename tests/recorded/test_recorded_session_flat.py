"""White at regions of photos, shadows on charts, and which charts are one fit: recorded."""
import dataclasses
from types import SimpleNamespace

import numpy as np

from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.calibrate.light_field import LightElsewhere
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.light_drift import LightDrift
from spectrabox.radiometry.records import (
    LightScale,
    LinearImage,
    PhotoKind,
    Quantity,
    RegionSamples,
    Spectrum,
    UnknownLight,
)
from spectrabox.session.config.curve_sources import LightTable
from spectrabox.session.flat import calibrate_stage, white_at_regions
from spectrabox.session.flat.region_stage import _uneven, regions_of
from spectrabox.session.flat.signals_stage import _chart_view, _errors, _same
from spectrabox.session.flat.white_at_regions import (
    PhotoWhite,
    _exposure,
    _in_picture,
    far_notes,
    with_known,
)
from spectrabox.session.stages import calibrate_stage as scene_calibrate

BANDS, NAMES = 3, ("card", "leaf", "wall")
CAUSES = ("light and shutter repeat", "rounded exposures")


def rng():
    return np.random.default_rng(91)


def covariance(size, scale):
    root = rng().normal(size=(size, size + 2)) * scale
    return root @ root.T / size


def photo_white(field_error=1.0):
    """Three regions in three bands, their white known to about 2 %."""
    draw = rng()
    signal = np.array([[0.82, 0.79, 0.75], [0.11, 0.34, 0.08], [0.31, 0.22, 0.47]])
    samples = RegionSamples(
        NAMES, signal * [[0.9, 1.1, 0.7]] * [[1.0], [1.06], [0.93]] + [0.004, 0.002, 0.006],
        np.array([covariance(BANDS, 0.001 * (1 + number)) for number in range(3)]),
        np.array([200, 150, 90]), 0.01 * draw.random((3, BANDS)), draw.random((3, 4, 2)))
    field = np.log([1.0, 1.06, 0.93])
    size = 2 * BANDS + len(NAMES)
    whole = covariance(size + 2, 0.012)
    whole[2 * BANDS:size, 2 * BANDS:size] += np.diag([0.004, 0.02, 0.05]) ** 2 * field_error
    elsewhere = LightElsewhere(np.array([0.9, 1.1, 0.7]), np.array([0.004, 0.002, 0.006]), field,
                               whole[:size, :size], np.array([0.1, 0.6, 1.4]))
    return PhotoWhite(samples, elsewhere, 1.03, elsewhere.glare * 1.1, CAUSES,
                      0.002 * draw.normal(size=size + 2), whole)


def made_of(white):
    return {"white": white.white, "signal": white.signal,
            "errors": {name: white.errors(index) for index, name in enumerate(NAMES)},
            "noise": [white.noise(index) for index in range(3)],
            "jacobian": [white.jacobian(index) for index in range(3)]}


def test_white_at_regions_and_its_errors(recorded):
    white = photo_white()
    for index in range(3):      # the causes add up to the whole
        rows = white.jacobian(index)
        np.testing.assert_allclose(sum(white.errors(index).values()),
                                   rows @ white.covariance @ rows.T, atol=1e-15)
        # and a step of every unknown moves the signal as the derivative says
        step = 1e-6 * np.arange(1, white.mean.size + 1)
        moved = dataclasses.replace(white, mean=white.mean + step).signal[index]
        np.testing.assert_allclose((moved - white.signal[index]) / 1e-6, rows @ step / 1e-6,
                                   rtol=1e-4)
    recorded(made_of(white))


def said(call, *arguments):
    try:
        return call(*arguments)
    except SpectraboxError as error:
        return f"{type(error).__name__}: {error}"


def test_what_a_white_card_says_of_the_light(recorded):
    white = photo_white()
    known, error = {"card": np.array([0.83, 0.8, 0.77])}, {"card": covariance(BANDS, 0.003)}
    after = with_known(white, known, error)
    assert np.trace(after.covariance) < np.trace(white.covariance)
    recorded(made_of(after) | {"mean": after.mean, "covariance": after.covariance})
    both = with_known(white, known | {"leaf": np.array([0.1, 0.33, 0.09])},
                      error | {"leaf": covariance(BANDS, 0.002)})
    recorded(made_of(both), case="two")


def test_where_another_light_is_refused(recorded):
    """One band alone is off, by steps about the limits."""
    white = dataclasses.replace(photo_white(), covariance=np.diag(np.full(11, 1e-5)))
    found = {}
    for errors in (1e-6, 1.2e-4):
        for off in np.arange(-0.12, 0.121, 0.01):
            target = white.signal[0] * (1 + off * np.array([0, 1, 0]))
            made = said(with_known, white, {"card": target}, {"card": errors * np.eye(3)})
            found[f"{errors} {off:+.2f}"] = made if isinstance(made, str) else "taken"
    assert {"taken"} < set(found.values())
    recorded(found)


def test_which_regions_lie_far_from_the_chart(recorded):
    recorded({str(error): far_notes(photo_white(error)) for error in (
        0.1, 0.5, 0.85, 0.9, 0.95, 1.0, 1.1, 5.0, 6.5, 40.0)})


def image(exposure_s=0.02, f_number=4.0, source="a.dng", size=(40, 60)):
    return LinearImage(np.full((*size, 3), 0.2, np.float32), np.full((*size, 3), 1e-4, np.float32),
                       np.zeros((*size, 3), bool), 2.0, exposure_s, 100.0, f_number, PhotoKind.RAW,
                       "camera", source, "")


def test_exposures_of_photos_and_their_errors(recorded):
    config = SimpleNamespace(repeatability=SimpleNamespace(relative_error=0.019))
    drift = LightDrift(np.array([1.1, 1.0, 0.9]), np.full(3, 0.01), 1.02, 0.004, np.zeros(3), False,
                       "")
    photos = (image(), image(1 / 60, 5.6), image(1 / 13, 4.0), image(None, 4.0, "b.dng"))
    recorded({f"{number} {change is not None}": said(_exposure, config, photos[0], photo, change)
              for number, photo in enumerate(photos) for change in (None, drift)})
    corners = np.array([[-0.5, -0.5], [119.5, 79.5], [59.5, 39.5], [119.5, -0.5]])
    found = _in_picture(corners, image())
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), [1, 1, 0, 1], atol=1e-12)
    recorded(found, case="places")


def test_shadows_on_a_chart(recorded):
    """A patch darker by steps in all bands, or in one."""
    names = tuple(f"patch {number}" for number in range(12))
    held_out = np.linspace(0.05, 0.9, 12)[:, None] * [1.0, 0.9, 0.8]
    held_out[0] = [0.02, 0.025, 0.024]      # dark: not judged

    def notes(factor, patches=(5,), bands=slice(None)):
        measured = held_out.copy()
        for patch in patches:
            measured[patch, bands] *= factor
        predicted = 1.01 * held_out
        made = SimpleNamespace(held_out=held_out, predicted=predicted, calibration=SimpleNamespace(
            sensitivity=SimpleNamespace(residuals=1 - predicted / measured)))
        return calibrate_stage._shadow_notes(SimpleNamespace(chart_files=("c.dng",)), made, names)

    recorded({
        "all bands": {str(factor): notes(factor) for factor in (0.5, 0.9, 0.935, 0.945, 1.0, 1.2)},
        "one band": {str(factor): notes(factor, bands=1) for factor in (0.7, 0.85)},
        "unequal": [notes(np.array(each)) for each in ([0.85, 0.9, 0.93], [0.8, 0.95, 0.97])],
        "dark": notes(0.5, (0,)), "many": notes(0.8, range(1, 10)),
        "two": notes(0.88, (3, 7))})


def light(word):
    return LightTable(file=word) if word.endswith(".csv") else LightTable(word=word)


def views_of(lights, charts):
    return [SimpleNamespace(name="" if number == 0 else f"v{number}", light=light(word),
                            chart={"": ("c",)} if chart else {}, chart_files=("c",),
                            record=lambda kind, number=number: f"{kind} {number}")
            for number, (word, chart) in enumerate(zip(lights, charts, strict=True))]


KINDS = {"one": (("a.csv", "a.csv", "a.csv"), (1, 0, 1)),
         "two": (("a.csv", "D65", "D65"), (1, 1, 0)),
         "unknown": (("led", "led", "led"), (1, 0, 1)), "mixed": (("a.csv", "led", "a.csv"),
                                                                  (1, 1, 1)),
         "mixed first": (("led", "a.csv", "led"), (1, 1, 0))}


def test_which_charts_of_flat_samples_are_one_fit(recorded):
    recorded({name: [[view.name for view in group] for group in calibrate_stage._one_fit_each(
        SimpleNamespace(all_views=views_of(*kind)))] for name, kind in KINDS.items()})


def test_which_charts_of_a_scene_are_one_fit(recorded, monkeypatch):
    """Which charts each calibration was asked for, with which options, and what each view got."""
    fits = []
    grid = scene_calibrate.GRID

    def calibrated(photos, grid, options):
        fits.append(f"{'+'.join(photo.samples for photo in photos)} by {options.method}"
                    f"{'' if options.curves is None else ' of curves'}")
        made = SimpleNamespace(states=[SimpleNamespace(scale=10.0 + int(photo.samples[-1]),
                                                       scale_error=0.1) for photo in photos])
        return SimpleNamespace(
            calibration=Camera(SimpleNamespace(curves=np.ones((3, 301))),
                               LightScale(made.states[0].scale, 0.1, None, "chart")),
            prior_fit=SimpleNamespace(photos=made.states) if options.method == "prior"
            and options.curves is None else None, scale=LightScale(99.0, 1.0, None, "own"),
            predicted=np.ones((24, 3)), white=None, prior_standing=None)

    @dataclasses.dataclass(frozen=True)
    class Camera:
        sensitivity: object
        light_scale: LightScale | None
        light: object = None

    def read(config, reference):
        return Spectrum(grid, np.ones(grid.nm.size), Quantity.RELATIVE,
                        reference.file or reference.word) \
            if reference.stated else UnknownLight()

    for name, replacement in (
            ("read_light", read), ("calibrate_chart", calibrated),
            ("chart_of", lambda stored, view: (None, f"chart {view.name or 'v0'}", None)
             if view.chart else None),
            ("_certain_glare", lambda *_: np.zeros(3)), ("_uneven_notes", lambda *_: ()),
            ("left_out_patches", lambda *_: None), ("read_chart_reference", lambda *_: None),
            ("kept_out_patches", lambda *_: None), ("session_chart", lambda *_: None),
            ("_widen_by_lamp_position", lambda *_: None),
            ("scale_of_photo", lambda fit, number: LightScale(fit.photos[number].scale, 0.1, None,
                                                              f"number {number}")),
            ("ChartPhoto", lambda samples, *_, **__: SimpleNamespace(samples=samples))):
        monkeypatch.setattr(scene_calibrate, name, replacement)
    monkeypatch.setattr(scene_calibrate.CalibrationOptions, "__init__",
                        lambda self, method="prior", prior=None, coefficients=10, curves=None:
                        self.__dict__.update(method=method, curves=curves))
    found = {}
    for placed in (True, False):
        monkeypatch.setattr(scene_calibrate, "_irradiance",
                            lambda *_, placed=placed: np.ones(24) if placed else None)
        for method in (None, "smooth"):
            for name, kind in KINDS.items():
                if method and "led" in kind[0]:
                    continue        # refused before
                fits.clear()
                config = SimpleNamespace(all_views=views_of(*kind), sensitivity=SimpleNamespace(
                    from_chart=True, method=method, prior=None, coefficients=9))
                records = scene_calibrate.calibrate_views(SimpleNamespace(
                    config=config, stored=None, device="cpu", progress=lambda *_: None))
                found[f"{name} {method} {placed}"] = {
                    "fits": list(fits), "lights": [
                        getattr(made.light, "source", "of its own") for made in (
                            records[f"calibration {number}"] if number else records["calibration"]
                            for number in range(3))],
                    "scales": [made.light_scale for made in (
                        records[f"calibration {number}"] if number else records["calibration"]
                        for number in range(3))]}
    recorded(found)


def test_which_photos_show_which_regions(recorded):
    config = SimpleNamespace(
        regions={"a": SimpleNamespace(photos=()), "b": SimpleNamespace(photos=("photo",)),
                 "c": SimpleNamespace(photos=("v1", "photo")),
                 "d": SimpleNamespace(photos=("v1",))},
        all_views=views_of(("a.csv", "a.csv"), (1, 0)))
    recorded({"shown": [[name for name, _ in regions_of(config, view)]
                        for view in config.all_views],
              "chart": [_chart_view(config, view).name for view in config.all_views],
              "uneven": _uneven("a", 0.123)})


def test_responses_that_are_one(recorded):
    response = np.array([[0.2, 0.3, 0.5], [0.6, 0.3, 0.1]])
    recorded([_same(response, response + off) for off in (0, 5e-10, 5.9e-10, 6.1e-10, 1e-8)]
             + [_same(response, response[:1])])


def test_errors_of_a_region_in_several_photos(recorded, monkeypatch):
    """Noise of two photos is averaged, what they share is not."""
    task = SimpleNamespace(stored=None)
    monkeypatch.setattr("spectrabox.session.flat.signals_stage.photo_of",
                        lambda stored, view: image(size=(4, 6)))
    config = SimpleNamespace(stray_light=SimpleNamespace(glare=0.006))
    first, second = views_of(("a.csv", "a.csv"), (1, 0))
    one = photo_white()
    two = dataclasses.replace(photo_white(2.0), exposure=0.5, causes=("drift", "rounded exposures"))
    drift = LightDrift(np.array([1.1, 1.0, 0.9]), np.full(3, 0.01), 1.02, 0.004,
                       np.array([0.02, 0.01, -0.03]), True, "")
    model = PatchError(0.004, 0.011)
    alone = _errors(task, config, [(one, 1, first)], model, None)
    both = _errors(task, config, [(one, 1, second), (one, 1, second)], model, drift)
    np.testing.assert_allclose(both["photo noise"], alone["photo noise"] / 2)
    for cause in set(alone) - {"photo noise"}:
        np.testing.assert_allclose(both[cause], alone[cause])
    two_photos = _errors(task, config, [(one, 1, first), (two, 2, second)], model, drift)
    three = _errors(task, config, [(one, 1, first), (two, 2, second), (two, 0, second)], model,
                    drift)
    shared = white_at_regions._shared(covariance(3, 0.1), np.array([0.3, 0.2, 0.4]))
    recorded({"one": alone, "two": two_photos, "three": three,
              "model": [model.among_bands(3), shared]})
