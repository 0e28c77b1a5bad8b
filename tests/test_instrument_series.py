"""Repeats: mean, spread, drift; reflectance from two series; nothing measured is lost."""
import dataclasses
import json

import numpy as np
import pytest

from spectrabox.capture.meter.measurement_files import (
    claim,
    note_role,
    read_reading,
    readings_folder,
    result_file,
    set_aside,
    store_reading,
    stored_readings,
)
from spectrabox.capture.meter.measurement_series import (
    read_calibration,
    reflectance_from,
    require_comparable,
    series_of,
    series_spectrum,
    white_standard,
)
from spectrabox.measure import texts
from spectrabox.radiometry.errors import CheckError, EnvironmentProblem, InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading
from spectrabox.session.meters.measuring import Task, write_result

NM = np.arange(380.0, 781.0, 4)


def reading(values, outcome=ReadingOutcome.MEASURED, nm=NM, quantity=Quantity.RADIANCE):
    spectrum = None if values is None else Spectrum(grid_from_nm(nm), values, quantity, "test")
    return SpectralReading(spectrum, outcome, None if values is None else quantity, "PR-655", "1",
                           "3.09", 100.0, 5.0, "2026-01-02T00:00:00+00:00", "t", ())


def test_a_reading_comes_back_from_disk_bit_for_bit(tmp_path):
    values = np.random.default_rng(3).lognormal(size=NM.size)
    path = store_reading(tmp_path / "light", reading(values))
    back = read_reading(path)
    np.testing.assert_array_equal(back.spectrum.values, values)
    np.testing.assert_array_equal(back.spectrum.grid.nm, NM)
    assert (back.instrument, back.integration_ms,
            back.outcome) == ("PR-655", 100.0, ReadingOutcome.MEASURED)


def test_a_reading_without_a_spectrum_is_kept_as_that(tmp_path):
    back = read_reading(store_reading(tmp_path, reading(None, ReadingOutcome.TOO_DARK)))
    assert back.spectrum is None and back.outcome is ReadingOutcome.TOO_DARK


def test_a_broken_write_leaves_no_half_file_behind(tmp_path):
    (tmp_path / ".001.json.abc").write_text("{half")  # what a killed process leaves
    store_reading(tmp_path, reading(np.ones(NM.size)))
    assert len(stored_readings(tmp_path)) == 1


def test_a_damaged_reading_is_named(tmp_path):
    (tmp_path / "001.json").write_text('{"quantity": "radiance"}')
    with pytest.raises(InputError, match=r"001\.json is no reading"):
        stored_readings(tmp_path)


def test_setting_aside_deletes_nothing(tmp_path):
    for _ in range(2):
        store_reading(tmp_path / "light", reading(np.ones(NM.size)))
        aside = set_aside(tmp_path / "light")
        assert len(stored_readings(aside)) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["light.before-1", "light.before-2"]


def test_what_to_beware_of_comes_back_from_disk_and_from_files_of_sentences(tmp_path):
    findings = tuple(Finding(code, Severity.NOTE, values=values) for code, values in (
        ("meter.warning", {"number": 101, "meaning": "low light"}),
        ("meter.negative-values", {"negative": 2, "values": 76}), ("meter.no-luminance", {})))
    path = store_reading(tmp_path, dataclasses.replace(reading(np.ones(NM.size)),
                                                       findings=findings))
    assert read_reading(path).findings == findings
    facts = json.loads(path.read_text())
    facts["findings"][0]["code"] = "meter.unknown"
    path.write_text(json.dumps(facts))
    with pytest.raises(InputError, match="is no reading"):
        read_reading(path)
    del facts["findings"]
    path.write_text(json.dumps(facts | {"flags": ["the lamp was cold"]}))
    quoted, = read_reading(path).findings
    assert texts.says(quoted) == "the lamp was cold"


@pytest.mark.parametrize("outcome", ReadingOutcome)
def test_every_outcome_has_a_text_and_those_without_a_spectrum_a_remedy(outcome):
    assert texts.sentence(outcome.finding)
    assert bool(texts.remedy(outcome.finding)) == (outcome is not ReadingOutcome.MEASURED)
    if not outcome.has_spectrum:
        with pytest.raises(CheckError):
            series_of([reading(None, outcome)], "light")


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(EnvironmentProblem, match="cannot be written"):
        write_text_whole(tmp_path / "file" / "x.json", "")


def test_a_name_that_leaves_the_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="begins with a letter"):
        readings_folder(tmp_path, "../x")


