"""A flat session of photos under five LED lamps, thirteen bands, from photos to advice."""
import json
from fractions import Fraction

import numpy as np
import pytest
from flat_example import light_over
from session_runs import call, run

from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import box, chart_corners, surface_signals, write_photo
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.radiometry.chart import PATCH_NAMES
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.named_spectra import test_reflectances as published
from spectrabox.radiometry.spectra.spectrum_files import table_text

SIZE, LAMPS_NM, WIDTH_NM = (320, 480), (430, 490, 550, 610, 670), 30
SAMPLES = ("c3", "c7", "c11")           # what is measured of them


def write_session(folder):
    """Twelve colours beside a chart; at 550 nm white is clipped in green, at 610 nm much in red."""
    for name in ("photos", "spectra"):
        (folder / name).mkdir()
    colours = np.array([np.interp(NM, FINE_GRID.nm, colour)
                        for colour in published(FINE_GRID)["CES99"][::8][:12]])
    corners = [(0.56 + 0.11 * (index % 4), 0.04 + 0.2 * (index // 4)) for index in range(12)]
    areas = [(box(x, y, x + 0.09, y + 0.16), colour)
             for (x, y), colour in zip(corners, colours, strict=True)]
    # samples lie two charts away from theirs, where its patches' own errors would tilt the light:
    # somebody has measured it
    chart = chart_copy(np.random.default_rng(1))
    (folder / "spectra" / "chart.csv").write_text(
        table_text(NM, dict(zip(PATCH_NAMES, chart, strict=True)), quantity=Quantity.REFLECTANCE,
                   source="this chart"), encoding="utf-8")
    for number, centre in enumerate(LAMPS_NM):
        lamp = np.exp(-0.5 * ((NM - centre) / WIDTH_NM) ** 2)
        light = surface_signals(SIZE, camera_sensitivities() * lamp, chart,
                                chart_corners(0.06, 0.08, 0.45), areas, np.full(NM.size, 0.2))
        write_photo(folder / "photos" / f"{centre}.dng", light * light_over(SIZE)[..., None],
                    Fraction(1, 60), np.random.default_rng(number),
                    brightest={550: 1.3, 610: 2.0}.get(centre, 0.8))
    names = [f"c{index}" for index in range(12)]
    (folder / "spectra" / "c.csv").write_text(
        table_text(NM, dict(zip(names, colours, strict=True)), quantity=Quantity.REFLECTANCE,
                   source="CES99"), encoding="utf-8")
    table = ", ".join(f'"{centre}" = "photos/{centre}.dng"' for centre in LAMPS_NM)
    lines = [f'[photos]\nobject = {{ {table} }}\n[chart]\nreference = "spectra/chart.csv"\n'
             '[light]\nspectrum = "unknown"\n[sampling]\n'
             'draws = 1000\n[picture]\nrect = [275, 30, 300, 100]']
    for name, (x, y) in zip(names, corners, strict=True):
        if name not in SAMPLES:
            continue
        rect = [round(480 * at) for at in (x + 0.015, y + 0.03, x + 0.075, y + 0.13)]
        lines.append(f'[regions.{name}]\nrect = {rect}\n'
                     f'truth = {{ file = "spectra/c.csv", column = "{name}" }}')
    (folder / "session.toml").write_text("\n".join(lines), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = write_session(tmp_path_factory.mktemp("lamps"))
    return folder, run(folder).records


def test_what_is_clipped_drops_out_band_by_band_and_is_named(finished):
    _, records = finished
    assert len(records.photo.bands) == 13
    findings = records.calibrate.calibrations[""].findings
    found = {one.code: one.values for one in findings}
    clipped = {one.values["patch"]: one.values["bands"] for one in findings
               if one.code == "calibration.patch-clipped"}
    assert clipped["white 9.5"] == ["550 G", "610 R"]
    assert not any("glare" in one.code for one in findings)
    # chart and model agree within 1 %
    colours = found["calibration.chart-colours"]
    assert colours["mean"] < colours["left_out"] < 1


def test_pixels_have_spectra_from_the_bands_that_are_not_lost(finished):
    _, records = finished
    # much of the picture is saturated in 610 R, which would mask it
    assert records.picture.masked < 0.05
    silent = np.isnan(records.signals.signal).all(axis=0)
    assert [records.signals.bands[band] for band in np.flatnonzero(silent)] == ["610 R"]
    lost, = (one for one in records.charts[""].of_files if one.code == "chart.bands-lost")
    assert lost.values["bands"] == ["610 R"]


def test_spectra_of_many_bands_hold(finished):
    _, records = finished
    held = []
    for index, name in zip((3, 7, 11), SAMPLES, strict=True):
        truth = published(FINE_GRID)["CES99"][8 * index]
        summary = records.spectra[name]
        held.append((summary.lower <= truth) & (truth <= summary.upper))
        assert np.sqrt(np.mean((summary.mean - truth)[30:-30] ** 2)) < 0.04     # where lamps shine
    # about six independent readings of each: 95 % less 3 standard errors
    assert np.mean(held) > 0.8


def test_after_many_bands_a_reading_still_brings_something(finished):
    folder, _ = finished
    facts = json.loads(call("advise", folder, "--json").stdout)
    assert "reading" in {one["action"] for one in facts["overall"]}


def test_the_report_shows_no_light_by_itself_and_finds_no_measured_camera_in_it(finished):
    folder, _ = finished
    call("run", folder, "--device", "cpu")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Products of sensitivity and light" in page and "Spectrum of the light" not in page
    assert "Stated light against the chart" not in page and "like that of measured" not in page
