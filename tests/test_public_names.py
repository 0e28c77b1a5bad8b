"""The public names of ``spectrabox``: what a notebook calls says what the commands say."""
import json
import subprocess
import sys
from fractions import Fraction

import matplotlib as mpl
import numpy as np
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.api.arguments import relative_response
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM, PIGMENTS
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.session.cli import app

mpl.use("Agg")


def answer(*arguments):
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code in (0, 4), done.output    # 4: the photo is to be taken again
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def folder(_captured):
    return _captured


def test_importing_spectrabox_imports_nothing_heavy():
    heavy = "{'numpy', 'scipy', 'matplotlib', 'mitsuba', 'cv2', 'colour', 'pydantic'}"
    code = f"import sys, spectrabox; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_every_public_name_is_there_and_has_a_docstring():
    for name in sb.__all__:
        assert len(getattr(sb, name).__doc__) > 40, name


def test_a_chart_is_found_as_the_command_finds_it(folder):
    photo = sb.open_photo(folder / "photos" / "chart.dng")
    chart = sb.find_chart(photo)
    said = answer("chart", folder / "photos" / "chart.dng")
    assert chart.verdict == said["verdict"] and list(chart.reasons) == said["reasons"]
    np.testing.assert_array_equal(chart.corners, said["corners_px"])
    np.testing.assert_array_equal(chart.samples.mean, said["mean"])
    assert "3 bands" in repr(photo) and said["camera"] in repr(photo)
    assert len(chart.plot().lines) == 2 * len(chart.corners)


def test_curves_of_a_camera_that_were_written_are_those_that_were_fitted(folder, tmp_path):
    chart, light = folder / "photos" / "chart.dng", folder / "spectra" / "light.csv"
    camera = sb.fit_camera(chart, light=light)
    written = camera.to_csv(tmp_path / "camera.csv")
    again = sb.uplift(np.full((2, 2, 3), 0.3), camera=written, light=light)
    own = sb.uplift(np.full((2, 2, 3), 0.3), camera=camera, light=light)
    # seven digits of the curves are written
    np.testing.assert_allclose(again, own, rtol=0, atol=1e-4)
    assert "<svg" in camera._repr_html_() and camera.plot().get_xlabel() == "Wavelength (nm)"


def test_errors_are_the_sentences_of_the_commands(tmp_path):
    with pytest.raises(sb.InputError, match=r"nearest are Nikon 5100 \(NPL\)"):
        sb.uplift(np.zeros((2, 2, 3)), camera="Nikom 5100", light="D65")
    write_photo(tmp_path / "dark.dng", np.full((40, 60, 3), 0.01), Fraction(1, 100),
                np.random.default_rng(1))
    with pytest.raises(sb.ChartNotFoundError):
        sb.find_chart(tmp_path / "dark.dng")


def test_every_draw_of_a_signal_gives_it():
    camera, light, signal = "Nikon 5100 (NPL)", "D65", [0.53, 0.24, 0.08]
    one = sb.sample(signal, camera=camera, light=light, noise=0.003, draws=2000, seed=1)
    # within its noise: five standard errors
    response = relative_response(camera, light)
    seen = np.array([np.interp(FINE_GRID.nm, one.nm, draw) for draw in one.draws(500, seed=3)]) \
        @ response.T
    assert np.abs(seen - signal).max() < 5 * 0.003
    assert sum(one.causes.values()) == pytest.approx(1)


def test_a_colour_carries_the_scatter_of_the_draws():
    narrow, wide = (sb.sample([0.5, 0.5, 0.5], camera="Nikon 5100 (NPL)", light="D65", noise=noise)
                    for noise in (0.001, 0.02))
    lightness = [one.lab().standard_error[0] for one in (narrow, wide)]
    # a neutral of half the light of white has L* 76, which 1 % of white moves by 0.5
    assert narrow.lab().value[0] == pytest.approx(76.1, abs=0.5)
    assert lightness[0] < 0.25 * lightness[1] and lightness[1] == pytest.approx(0.9, abs=0.35)
    same = wide.delta_e(wide.mean)
    assert same.value == 0 and same.standard_error > 0


def test_two_surfaces_err_independently_in_their_colour_difference():
    pair = sb.sample([[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]], camera="Nikon 5100 (NPL)", light="D65",
                     noise=0.02)
    # draws of equal seeds would differ by nothing, and the difference would seem certain
    assert pair[0].delta_e(pair[1]).standard_error > 0.4 * pair[0].lab().standard_error[0]


