"""A spectrum is held against all that the instrument computed from it."""
import dataclasses
import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from spectrabox.capture.meter.instruments.instrument_errors import UntrustedReadingError
from spectrabox.capture.meter.stated import (
    Stated,
    check_stated,
    mean_wavelength,
    printed,
    stated_by_xyz,
)
from spectrabox.fixtures.meter_transcripts import NO_FAULT, SPECTRUM_FAULTS, faulty_meters, lamp
from spectrabox.radiometry.published.published_tables import LIGHTS, OBSERVERS, published_curves

from tests.transcript_trials import spectrum_trial

FINE_NM = np.arange(380.0, 781.0)
INSTRUMENTS = {"cs2000": (1, 5), "cr250": (2, 5), "pr655": (4, 8)}      # step and bandwidth, nm
# Continuous, with lines, of narrow bands: what instruments are pointed at.
LIGHT_NAMES = ["A", "D65", "FL2", "FL11", "LED-B3", "LED-RGB1", "HP1", "HP5", "Mercury", "LPS"]


@pytest.mark.parametrize("fault", (NO_FAULT, *SPECTRUM_FAULTS), ids=lambda fault: fault.name)
def test_a_spectrum_that_is_not_the_one_computed_with_is_refused_where_replies_show_it(fault):
    with ThreadPoolExecutor(6) as pool:      # they mostly wait for their lines
        trials = list(pool.map(lambda meter: spectrum_trial(meter, fault), faulty_meters(fault)))
    unseen = {trial.instrument for trial in trials if trial.wrong}
    assert unseen == set(fault.unseen_by)
    refusals = [trial for trial in trials if trial.result != "spectrum"]
    assert {trial.result for trial in refusals} <= {"UntrustedReadingError"}
    assert len(refusals) == (0 if fault is NO_FAULT else 6 - len(unseen))


def seen_by(name, light):
    """What an instrument with a band of its own width sends, and the figures it computes from all
    that it sees.
    """
    step, width = INSTRUMENTS[name]
    nm, curves = published_curves(LIGHTS, light)
    band = np.clip(1 - np.abs(FINE_NM[:, None] - FINE_NM) / width, 0, None)
    values = band @ np.interp(FINE_NM, nm, curves[0], left=0, right=0) / band.sum(axis=1)
    values *= 1e-2 / values.max()
    observer_nm, observer = published_curves(OBSERVERS, "CIE 1931 2 Degree Standard Observer")
    x, y, z = 683 * np.array([np.interp(FINE_NM, observer_nm, bar) @ values for bar in observer])
    power = f"{values.sum():.3e}"
    # c / lambda = f, E = h f
    photons = f"{(values * FINE_NM * 1e-9).sum() / (6.62607015e-34 * 299792458):.3e}"
    stated = stated_by_xyz([f"{value:.3e}" for value in (x, y, z)], printed(power),
                           mean_wavelength(printed(power), printed(photons)))
    sent = np.array([float(f"{value:.3e}") for value in values[::step]])
    return FINE_NM[::step], sent, stated


@pytest.mark.parametrize("name, light", list(itertools.product(INSTRUMENTS, LIGHT_NAMES)))
def test_what_an_instrument_computed_in_finer_steps_than_it_sends_is_accepted(name, light):
    check_stated(*seen_by(name, light), "port")


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_shift_by_one_channel_shows_under_any_light_but_a_filament_seen_in_steps_of_1_nm(name):
    accepted = []
    for light, shift in itertools.product(LIGHT_NAMES, (1, -1)):
        nm, values, stated = seen_by(name, light)
        if name != "cr250":     # the others state no photons
            stated = dataclasses.replace(stated, mean_nm=None)
        shifted = np.roll(values, shift)
        shifted[0 if shift > 0 else -1] = 0
        try:
            check_stated(nm, shifted, stated, "port")
            accepted.append(light)
        except UntrustedReadingError:
            continue
    assert accepted == (["A", "A"] if name == "cs2000" else [])


@pytest.mark.parametrize("text, value, rounding", [
    ("1.83e+00", 1.83, 0.005), ("12.3", 12.3, 0.05), (" 746", 746, 0.5), ("1.865E+03", 1865, 0.5),
    (".4035", 0.4035, 5e-5), ("-1e-5", -1e-5, 5e-6)])
def test_a_printed_number_is_known_to_half_a_unit_of_its_last_digit(text, value, rounding):
    assert printed(text) == (value, pytest.approx(rounding, rel=1e-12))     # a power of ten


def test_a_watt_at_the_peak_of_vision_is_so_many_photons():
    # 555 nm: E = h c / lambda = 3.5792e-19 J
    estimate, _ = mean_wavelength((1.0, 0.0), (1 / 3.57922e-19, 0.0))
    assert estimate == pytest.approx(555, abs=0.01)
    assert mean_wavelength((1.0, 0.0), (51.47, 0.0)) is None


def test_few_digits_allow_more_and_no_digit_hides_a_gross_fault():
    nm, values = FINE_NM[::2], lamp(FINE_NM[::2])
    exact = Stated(luminance=printed("756.2"))
    check_stated(nm, values, exact, "port")
    with pytest.raises(UntrustedReadingError, match="luminance is 756"):
        check_stated(nm, values, Stated(luminance=printed("800.0")), "port")
    check_stated(nm, values, Stated(luminance=printed("8e2")), "port")
    with pytest.raises(UntrustedReadingError):
        check_stated(nm, values, Stated(luminance=printed("9e2")), "port")


def test_many_equal_values_in_a_row_are_no_light():
    nm, values = FINE_NM, lamp(FINE_NM)
    for count in (11, 12):
        stuck = values.copy()
        stuck[300:300 + count] = stuck[300]
        if count == 11:
            check_stated(nm, stuck, Stated(), "port")
        else:
            with pytest.raises(UntrustedReadingError, match="12 values in a row, from 680 nm"):
                check_stated(nm, stuck, Stated(), "port")
    dark = np.where(nm < 700, values, 0.0)      # an instrument may clip what it cannot see
    check_stated(nm, dark, Stated(), "port")
