"""What stages make of records, held to what was recorded: two photos by one camera under two lamps
and a third like the first, no two numbers alike; and where each limit lies.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.light_scale import LAMP_AT_CHART, REPEATABILITY
from spectrabox.radiometry.records import (
    Calibration,
    CommonError,
    JointReconstruction,
    LightScale,
    LightTransport,
    LinearImage,
    Outcome,
    PhotoKind,
    Quantity,
    Reconstruction,
    RegionTransport,
    SensitivityFit,
    SignalError,
    Spectrum,
    StrayLight,
    SurfaceAgreement,
    SurfaceMisfit,
    SurfaceSignals,
)
from spectrabox.session.picture.part_of_photo import cut, part_of
from spectrabox.session.stages import assemble, inputs, reconstruct_stage, surface_signals
from spectrabox.session.stages.calibrate_stage import _certain_glare
from spectrabox.session.stages.error_budget import (
    families_allowed,
    light_covariance,
    measurement_of,
    relative_errors,
    signal_covariances,
    variance_shares,
)
from spectrabox.session.stages.one_transport import require_one_transport
from spectrabox.session.stages.scene_sampling import _common_errors
from spectrabox.session.stages.scenes import check_aspect
from spectrabox.session.stages.stray_light import with_stray_light

GRID, COARSE = visible_grid(1), visible_grid(5)
NM = GRID.nm
RNG = np.random.default_rng(77)
CURVES = np.exp(-0.5 * ((NM - [[610], [535], [455]]) / [[38], [34], [27]]) ** 2) * [[1], [.9], [.7]]
LAMPS = np.array([0.3 + (NM - 400) / 400, 1.4 - (NM - 400) / 500 + 0.2 * np.sin(NM / 25)])
BASIS = np.exp(-0.5 * ((NM[:, None] - np.linspace(410, 690, 6)) / 40) ** 2)
PAINTS = np.array([0.1 + 0.5 / (1 + np.exp(-(NM - 580) / 15)), 0.7 - 0.1 * np.cos(NM / 60),
                   0.2 + 0.3 * np.exp(-((NM - 500) / 35) ** 2)])
NAMES = ("red", "white", "green")
RESPONSES = [CURVES * lamp / (CURVES * lamp).sum(axis=1, keepdims=True) for lamp in LAMPS]


def spread(*shape, size=1e-3):
    """Covariances with off-diagonals, no two alike."""
    root = RNG.normal(size=shape) * size
    return root @ np.swapaxes(root, -1, -2)


def spectrum(values, errors=True, grid=GRID):
    on = np.interp(grid.nm, NM, values)
    return Spectrum(grid, on, Quantity.RELATIVE, "lamp",
                    0.01 * on * (1 + np.sin(grid.nm / 30) / 2) if errors else None)


def calibration(lamp=0, fitted=True, errors=True, changed=1.0):
    covariance = spread(18, 18, size=2e-3) if fitted else None
    fit = SensitivityFit(GRID, CURVES * changed, BASIS if fitted else None,
                         np.ones((3, 6)) if fitted else None, covariance, None, None, None, None,
                         "made", Outcome.CONVERGED)
    return Calibration(fit, spectrum(LAMPS[lamp], errors, COARSE if lamp else GRID),
                       LightScale(2.0, 0.05, None, "chart photo"), spread(3, 5, size=0.01), ())


def scale(value, error, *common):
    total = float(np.hypot(error * value, value * np.hypot.reduce([each for _, each in common])))
    return LightScale(value, total, None, "chart photo", tuple(CommonError(*each)
                                                               for each in common))


def view(number, materials=NAMES):
    """A photo of 8 x 10 pixels of three materials, the last with two surfaces."""
    surface = np.repeat([0, 1, 2, 3, -1], 2)[None].repeat(8, axis=0)
    signal = PAINTS @ RESPONSES[number % 2].T * (1 + 0.01 * number)
    white = np.array([0.8, 1.1, 0.6]) * (1 + number)
    shown = np.array([0, 1, 2, 2])
    shading = np.linspace(0.4, 1.2, 8)[:, None, None] * (1 + 0.1 * np.cos(np.arange(10))[None, :,
                                                                                         None])
    measured = signal[shown[surface]] * white * shading
    used = np.ones(surface.shape, bool)
    used[:2, 3], used[surface < 0] = False, False
    agreement = SurfaceAgreement(
        ("red / wall", "white / floor", "green / ball", "green / can"),
        ("red", "white", "green", "green"), np.array([15, 12, 16, 14]),
        1 + 0.01 * RNG.normal(size=(4, 3)), 0.02 * RNG.random((4, 3)))
    light_scale = scale(2.0 + number, 0.01, (LAMP_AT_CHART, 0.006), *(
        [(REPEATABILITY, 0.013)] if number else [("drift of the light", 0.004)]))
    return Reconstruction(
        materials, (False, True, False), GRID, BASIS, np.ones((3, 6)), PAINTS, white, signal,
        spread(3, 3, 4), spread(3, 3, 4), measured, measured, used, surface, agreement, light_scale,
        np.array([3.0, 2.0]), "made", 4, 1, Outcome.CONVERGED)


def joint():
    """Bands of two lamps; the third photo is under the first."""
    transport = LightTransport(NAMES, np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0],
                                                [0, 2, 1]]), RNG.random((5, 5)))
    material = np.array([0, 1, 2, 2, 0])
    regions = RegionTransport(transport, RNG.random((5, 3)), 0.01 * RNG.random((5, 3)),
                              np.array([0, 1, 2, 3, 0]), material, 0.012, 0.007)
    return JointReconstruction(
        (view(0), view(1), view(2)), ("photo", "warm", "brief"), NAMES, (False, True, False), GRID,
        PAINTS, tuple(f"{name}: {band}" for name in ("photo", "warm") for band in "RGB"),
        np.repeat([0, 1], 3), np.vstack(RESPONSES), PAINTS @ np.vstack(RESPONSES).T * 0.99,
        spread(3, 6, 7), spread(3, 6, 7), (regions,),
        (StrayLight("veiling glare", 0.01 * RNG.random((3, 6))),
         StrayLight("stray light", 0.01 * RNG.random((3, 6)))))


@pytest.fixture(autouse=True)
def drawn_anew(monkeypatch):
    """Every test draws the same numbers, whatever ran before it."""
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(77))


@pytest.mark.parametrize("kind", ["fitted", "measured", "products", "light unstated"])
def test_errors_of_signals_by_cause(recorded, kind):
    made, fitted = joint(), kind != "measured"
    first = calibration(0, fitted, kind != "light unstated")
    second = calibration(1, fitted, changed=1.02 if kind == "products" else 1.0)
    if kind != "products":
        second = dataclasses.replace(second, sensitivity=first.sensitivity)
    three = [first, second, first]
    for index in range(3):
        found = signal_covariances(three, made, index)
        whole = measurement_of(three, made, index)
        # every cause is a covariance, and they add up
        for covariance in found.values():
            assert np.linalg.eigvalsh(covariance).min() > -1e-12
        np.testing.assert_allclose(whole.noise_covariance, sum(found.values()), rtol=1e-12)
        recorded({"causes": found, "relative": relative_errors(three, made, index),
                  "light": light_covariance(three, made, index), "measurement": whole},
                 case=NAMES[index])
    recorded({"shares": variance_shares(three, made, 0, ("paint",)),
              "families": families_allowed(three, made, 2, ()),
              "stated": families_allowed(three, made, 2, ("leaf", "paint"))}, case="shares")


@pytest.mark.parametrize("fitted", [True, False])
def test_errors_of_regions_of_a_scene(recorded, fitted):
    made, camera = joint(), calibration(0, fitted)
    response = RESPONSES[0] * made.views[0].white_signal[:, None] * 2.3
    one = dataclasses.replace(
        made, bands=("R", "G", "B"), view_of_band=np.zeros(3, int), response=RESPONSES[0],
        signal=made.signal[:, :3], signal_covariance=made.signal_covariance[:, :3, :3],
        model_covariance=made.model_covariance[:, :3, :3], stray_light=tuple(
            dataclasses.replace(each, relative=each.relative[:, :3]) for each in made.stray_light))
    found = _common_errors(camera, one, made.regions[0], response)
    # signs of principal directions are anyone's
    summed = np.einsum("qrk,qsl->rksl", found, found)
    recorded({"errors": summed, "count": len(found)})
    if not fitted:      # of one material, an error moves all regions in proportion to its brightest
        tails = found[:9].reshape(3, 3, 5, 3)
        total = np.einsum("mqrk,mqrl->mrkl", tails, tails)
        received = made.regions[0].transport
        assert total.shape == (3, 5, 3, 3) and received.exponents.shape == (5, 3)
        ratio = total[0, 0] / camera.relative_covariance
        white = response.sum(axis=1)
        np.testing.assert_allclose(ratio / np.outer(white, white),
                                   (ratio / np.outer(white, white))[0, 0], rtol=1e-9)


def test_stray_light_by_photo_and_material(recorded):
    made = with_stray_light(joint(), np.array([0.004, 0.007, 0.002]), 0.003)
    recorded({each.cause: each.relative for each in made.stray_light})


def test_what_other_surfaces_say(recorded):
    signal = np.array([[0.3, 0.2, 0.4, np.nan, np.nan, np.nan], [0.5, 0.6, 0.7, 0.1, 0.2, 0.3]])
    both = SurfaceSignals(
        ("one", "two"), (False, False), GRID, PAINTS[:2], tuple("RGBrgb"), np.repeat([0, 1], 3),
        np.vstack(RESPONSES), signal,
        (SignalError("noise", spread(2, 6, 6, size=0.01)),
         SignalError("light", spread(2, 6, 6, size=0.02))))
    for index in range(2):
        recorded({"measurement": surface_signals.measurement(both, index),
                  "errors": surface_signals.errors_by_cause(both, index),
                  "relative": surface_signals.relative_errors(both, index),
                  "shares": surface_signals.variance_shares(both, index, ("leaf",)),
                  "families": surface_signals.families_allowed(both, index, ())},
                 case=both.names[index])


def image(width=60, height=40, step=2.0, exposure_s=0.02, clipped=0):
    saturated = np.zeros((height, width, 3), bool)
    saturated.reshape(-1, 3)[:clipped, 1] = True
    return LinearImage(np.full((height, width, 3), 0.2, np.float32),
                       np.full((height, width, 3), 1e-4, np.float32), saturated, step, exposure_s,
                       100.0, 4.0, PhotoKind.RAW, "camera", "a.dng", "")


def said(call, *arguments):
    """What is refused, and how; else what comes out."""
    try:
        return call(*arguments)
    except SpectraboxError as error:
        return f"{type(error).__name__}: {error}"


def test_where_the_shape_of_a_photo_is_refused(recorded):
    scene = SimpleNamespace(width=300, height=200, path=SimpleNamespace(name="box.xml"))
    recorded({f"{width} x {height}": said(check_aspect, image(width, height, 1.0), scene, "a.dng")
              for width, height in ((300, 200), (302, 200), (303, 200), (304, 200), (298, 200),
                                    (297, 200), (296, 200), (150, 100), (200, 300))})


def test_where_a_clipped_photo_is_refused(recorded):
    recorded({str(clipped): said(inputs.require_exposed, image(clipped=clipped), "a.dng")
              for clipped in (0, 1199, 1200, 1201, 1240, 2400)})


def test_what_part_of_a_photo_a_picture_shows(recorded):
    photo = image()
    rects = (None, (-0.5, -0.5, 119.5, 79.5), (-0.6, 0, 10, 10), (0, 0, 119.6, 10),
             (0, 0, 10, 79.6), (10, 20, 30, 44), (30, 44, 10, 20), (10.4, 20.6, 30.4, 44.6),
             (9.5, 19.5, 13.5, 23.5), (9.6, 19.5, 13.4, 23.5), (9.5, 19.6, 13.5, 22.4))
    found = {}
    for rect in rects:
        part = said(part_of, photo, rect)
        found[str(rect)] = part if isinstance(part, str) else {
            "rows": (part.rows.start, part.rows.stop), "step": part.step,
            "columns": (part.columns.start, part.columns.stop), "corners": part.corners_px,
            "x": part.x_px, "y": part.y_px, "cut": cut(photo, part).signal.shape}
    recorded(found)


def test_where_curves_and_lights_are_refused(recorded, tmp_path):
    def written(columns, values):
        rows = [",".join(["nm", *columns])] + [
            ",".join(f"{value:.6g}" for value in row)
            for row in np.column_stack([COARSE.nm, values])]
        (tmp_path / "curves.csv").write_text("\n".join(rows), encoding="utf-8")

    reference = SimpleNamespace(file="curves.csv", words="curves.csv", columns=None, column=None,
                                wavelength_column=1, cct=None, word=None)
    config = SimpleNamespace(path=lambda name: tmp_path / name, all_views=[SimpleNamespace(
        photo={"": ("a.dng",)})], sensitivity=SimpleNamespace(source=reference, from_chart=False),
        light=SimpleNamespace(spectrum=reference))
    curves = np.array([np.interp(COARSE.nm, NM, curve) for curve in CURVES]).T
    found = {}
    for low in (0.0, -0.049, -0.051):
        moved = curves.copy()
        moved[3, 2] = low
        written("RGB", moved)
        found[f"curve {low}"] = said(inputs.read_sensitivities, config)
    for values, columns in ((curves[:, :2], "RG"), (-curves, "RGB"), (0 * curves, "RGB"),
                            (2 * curves, "xyz")):
        written(columns, values)
        found[f"{columns} {values.max():.3f}"] = said(inputs.read_sensitivities, config)
    found["names"] = [said(inputs.band_names, config, bands) for bands in (3, 4)]
    config.sensitivity.from_chart = True
    found["of chart"] = [inputs.band_names(config, bands) for bands in (1, 3, 4)]
    config.all_views[0].photo = {"red": ("r.dng",), "blue": ("b.dng",)}
    found["of filters"] = inputs.band_names(config, 2)
    for low in (0.0, -0.0099, -0.0101):
        lamp = np.interp(COARSE.nm, NM, LAMPS[0]) / LAMPS[0].max()
        lamp[7] = low
        written(["value"], lamp[:, None])
        found[f"light {low}"] = said(lambda: inputs.read_light(config).values)
    for word in ("D65", "led", "unknown"):
        light = inputs.read_light(config, SimpleNamespace(cct=None, word=word, file=None))
        found[word] = light.words if not hasattr(light, "values") else light.values
        found[f"{word} on the grid"] = inputs.power_of(light)
        found[f"{word} known"] = said(lambda word=word: inputs.read_known_light(
            config, SimpleNamespace(cct=None, word=word, file=None)).source)
    recorded(found)


def test_where_a_session_has_more_than_one_transport(recorded):
    recorded([said(require_one_transport, photos, traced)
              for photos, traced in ((1, True), (2, True), (1, False), (3, False))])


def test_where_the_glare_of_a_chart_is_certain(recorded):
    """Beyond its limit in standard errors, of the chart photo's mean signal."""
    chart = (None, None, image())

    def found(glare):
        state = SimpleNamespace(glare=np.array([glare, -2 * glare, 0.0]),
                                glare_error=np.full(3, 0.01))
        return _certain_glare(SimpleNamespace(prior_fit=SimpleNamespace(photos=[state])), [chart])

    recorded({str(glare): found(glare) for glare in (0.009, 0.0149, 0.0151, 0.019, 0.0201, 0.0249,
                                                     0.0251, 0.0299, 0.0301, 0.0399, 0.0401)})
    recorded([_certain_glare(first, [chart]) for first in (None, SimpleNamespace(prior_fit=None))],
             case="untold")


