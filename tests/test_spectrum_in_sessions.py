"""A session reads any format wherever it asks for a spectrum."""
from types import SimpleNamespace

import numpy as np
import pytest

from fixtures.spectral_files import NM, REFLECTANCE, write_examples
from radiometry.records import Quantity
from radiometry.spectral_formats.tm27 import spdx_text
from session.inputs import read_light, read_reflectance
from session.session_schema import SpectrumRef


@pytest.mark.parametrize("name", ["CSV", "ASD", "CGATS", "TM-27", "ENVI", "SVC", "Spectral Evolution", "rawtoaces",
                                  "spectral EXR"])
def test_a_known_material_may_be_in_any_format(tmp_path, name):
    path = write_examples(tmp_path)[name]
    config = SimpleNamespace(path=lambda file: tmp_path / file)
    spectrum = read_reflectance(config, SpectrumRef(path.name))
    np.testing.assert_allclose(spectrum.values, REFLECTANCE, rtol=1e-7)  # the least exact format has eight digits


def test_a_light_may_be_a_tm27_document(tmp_path):
    text = spdx_text(NM, {"value": REFLECTANCE}, quantity=Quantity.IRRADIANCE, source="lamp")
    (tmp_path / "light.spdx").write_text(text)
    config = SimpleNamespace(path=lambda file: tmp_path / file,
                             light=SimpleNamespace(spectrum=SpectrumRef("light.spdx")))
    assert read_light(config).quantity is Quantity.IRRADIANCE
