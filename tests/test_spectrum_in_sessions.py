"""A session reads any format wherever it asks for a spectrum."""
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.fixtures.spectral_files import NM, REFLECTANCE, write_examples
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.session.config.captured_session import read_light, read_reflectance
from spectrabox.session.config.curve_sources import LightTable, SpectrumTable


@pytest.mark.parametrize("name",
                         ["CSV", "ASD", "CGATS", "TM-27", "ENVI", "rawtoaces", "spectral EXR"])
def test_a_known_material_may_be_in_any_format(tmp_path, name):
    path = write_examples(tmp_path)[name]
    config = SimpleNamespace(path=lambda file: tmp_path / file)
    spectrum = read_reflectance(config, SpectrumTable(file=path.name))
    # the least exact format has single precision
    np.testing.assert_allclose(spectrum.values, REFLECTANCE, rtol=1e-7)


def test_a_light_may_be_a_tm27_document(tmp_path):
    text = spdx_text(NM, {"value": REFLECTANCE}, quantity=Quantity.IRRADIANCE, source="lamp")
    (tmp_path / "light.spdx").write_text(text)
    config = SimpleNamespace(path=lambda file: tmp_path / file)
    assert read_light(config, LightTable(file="light.spdx")).quantity is Quantity.IRRADIANCE
