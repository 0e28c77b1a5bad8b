"""CxF3 (ISO 17972): the spectra of a file's objects, with the wavelengths of its specifications;
SPECTRABOX_DATA names the folder that holds field5/.
"""
import os
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from spectrabox.fixtures.spectral_files import NM, REFLECTANCE, cxf_text
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum, read_table

NAMES = st.text(st.characters(categories=("L", "N"), include_characters=" &<'"), min_size=1,
                max_size=12).filter(lambda name: name.strip())


def write(tmp_path, text):
    path = tmp_path / "a.cxf"
    path.write_text(text, encoding="utf-8")
    return path


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture,
                                                   HealthCheck.too_slow],
          deadline=None, derandomize=True)
@given(st.data())
def test_every_object_is_a_column(tmp_path, data):
    prefix = data.draw(st.sampled_from(["cc:", "", "x:"]))
    declared = f"xmlns{':' + prefix[:-1] if prefix else ''}"
    names = data.draw(st.lists(NAMES, min_size=1, max_size=5, unique_by=lambda name: " ".join(
        name.split())))
    start, step = data.draw(st.sampled_from([(380, 10), (400, 20), (360, 5)]))
    count, at_spectrum = data.draw(st.integers(2, 40)), data.draw(st.booleans())
    curves = np.random.default_rng(data.draw(st.integers(0, 9999))).uniform(
        0, 1, (len(names), count)).round(6)
    objects = "".join(
        f"<{prefix}Object ObjectType='Target' Name={quoteattr(name)} Id='o{index}'>"
        f"<{prefix}ColorValues><{prefix}ColorCIELab ColorSpecification='C'><{prefix}L>5</{prefix}L>"
        f"</{prefix}ColorCIELab><{prefix}ReflectanceSpectrum ColorSpecification='C'"
        f"{f' StartWL={chr(39)}{start}{chr(39)}' if at_spectrum else ''}>\n"
        f"{chr(10).join(map(str, row))}</{prefix}ReflectanceSpectrum></{prefix}ColorValues>"
        f"</{prefix}Object>" for index, (name, row) in enumerate(zip(names, curves, strict=True)))
    path = write(tmp_path, f"<?xml version='1.0'?><{prefix}CxF {declared}='http://x/CxF3-core'>"
                 f"<{prefix}Resources><{prefix}ObjectCollection>{objects}"
                 f"</{prefix}ObjectCollection><{prefix}ColorSpecificationCollection>"
                 f"<{prefix}ColorSpecification Id='C'><{prefix}MeasurementSpec>"
                 f"<{prefix}WavelengthRange StartWL='{start}' Increment='{step}'/>"
                 f"</{prefix}MeasurementSpec></{prefix}ColorSpecification>"
                 f"</{prefix}ColorSpecificationCollection></{prefix}Resources></{prefix}CxF>")
    table = read_table(path)
    assert list(table.names) == [" ".join(name.split()) for name in names]
    np.testing.assert_array_equal(table.nm, start + step * np.arange(count))
    np.testing.assert_array_equal(table.values, curves)
    assert all(table.fact("quantity", index) == "reflectance" for index in range(len(names)))


def test_one_object_under_several_conditions_has_a_column_for_each(tmp_path):
    text = cxf_text("ochre")
    spectrum = text[text.index("<cc:ReflectanceSpectrum"):text.index("</cc:ColorValues>")]
    specification = text[text.index("<cc:ColorSpecification Id"):
                         text.index("</cc:ColorSpecificationCollection>")]
    second = spectrum.replace("CS1", "CS2").replace(repr(float(REFLECTANCE[0])), "0.5")
    illuminated = specification.replace("CS1", "CS2").replace(
        "<cc:WavelengthRange", "<cc:Device><cc:DeviceIllumination>M1_Daylight"
        "</cc:DeviceIllumination></cc:Device><cc:WavelengthRange")
    table = read_table(write(tmp_path, text.replace(spectrum, spectrum + second).replace(
        specification, specification + illuminated)))
    assert table.names == ("ochre CS1", "ochre M1_Daylight")
    assert table.values[1][0] == 0.5 and table.values[0][0] == REFLECTANCE[0]


def test_points_of_a_custom_spectrum_state_their_wavelengths(tmp_path):
    text = cxf_text()
    spectrum = text[text.index("<cc:ReflectanceSpectrum"):text.index("</cc:ColorValues>")]
    custom = ("<cc:CustomSpectrum ColorSpecification='CS1'>" + "".join(
        f"<cc:SpectralPoint WL='{nm}'>{value}</cc:SpectralPoint>"
        for nm, value in ((500.5, 0.2), (400, 0.1), (700, 0.4))) + "</cc:CustomSpectrum>")
    spectrum = read_spectrum(write(tmp_path, text.replace(spectrum, custom)),
                             role=Quantity.REFLECTANCE)
    np.testing.assert_array_equal(spectrum.grid.nm, [400, 500.5, 700])
    np.testing.assert_array_equal(spectrum.values, [0.1, 0.2, 0.4])


@pytest.mark.parametrize("old, new, message", [
    (' Increment="10"', "", "no Increment of its wavelengths"),
    ("ReflectanceSpectrum", "ColorDensity", "no spectra, only ColorDensity"),
    ("ReflectanceSpectrum", "TransmittanceSpectrum", "'transmittance'"),
    ("<cc:Resources>", "", "damaged XML")])
def test_what_cannot_be_a_reflectance_is_refused_by_name(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        read_spectrum(write(tmp_path, cxf_text().replace(old, new)), role=Quantity.REFLECTANCE)


def test_objects_without_a_spectrum_are_counted(tmp_path):
    text = cxf_text()
    bare = "<cc:Object Name='bare' Id='o0'/>"
    path = write(tmp_path, text.replace("<cc:Object ", f"{bare}<cc:Object ", 1))
    assert read_table(path).notes == ("1 of 2 objects hold no spectrum and were left out",)
    np.testing.assert_array_equal(read_table(path).nm, NM)


def test_two_objects_of_the_field_are_read():
    path = Path(os.environ.get("SPECTRABOX_DATA", "no-data")) / "field5/cxf3/two.cxf"
    if not path.exists():
        pytest.skip("SPECTRABOX_DATA names no folder that holds field5")
    table = read_table(path)
    assert table.names == ("ochre", "smalt")
    np.testing.assert_array_equal(table.nm, [400, 410, 420, 430, 440, 450])
    np.testing.assert_array_equal(table.values, [[0.10, 0.12, 0.15, 0.20, 0.31, 0.40],
                                                 [0.30, 0.28, 0.22, 0.15, 0.10, 0.09]])
