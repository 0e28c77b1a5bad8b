"""Draws of all materials at once through the traced light."""
import dataclasses
import re

import numpy as np
import pytest

from spectrabox.measure.results.result_of_records import result_of
from spectrabox.measure.scene.draws import _common_errors, _of_gloss, _of_stray_light, _of_tails
from spectrabox.measure.scene.photo_errors import with_stray_light
from spectrabox.measure.steps.inversion import settings_of, views_of
from spectrabox.radiometry.error_model import GLARE
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.inverse_rendering import reconstruct_views
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished
from spectrabox.session.pipeline import run_stages


def through(folder, how, more=""):
    path = folder / "session.toml"
    text = re.sub(r"(?m)^through = .*\n", "", path.read_text(encoding="utf-8"))
    path.write_text(text.replace("[sampling]\n", f'[sampling]\nthrough = "{how}"\n') + more,
                    encoding="utf-8")
    return read_session(folder)


def run(config):
    return run_stages(config, device="cpu", only=None, force=False, progress=lambda *_: None)


def test_the_whole_scene_tells_more_than_each_surface_and_its_bands_still_hold(finished):
    before = load_finished(read_session(finished))
    alone = result_of(before.capture, before.records)
    config = through(finished, "transport")
    after = run(config)
    jointly = result_of(after.capture, after.records)
    widths = [np.mean([material.scores.band_width for material in found.surfaces])
              for found in (jointly, alone)]
    assert widths[0] < widths[1]
    assert np.mean([material.scores.coverage_95 for material in jointly.surfaces]) > 0.9
    assert all("through the light transport" in material.samples.method
               for material in jointly.surfaces)
    drawn = {material.name: material.samples.spectra for material in jointly.surfaces}
    # draw t of every material is of one scene
    assert len({spectra.shape for spectra in drawn.values()}) == 1


def test_what_cannot_be_drawn_through_the_transport_is_said(captured):
    config = through(captured, "transport", '\n[views.again]\nphoto = "photos/box.dng"\n')
    with pytest.raises(InputError, match=r"takes one photo .* and the session has several photos"):
        run(config)
    with pytest.raises(InputError, match=re.escape('draws from the learnt prior alone; set '
                                                   'sampling.method = "prior"')):
        through(captured, "transport\"\nmethod = \"uniform")


def test_a_surface_without_usable_pixels_leaves_the_others_their_material(finished):
    done = load_finished(read_session(finished))
    capture, records = done.capture, done.records
    start_mitsuba("cpu")
    view, = views_of(capture, records)
    shapes, materials = list(view.scene_file.surfaces), np.array(view.surface_materials)
    hidden = 0
    saturated = np.array(view.photo.saturated)
    saturated[view.surface == hidden] = True
    partly = dataclasses.replace(view, photo=dataclasses.replace(view.photo, saturated=saturated))
    joint = reconstruct_views([partly], settings_of(capture), lambda *_: None)
    made, regions = joint.views[0], joint.regions[0]
    assert len(made.agreement.names) == len(shapes) - 1
    seen = made.surface >= 0
    assert [made.agreement.names[index] for index in made.surface[seen]] == [
        f"{materials[index]} / {shapes[index]}" for index in partly.surface[seen]]
    assert seen[partly.used].all() and not seen[partly.surface == hidden].any()
    of_region = np.array(regions.materials)[regions.material]
    np.testing.assert_array_equal(of_region, materials[regions.surface])
    # an error of one material's signal befalls the regions of that material and no other
    relative = np.ones(regions.signal.shape)
    of_brightest = records.calibrations(capture.views)[0].relative_covariance
    for error in _of_tails(of_brightest, regions, relative):
        assert len(set(of_region[(error != 0).any(axis=1)])) == 1
    mirrored = dict.fromkeys(joint.materials, "satin")
    stray = with_stray_light(joint, np.full(3, 0.01), 0.0, mirrored)
    (glare,), _ = _of_stray_light(stray, regions, relative).values()
    reflections = _of_gloss(stray, regions, relative)
    # what a surface mirrors says nothing of another
    assert [set(of_region[(error != 0).any(axis=1)]) for error in reflections] == [
        {name} for name in stray.materials]
    for name, expected in zip(stray.materials, stray.stray_light[GLARE], strict=True):
        assert (expected > 0).all()
        np.testing.assert_array_equal(glare[of_region == name], np.broadcast_to(
            expected, glare[of_region == name].shape))


def test_stated_errors_of_the_light_widen_the_signals_of_regions(finished):
    done = load_finished(read_session(finished))
    capture, records = done.capture, done.records
    joint, calibration = records.reconstruct.joint, records.calibrations(capture.views)[0]
    regions, view = joint.regions[0], joint.views[0]
    response = joint.response * view.white_signal[:, None] * view.light_scale.value

    def variance(share):
        light = dataclasses.replace(calibration.light,
                                    standard_error=share * calibration.light.values)
        known = dataclasses.replace(calibration, light=light)
        *_, causes = _common_errors(known, joint, regions, response)
        return (np.concatenate(list(causes.values()))**2).sum(axis=0)

    added = variance(0.02) - variance(0.0)
    # a direction that is left out has a share of KEPT at most of the largest variance
    assert added.min() > -1e-3 * added.max() and added.max() > 0
    np.testing.assert_allclose(variance(0.04) - variance(0.0), 4 * added, atol=4e-2 * added.max())