def test_whose_scale_a_photo_has(recorded, monkeypatch):
    views = {"first": SimpleNamespace(name="", light="lamp", chart={"": ("c.dng",)},
                                      chart_files=("c.dng",), photo_files=("a.dng",)),
             "alike": SimpleNamespace(name="b", light="lamp", chart={}, chart_files=(),
                                      photo_files=("b.dng",)),
             "own": SimpleNamespace(name="d", light="warm", chart={"": ("d.dng",)},
                                    chart_files=("d.dng",), photo_files=("d.dng",)),
             "other": SimpleNamespace(name="e", light="warm", chart={}, chart_files=(),
                                      photo_files=("e.dng",))}
    charts = {"": (None, None, image(exposure_s=0.05)), "d": (None, None, image(exposure_s=0.04))}
    monkeypatch.setattr(reconstruct_stage, "chart_of", lambda stored, view: charts.get(view.name))
    drift = reconstruct_stage.LightDrift(np.array([1.1, 1.05, 1.0]), np.full(3, 0.01), 1.06, 0.005,
                                         np.array([0.03, 0.0, -0.04]), True, "brighter")
    found = {}
    for source in ("chart", "material"):
        config = SimpleNamespace(all_views=list(views.values()), scale=SimpleNamespace(
            source=source), repeatability=SimpleNamespace(relative_error=0.017))
        for name, each in views.items():
            for change in (None, drift):
                made = reconstruct_stage.scale_of_view(config, each, image(exposure_s=0.013),
                                                       calibration(), {}, change)
                found[f"{source} {name} {'drift' if change else ''}"] = made
        found[f"{source} chart"] = [
            None if (of := reconstruct_stage.view_of_chart(config, each)) is None else of.name
            for each in views.values()]
    unscaled = dataclasses.replace(calibration(), light_scale=None)
    found["unscaled"] = reconstruct_stage.scale_of_view(config, views["first"], image(), unscaled,
                                                        {}, None)
    recorded(found)