def test_mean_spread_and_drift_are_those_of_the_readings():
    rng = np.random.default_rng(1)
    readings = [reading(np.full(NM.size, 2.0) + rng.normal(0, 0.01, NM.size)) for _ in range(20)]
    series = series_of(readings, "light")
    values = np.array([one.spectrum.values for one in readings])
    # Sums of 20 numbers near 2: round-off of a few eps.
    np.testing.assert_allclose(series.mean, values.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(series.spread, values.std(axis=0, ddof=1), rtol=1e-10)
    assert series.readings == 20 and not series.findings


def test_a_warming_lamp_is_flagged_and_a_steady_one_rarely():
    rng = np.random.default_rng(2)

    def series(drift):
        return series_of([reading(np.full(NM.size, 1.0)
                                  * (1 + drift * i / 9 + rng.normal(0, 0.002)))
                          for i in range(10)],
                         "lamp")
    warm = series(0.05)
    # The slope of ten readings with noise 0.002 has a standard error of 0.002 * 9 / sqrt(82.5) =
    # 0.002: five of them.
    assert warm.relative_drift == pytest.approx(0.05 / 1.025, abs=0.01)
    drift, = warm.findings
    assert (drift.code, drift.values["drift"]) == ("meter.drift", warm.relative_drift)
    # from the first of few readings to the last of them, without noise
    straight = series_of([reading(np.full(NM.size, level)) for level in (0.95, 1.0, 1.05)], "light")
    assert straight.relative_drift == pytest.approx(0.10, rel=1e-9)
    false_alarms = sum(bool(series(0.0).findings) for _ in range(200))
    # Student t with 8 degrees of freedom beyond 3: 1.7 %, of which the 0.5 % floor keeps most; 12
    # of 200 is p < 1e-3.
    assert false_alarms <= 12


def test_one_reading_states_no_spread():
    series = series_of([reading(np.ones(NM.size))], "light")
    assert np.isnan(series.spread).all() and np.isnan(series.relative_drift)
    assert series_spectrum(series, "x").standard_error is None


def test_readings_without_a_spectrum_are_not_averaged_in():
    series = series_of([reading(np.ones(NM.size)), reading(None, ReadingOutcome.TOO_DARK)], "light")
    assert series.readings == 1 and series.mean.max() == 1
    empty, = series.findings
    assert (empty.code, empty.values) == ("meter.readings-empty", {
        "empty": 1, "readings": 2, "outcome": "meter.too-dark"})
    with pytest.raises(CheckError, match="light: no reading, the light is too weak"):
        series_of([reading(None, ReadingOutcome.TOO_DARK)], "light")
    with pytest.raises(CheckError, match="nothing was measured yet"):
        series_of([], "light")


def test_different_quantities_are_not_averaged():
    with pytest.raises(InputError, match="start a new series with --again"):
        series_of([reading(np.ones(NM.size)),
                   reading(np.ones(NM.size), quantity=Quantity.IRRADIANCE)], "x")


def spectrum(values, error=None, nm=NM):
    return Spectrum(grid_from_nm(nm), values, Quantity.RADIANCE, "test", error)


def standard(value, error=0.0):
    return Spectrum(grid_from_nm(NM), value + 0 * NM, Quantity.REFLECTANCE, "test", error + 0 * NM)


def test_reflectance_is_the_ratio_to_the_white_and_does_not_see_the_light():
    truth = 0.2 + 0.5 * (NM > 550)
    for light in (np.ones(NM.size), 1 + np.sin(NM / 30) / 2):
        curve = reflectance_from(spectrum(0.99 * truth / 0.99 * light), spectrum(light),
                                 standard(0.99), "x")
        # a ratio and a product: round-off
        np.testing.assert_allclose(curve.values, 0.99 * truth, rtol=1e-14)
        assert curve.quantity is Quantity.REFLECTANCE


def test_the_reflectances_standard_error_is_that_of_simulated_ratios():
    rng = np.random.default_rng(5)
    target, white = np.full(NM.size, 0.3), np.full(NM.size, 2.0)
    curve = reflectance_from(spectrum(target, 0.003 + 0 * NM), spectrum(white, 0.01 + 0 * NM),
                             standard(1.0), "x")
    ratios = rng.normal(0.3, 0.003, 200_000) / rng.normal(2.0, 0.01, 200_000)
    # 200 000 draws give the spread to 0.16 %; first-order propagation leaves out terms of (0.5 %)
    # squared: 1 %.
    np.testing.assert_allclose(curve.standard_error, ratios.std(), rtol=0.01)


def test_the_error_of_the_white_standard_is_in_every_wavelength():
    target, white = np.linspace(0.1, 1.5, NM.size), np.full(NM.size, 2.0)
    curve = reflectance_from(spectrum(target, 0 * NM), spectrum(white, 0 * NM),
                             standard(0.98, 0.01), "x")
    # the surface's error is relative to its own reflectance
    np.testing.assert_allclose(curve.standard_error / curve.values, 0.01 / 0.98, rtol=1e-12)


@pytest.mark.parametrize("word, value, error", [
    (None, 0.99, 0.005), ("ptfe", 0.99, 0.005), ("Barium Sulphate", 0.975, 0.01),
    ("0.985", 0.985, 0), ("98.5% +- 0.5%", 0.985, 0.005)])
def test_a_white_standard_by_name_or_number(word, value, error):
    white = white_standard(word)
    np.testing.assert_allclose(white.values, value)
    np.testing.assert_allclose(white.standard_error, error)


def test_a_white_standard_of_a_certificate(tmp_path):
    file = tmp_path / "certificate.csv"
    file.write_text("# quantity: reflectance\nwavelength_nm,value,standard_error\n"
                    "380,0.95,0.01\n580,0.99,0.004\n780,0.98,0.004\n")
    curve = reflectance_from(spectrum(1 + 0 * NM, 0 * NM), spectrum(1 + 0 * NM, 0 * NM),
                             white_standard(str(file)), "x")
    np.testing.assert_allclose(curve.values, np.interp(NM, [380, 580, 780], [0.95, 0.99, 0.98]),
                               atol=1e-9)
    np.testing.assert_allclose(curve.standard_error,
                               np.interp(NM, [380, 580, 780], [0.01, 0.004, 0.004]), atol=1e-9)
    for wrong in ("tile", "12", "0.9+-0.8"):
        with pytest.raises(InputError, match="PTFE"):
            white_standard(wrong)


def test_a_light_without_blue_cannot_give_a_reflectance_there():
    light = np.where(NM < 450, 1e-4, 1.0)
    with pytest.raises(CheckError, match="almost no light at 400 nm"):
        reflectance_from(spectrum(light), spectrum(light), standard(1.0), "x")
    beyond = np.where(NM > 720, 1e-4, 1.0)
    curve = reflectance_from(spectrum(beyond), spectrum(beyond), standard(1.0), "x")
    assert curve.grid.nm[-1] == 720


def by(serial_number, values, model="PR-655"):
    return dataclasses.replace(reading(values), serial_number=serial_number, instrument=model)


def calibration(serial_number, factor, error=None, nm=NM):
    return serial_number, Spectrum(grid_from_nm(nm), np.full(nm.size, factor), Quantity.RELATIVE,
                                   "test", None if error is None else np.full(nm.size, error))


@pytest.mark.parametrize("other", [("2", "PR-655"), ("1", "PR-670")])
def test_readings_of_two_instruments_are_not_averaged(other):
    ones = np.ones(NM.size)
    readings = [by("1", ones), by("1", ones), by(other[0], 1.1 * ones, other[1])]
    with pytest.raises(InputError, match=rf"light: read by PR-655 1 and {other[1]} {other[0]}, and "
                                         r"their calibrations differ.*--again.*--calibration"):
        series_of(readings, "light")
    with pytest.raises(InputError, match="their calibrations differ"):
        series_of(readings, "light", [calibration("1", 1.0)])


def test_a_dark_reading_by_another_instrument_is_no_reading_by_it():
    dark = dataclasses.replace(reading(None, ReadingOutcome.TOO_DARK), serial_number="2")
    assert series_of([by("1", np.ones(NM.size)), dark], "light").readings == 1


def test_the_mean_of_two_calibrated_instruments_is_that_of_the_standard():
    truth = 1 + 0.3 * np.sin(NM / 40)
    # Each reads the truth over its factor: 5 % high and 4 % low.
    readings = [by("1", truth / 0.95), by("2", truth / 1.04), by("1", truth / 0.95)]
    series = series_of(readings, "light", [calibration("1", 0.95), calibration("2", 1.04)])
    # products and quotients: round-off
    np.testing.assert_allclose(series.mean, truth, rtol=1e-14)
    np.testing.assert_allclose(series.spread, 0, atol=1e-14)


def test_the_error_of_a_calibration_is_shared_by_the_readings_of_its_instrument():
    rng = np.random.default_rng(8)
    draws = 100_000
    # Three readings by one instrument with a factor of 1 +- 0.02, one by another with 1 +- 0.03.
    means = (3 * rng.normal(1, 0.02, draws) + rng.normal(1, 0.03, draws)) / 4
    ones = np.ones(NM.size)
    series = series_of([by("1", ones)] * 3 + [by("2", ones)], "light",
                       [calibration("1", 1.0, 0.02), calibration("2", 1.0, 0.03)])
    error = series_spectrum(series, "x").standard_error
    # 100 000 draws give the spread to 0.22 %: four of these.
    np.testing.assert_allclose(error, means.std(), rtol=0.009)


def test_a_calibration_must_cover_the_readings_and_belong_to_one():
    ones = np.ones(NM.size)
    short = [calibration("1", 1.0, nm=np.arange(400.0, 701.0)), calibration("2", 1.0)]
    with pytest.raises(InputError, match=r"calibration of 1 covers 400-700 nm; .* 380-780 nm"):
        series_of([by("1", ones), by("2", ones)], "light", short)
    with pytest.raises(InputError, match="a calibration for 3, but readings by PR-655 1 only"):
        require_comparable([("PR-655", "1")], [calibration("3", 1.0)], "light")


@pytest.mark.parametrize("text, body, message", [
    ("65123456", None, "is not SERIAL=FILE"),
    ("1={file}", "# quantity: radiance\nnm,value\n380,1\n780,1\n", "states radiance; .* factors"),
    ("1={file}", "# quantity: relative\nnm,value\n380,100\n780,90\n", "factors from 90 to 100")])
def test_what_is_no_calibration_is_refused(tmp_path, text, body, message):
    file = tmp_path / "c.csv"
    file.write_text(body or "")
    with pytest.raises(InputError, match=message):
        read_calibration(text.format(file=file))


def test_a_calibration_is_read_with_its_error(tmp_path):
    file = tmp_path / "c.csv"
    file.write_text("# quantity: relative\nnm,value,standard_error\n380,1.02,0.01\n780,0.98,0.01\n")
    serial_number, factor = read_calibration(f"65123456={file}")
    assert serial_number == "65123456" and factor.standard_error[0] == 0.01


CSV = "# quantity: {}\nwavelength_nm,value\n380,0.5\n780,0.5\n"


@pytest.mark.parametrize("role, name", [
    ("paint", "light"), ("paint", "white"), ("light", "white"), ("paint", "Light"),
    ("paint", "chart"), ("light", "chart-01-dark-skin"), ("paint", "chart-radiance")])
def test_the_name_of_one_role_is_not_anothers(tmp_path, role, name):
    with pytest.raises(InputError, match=f"as {role}, give it another with --name"):
        claim(tmp_path, role, [name])


def test_a_name_keeps_the_role_that_it_was_measured_in(tmp_path):
    claim(tmp_path, "light", ["warm"])
    note_role(tmp_path, "light", "warm")
    claim(tmp_path, "light", ["warm"])
    with pytest.raises(InputError, match="something measured as light; as paint"):
        claim(tmp_path, "paint", ["warm"])
    store_reading(tmp_path / "readings" / "warm", reading(np.ones(NM.size)))
    assert len(stored_readings(tmp_path / "readings" / "warm")) == 1


@pytest.mark.parametrize("role, names, white, file", [
    ("light", ["light"], False, "light.csv"), ("paint", ["red"], True, "red.csv"),
    ("paint", ["red"], False, "red-radiance.csv"), ("chart", ["chart-01-x"], True, "chart.csv"),
    ("chart", ["chart-01-x"], False, "chart-radiance.csv")])
def test_a_file_that_was_not_measured_here_is_never_replaced(tmp_path, role, names, white, file):
    if white:
        (tmp_path / "readings" / "white").mkdir(parents=True)
    (tmp_path / file).write_text(CSV.format("reflectance"))
    with pytest.raises(InputError, match=rf"{file} was not measured here and would be replaced"):
        claim(tmp_path, role, names)
    # with readings under that name it is this tool's own, even when they were set aside
    folder = tmp_path / "readings" / names[0]
    folder.mkdir(parents=True)
    claim(tmp_path, role, names)
    set_aside(folder)
    claim(tmp_path, role, names)


def test_a_file_of_another_quantity_is_never_replaced(tmp_path):
    path = tmp_path / "red.csv"
    for held in (CSV.format("radiance"), "380,1\n780,1\n"):
        path.write_text(held)
        with pytest.raises(InputError, match=r"red\.csv holds .*reflectance must not replace"):
            result_file(tmp_path, "paint", "red", Quantity.REFLECTANCE)
    path.write_text(CSV.format("reflectance"))
    assert result_file(tmp_path, "paint", "red", Quantity.REFLECTANCE) == path
    assert result_file(tmp_path, "paint", "red",
                       Quantity.RADIANCE) == tmp_path / "red-radiance.csv"


def test_a_white_read_by_another_instrument_is_brought_to_the_standard_first(tmp_path):
    """The paint reflects .4: one instrument reads it 5 % high, another the white 4 % low."""
    standard_reflects, lamp = 0.98, 1 + 0.3 * np.sin(NM / 40)
    store_reading(readings_folder(tmp_path, "white"), by("1", standard_reflects * lamp / 1.04))
    store_reading(readings_folder(tmp_path, "red"), by("2", 0.4 * lamp / 0.95))
    task = Task(tmp_path, "paint", ("red",), 1, False, False)
    _, result = write_result(task, [calibration("1", 1.04), calibration("2", 0.95)],
                             standard(standard_reflects))
    np.testing.assert_allclose(result.values, 0.4, rtol=1e-12)
