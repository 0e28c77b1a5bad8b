"""Draws of all materials at once through the traced light."""
import re

import numpy as np
import pytest

from spectrabox.radiometry.errors import InputError
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import load_finished, run_stages
from spectrabox.session.stages.assemble import assemble


def through(folder, how, more=""):
    path = folder / "session.toml"
    text = re.sub(r"(?m)^through = .*\n", "", path.read_text(encoding="utf-8"))
    path.write_text(text.replace("[sampling]\n", f'[sampling]\nthrough = "{how}"\n') + more,
                    encoding="utf-8")
    return read_session(folder)


def run(config):
    return run_stages(config, device="cpu", only=None, force=False, progress=lambda *_: None)


def test_the_whole_scene_tells_more_than_each_surface_and_its_bands_still_hold(finished):
    alone = assemble(read_session(finished), load_finished(read_session(finished)), {})
    config = through(finished, "transport")
    jointly = assemble(config, run(config), {})
    widths = [np.mean([material.scores.band_width for material in found.materials])
              for found in (jointly, alone)]
    assert widths[0] < widths[1]
    assert np.mean([material.scores.coverage_95 for material in jointly.materials]) > 0.9
    assert all("through the light transport" in material.samples.method
               for material in jointly.materials)
    drawn = {material.name: material.samples.spectra for material in jointly.materials}
    # draw t of every material is of one scene
    assert len({spectra.shape for spectra in drawn.values()}) == 1


def test_what_cannot_be_drawn_through_the_transport_is_said(captured):
    config = through(captured, "transport", '\n[views.again]\nphoto = "photos/box.dng"\n')
    with pytest.raises(InputError, match=r"takes one photo .* and the session has several photos"):
        run(config)
    with pytest.raises(InputError, match=re.escape('draws from the learnt prior alone; set '
                                                   'sampling.method = "prior"')):
        through(captured, "transport\"\nmethod = \"uniform")