def test_what_a_report_warns_of(recorded):
    made = joint()

    def warnings(*, rms=None, off=None, misfits=0, views=3, picture=None, flat="f.dng",
                 source="chart", fitted=True):
        residuals = None if rms is None else rms * np.array([[1.0, -1.0, 1.0]] * 4)
        camera = calibration(0, fitted)
        camera = dataclasses.replace(
            camera, sensitivity=dataclasses.replace(camera.sensitivity, residuals=residuals),
            light_scale=None if source == "none" else camera.light_scale)
        ratio = np.ones((4, 3))
        if off is not None:
            ratio[1] += np.array([0.2, 1.0, -0.1]) * off
        first = dataclasses.replace(
            made.views[0], agreement=dataclasses.replace(made.views[0].agreement, ratio=ratio),
            misfits=tuple(SurfaceMisfit(name, 0.1, f"{name} does not fit") for name in
                          ("white / floor", "red / wall")[:misfits]))
        some = dataclasses.replace(made, views=(first, *made.views[1:])[:views],
                                   names=made.names[:views])
        config = SimpleNamespace(picture=picture, photos=SimpleNamespace(flat=flat),
                                 scale=SimpleNamespace(source=source))
        return assemble._warnings(config, camera, some)

    recorded({
        "chart": {str(rms): warnings(rms=rms) for rms in (0.0295, 0.0305, 0.061)},
        "surface": {str(off): warnings(off=off) for off in (0.049, 0.051, -0.049, -0.051, 0.3)},
        "misfits": [warnings(misfits=2, off=0.3), warnings(misfits=1, views=1),
                    warnings(misfits=2, picture="p")],
        "others": [warnings(flat=None), warnings(source="material"), warnings(source="none"),
                   warnings(fitted=False), warnings(fitted=False, rms=0.01)]})