def test_estimates_become_labelled_arrays_and_spectral_distributions():
    many = sb.sample([[0.5, 0.4, 0.3], [0.2, 0.3, 0.4]], camera="Nikon 5100 (NPL)", light="D65",
                     noise=0.01, names=["warm", "cool"])
    data = many.to_xarray(draws=5)
    assert data["draws"].dims == ("surface", "draw", "wavelength")
    assert data.wavelength.attrs["units"] == "nm"
    np.testing.assert_array_equal(data["mean"].sel(surface="cool"), many["cool"].mean)
    assert many["warm"].to_colour()[500] == pytest.approx(float(many["warm"].mean[20]))
    assert "warm" in many._repr_html_() and "2 surfaces" in repr(many)
    with pytest.raises(KeyError, match="there are warm, cool"):
        many["hot"]


def test_names_in_a_notebook_are_escaped():
    one = sb.sample([[0.5, 0.4, 0.3]], camera="Nikon 5100 (NPL)", light="D65", noise=0.01,
                    names=["<script>alert(1)</script>"])
    assert "<script>" not in one._repr_html_()


def test_a_session_gives_the_spectra_of_its_report(finished):
    session = sb.Session(finished)
    before = {path: path.stat().st_mtime_ns for path in finished.rglob("*") if path.is_file()}
    assert session.verdict in ("pass", "warn", "fail") and isinstance(session.warnings, list)
    assert {path: path.stat().st_mtime_ns for path in finished.rglob("*") if path.is_file()} \
        == before       # who reads a verdict has not asked for files
    said = json.loads((CliRunner().invoke(app, ["run", str(finished), "--json"])).stdout)
    assert session.verdict == said["verdict"]
    table = np.genfromtxt(finished / "spectra.csv", delimiter=",", names=True, comments="#",
                          deletechars="")
    unknown = [name for name in session if session[name].given is None]
    for name in unknown:
        column = next(each for each in table.dtype.names if name in each and "mean" in each)
        # the table holds six digits
        np.testing.assert_allclose(session[name].mean, table[column], atol=1e-5)
    assert set(session[unknown[0]].causes) >= {"metamerism", "sensitivities"}


def test_a_signal_matches_its_own_mean():
    nm = np.arange(400, 701, 5.0)
    found = sb.match([0.53, 0.24, 0.08], {"flat": np.full(61, 0.3), "itself": sb.sample(
        [0.53, 0.24, 0.08], camera="Nikon 5100 (NPL)", light="D65", noise=0.01).mean}, nm=nm,
        camera="Nikon 5100 (NPL)", light="D65", noise=0.01)
    assert found.names[0] == "itself" and found.indistinguishable == 1


def test_without_any_scale_the_strength_of_the_light_is_estimated_with_its_error(finished):
    photos, spectra, scenes = (finished / name for name in ("photos", "spectra", "scene"))
    light, materials = spectra / "light.csv", list(sb.Session(finished))
    camera = sb.fit_camera(photos / "chart.dng", light=light)
    found = sb.reconstruct_scene(photos / "box.dng", scene=scenes / "box.xml", camera=camera,
                                 light=light, materials=materials, width=40, draws=1000)
    assert list(found) == materials and found.plot_agreement().images and found.outcome
    session = sb.Session(finished)
    scale = found.reconstruction.views[0].light_scale
    assert 0.1 < scale.standard_error / scale.value < 0.6
    for name in materials:      # wider than with a known light, and it holds what that gave
        assert found[name].band_width > session[name].band_width
        lower, upper = found[name].bounds()
        assert np.mean((session[name].mean >= lower) & (session[name].mean <= upper)) > 0.9


@pytest.fixture(scope="module")
def demos(finished_painting):
    """A folder with ``painting``, as the demo command writes it."""
    return finished_painting.parent


