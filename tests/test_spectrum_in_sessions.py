"""A session reads any format wherever it asks for a spectrum."""

import numpy as np
import pytest

from spectrabox.fixtures.spectral_files import NM, REFLECTANCE, write_examples
from spectrabox.measure.shoot.captures import read_light, read_reflectance
from spectrabox.measure.shoot.curves import LightTable, SpectrumTable
from spectrabox.measure.shoot.inputs import Inputs
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text


@pytest.mark.parametrize("name",
                         ["CSV", "ASD", "CGATS", "TM-27", "ENVI", "rawtoaces", "spectral EXR",
                          "JCAMP-DX", "CxF"])
def test_a_known_material_may_be_in_any_format(tmp_path, name):
    path = write_examples(tmp_path)[name]
    inputs = Inputs(tmp_path)
    spectrum = read_reflectance(inputs, SpectrumTable(file=path.name))
    # the least exact format has single precision
    np.testing.assert_allclose(spectrum.values, REFLECTANCE, rtol=1e-7)


def test_a_light_may_be_a_tm27_document(tmp_path):
    text = spdx_text(NM, {"value": REFLECTANCE}, quantity=Quantity.IRRADIANCE, source="lamp")
    (tmp_path / "light.spdx").write_text(text)
    inputs = Inputs(tmp_path)
    assert read_light(inputs, LightTable(file="light.spdx")).quantity is Quantity.IRRADIANCE