def test_a_photo_goes_to_spectra_and_colours_in_a_few_lines(demos, monkeypatch):
    monkeypatch.chdir(demos)
    photo = sb.open_photo("painting/photos/painting.dng")
    assert repr(photo) == ("<Photo painting.dng: Spectrabox Synthetic 5100 FLAT-1, 1248 x 832 "
                           "pixels, 3 bands, 0.03333 s>")
    chart = sb.find_chart(photo)
    assert (chart.verdict, chart.reasons) == ("good", ()) and chart.corners.shape == (24, 4, 2)
    chart.plot()
    result = sb.flat(photo, {"wall": (986, 462, 1073, 537), "sun": (1038, 158, 1096, 216)},
                     light="unknown", families={"wall": "paint"})
    wall, other = result["wall"], result["sun"]
    truth = np.interp(wall.nm, NM, PIGMENTS["vermilion"])
    (lower, upper), (lowest, highest) = wall.band(0.95), wall.bounds()
    # one spectrum: errors at its wavelengths are not independent, so not 95 % of them
    assert np.mean((lower <= truth) & (truth <= upper)) > 0.8
    assert np.all((lowest <= lower + 1e-6) & (upper <= highest + 1e-6))
    draws = wall.draws(4000, seed=1)
    # of 4000 draws the mean has a 63rd of their spread as its error: four of these
    np.testing.assert_array_less(np.abs(draws.mean(axis=0) - wall.mean),
                                 4 / 63 * wall.standard_deviation + 1e-3)
    assert draws.shape == (4000, wall.nm.size)
    assert wall.lab("D65").value.shape == (3,) and wall.delta_e(other, "A").value > 20
    assert set(wall.causes) >= {"metamerism", "light over the picture", "photo noise"}
    assert "paint, as stated" in wall.outcome and 400 <= wall.next_reading_nm <= 700
    assert wall.plot().get_title() == "wall" and result.plot().lines
    # nothing shows a fault; the light far from the chart is in the bands
    assert result.verdict == "pass" and result.reasons and wall.band_width > 0.1
    assert result.calibration.sensitivity.curves.shape == (3, 301)
    lines = result.to_csv("spectra.csv").read_text(encoding="utf-8").splitlines()
    table = [line for line in lines if not line.startswith("#")]
    assert table[0].startswith("wavelength_nm,wall mean,wall standard_deviation,wall lower")
    # six digits are written
    np.testing.assert_allclose([float(line.split(",")[1]) for line in table[1:]], wall.mean,
                               atol=1e-5)
    assert dict(result.to_xarray().sizes) == {"surface": 2, "wavelength": wall.nm.size}


def test_a_session_is_checked_run_and_read(finished):
    session = sb.Session(finished)
    session.check()
    session.run()
    assert session.verdict in ("pass", "warn", "fail") and session["cube"].plot().lines
    assert session.report.stat().st_size > 10_000


def test_a_session_that_another_process_ran_again_is_read_again(finished):
    session = sb.Session(finished)
    before = session["cube"].draws(50, seed=1)
    lamp = finished / "spectra" / "light.csv"
    kept = lamp.rename(lamp.with_suffix(".kept"))
    np.testing.assert_array_equal(session["cube"].draws(50, seed=1), before)    # no input is read
    kept.rename(lamp)
    settings = finished / "session.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text(text.replace("draws = 1000", "draws = 1100"), encoding="utf-8")
    sb.Session(finished).run()
    assert len(session.spectra.records.spectra["cube"].samples.spectra) == 1100


def test_an_image_without_pixels_is_refused():
    with pytest.raises(sb.InputError, match=r"shape \(0, 5, 3\)"):
        sb.uplift(np.zeros((0, 5, 3)), camera="Nikon 5100 (NPL)", light="D65")


def test_a_region_of_a_photo_is_read_in_the_pixels_of_its_axes(demos, monkeypatch):
    monkeypatch.chdir(demos)
    photo = sb.open_photo("painting/photos/painting.dng")
    rect = (986, 462, 1073, 537)
    mean, error = photo.mean(rect), photo.standard_error(rect)
    step = photo.image.sensor_step      # one entry of ``signal`` for each 2 x 2 cell
    assert step == 2
    x0, y0, x1, y1 = (round(at / step) for at in rect)
    inside = photo.signal[y0:y1, x0:x1].reshape(-1, 3)
    np.testing.assert_allclose(mean, inside.mean(axis=0), rtol=0.01)
    # by the noise of its pixels: a plane is taken off, so this is at most the pixels' own scatter
    assert np.all((error > 0) & (error < 1.2 * inside.std(axis=0) / np.sqrt(len(inside))))
    np.testing.assert_allclose(photo.mean([(986, 462), (1073, 462), (1073, 537), (986, 537)]), mean,
                               rtol=1e-6)
    with pytest.raises(sb.InputError, match="x0, y0, x1, y1"):
        photo.mean((1, 2, 3))
    with pytest.raises(sb.InputError):
        photo.mean((0, 0, 5000, 5000))


def test_a_colour_of_a_screen_comes_back_in_every_form():
    orange = sb.sample(srgb="#e08030")
    np.testing.assert_allclose(255 * orange.srgb, [0xe0, 0x80, 0x30], atol=1.5)
    same = sb.sample(srgb=[0xe0, 0x80, 0x30])
    np.testing.assert_array_equal(same.mean, orange.mean)
    exact = sb.sample(srgb=np.array([0xe0, 0x80, 0x30]) / 255)
    np.testing.assert_allclose(exact.mean, orange.mean, atol=0.02)
    # integers are known to half a step
    assert np.all(orange.measurement.noise_covariance.diagonal() > 0)
    many = sb.sample(srgb=[[224, 128, 48], [30, 60, 90]])
    assert len(many) == 2
    for wrong in ("#e0803", [1.5, 0.2, 0.1], [300, 1, 1], [0.1, 0.2]):
        with pytest.raises(sb.InputError, match="srgb"):
            sb.sample(srgb=wrong)
    with pytest.raises(sb.InputError, match="D65"):
        sb.sample(srgb="#e08030", light="A")
    with pytest.raises(sb.InputError, match="one of"):
        sb.sample(srgb="#e08030", lab=[50, 0, 0])


def test_every_name_that_is_listed_is_taken():
    assert {"Nikon D810", "Nikon 5100 (NPL)"} <= set(sb.cameras())
    for name in sb.cameras():
        assert sb.camera(name).name == name
    assert {"D65", "A", "halogen", "unknown"} <= set(sb.lights())
    from spectrabox.api.arguments import as_light
    for name in sb.lights():
        as_light(name)


def test_plots_are_drawn_into_given_axes():
    from matplotlib.figure import Figure
    ax = Figure().subplots()
    estimate = sb.sample(srgb="#808080")
    assert estimate.plot(ax=ax) is ax
    assert sb.camera("Nikon D810").plot(ax=ax) is ax


def test_a_mean_is_a_spectrum_of_mitsuba(mitsuba):
    estimate = sb.sample(srgb="#e08030")
    spectrum = mitsuba.load_dict(estimate.to_mitsuba())
    interaction = mitsuba.SurfaceInteraction3f()
    for nm in (380, 400, 555, 700, 800):
        interaction.wavelengths = [nm] * len(interaction.wavelengths)
        assert np.ravel(spectrum.eval(interaction))[0] == pytest.approx(
            np.interp(nm, estimate.nm, estimate.mean), abs=1e-4)
    mitsuba.load_dict({"type": "diffuse", "reflectance": estimate.to_mitsuba()})


def test_a_camera_is_fitted_to_patches_as_to_their_photo(demos, monkeypatch, tmp_path):
    monkeypatch.chdir(demos)
    chart = sb.find_chart("painting/photos/painting.dng")
    camera = sb.fit_camera("painting/photos/painting.dng", light="unknown")
    errors = chart.standard_error
    same = sb.fit_camera(patches=chart.mean, patch_errors=errors, light="unknown")
    # a photo tells the covariance of its bands' noise as well
    np.testing.assert_allclose(same.curves, camera.curves, atol=1e-3)
    table = sb.fit_camera(patches=chart.to_csv(tmp_path / "patches.csv"), light="unknown")
    np.testing.assert_allclose(table.curves, camera.curves, atol=1e-3)
    assumed = sb.fit_camera(patches=60 * chart.mean, light="unknown")   # whatever the unit
    assert "patches.errors-assumed" in {one.code for one in assumed.findings}
    assert "patches.errors-assumed" not in {one.code for one in same.findings}
    np.testing.assert_allclose(assumed.curves, camera.curves, atol=0.05)
    for wrong in (chart.mean[:5], chart.mean[0], np.full((24, 3), np.nan)):
        with pytest.raises(sb.InputError, match=r"\(24, K\)"):
            sb.fit_camera(patches=wrong, light="D65")
    with pytest.raises(sb.InputError, match="either"):
        sb.fit_camera("painting/photos/painting.dng", patches=chart.mean, light="D65")


def test_a_program_renders_on_with_the_threads_that_it_had(mitsuba, captured, tmp_path):
    import drjit
    before = drjit.thread_count()
    drjit.set_thread_count(2)
    try:
        sb.Session(captured).run()
        assert drjit.thread_count() == 2
        # with one thread this would wait for ever
        mitsuba.Bitmap(np.zeros((4, 4, 3), np.float32)).write(str(tmp_path / "black.exr"))
    finally:
        drjit.set_thread_count(before)


def test_each_of_several_rounded_colours_errs_by_its_own_rounding_at_least():
    """Beside others a colour is not known better than alone."""
    codes = np.array([[16, 20, 24], [240, 244, 248]], np.uint8)
    for code, beside in zip(codes, sb.sample(srgb=codes).values(), strict=True):
        alone = np.sqrt(np.diag(sb.sample(srgb=code).measurement.noise_covariance))
        assert np.all(np.sqrt(np.diag(beside.measurement.noise_covariance)) >= 0.999 * alone)
