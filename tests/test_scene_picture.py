"""A picture of spectra of a scene: patterns on walls, shading and interreflection taken out."""
import json
import re
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from sampling_cameras import surface
from small_captures import work
from typer.testing import CliRunner

from spectrabox.fixtures.demos.painted_box import (
    chequered,
    painted_truth,
    write_painted_session,
    write_picture_demo,
)
from spectrabox.fixtures.paints import NM
from spectrabox.measure.pictures import scene_light
from spectrabox.measure.pictures.pixel_flags import EDGE, PENUMBRA, SEEN
from spectrabox.measure.steps.pictures import traced_photo
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.interreflection import products
from spectrabox.reconstruct import pixel_light, scene_estimate
from spectrabox.reconstruct.rendering.renderer import all_cores, register_spectral_texture
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.prior.uplift_table import uplift_signals
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.outputs.run_outputs import rewritten_outputs
from spectrabox.session.problems import check_session

from tests.session_runs import run

SIZE = (40, 60)
SIGMAS_95 = 1.96
STEP_NM = np.arange(400, 701, 20)


def saturated(first):
    """Four of the test surfaces, the most colourful of some."""
    every = np.array([surface(NM, first + number) for number in range(40)])
    return every[np.argsort(-np.ptp(every, axis=1))[:4]]


# walls whose light is far from grey
YELLOW = 0.08 + 0.72 / (1 + np.exp(-(NM - 530) / 12))
PATTERNS = {"green": chequered(saturated(0), 4, 1), "red": chequered(saturated(40), 4, 2),
            "cube": chequered(saturated(80), 2, 3)}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene-picture") / "session"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pixel_light, "PATHS_OF_NODE", 400)
        write_painted_session(folder, PATTERNS, size=SIZE, spp=1024, electrons=2e5,
                              walls=YELLOW)
        return folder, run(folder)


@pytest.fixture(scope="module")
def scene(finished):
    """The traced photo, as the stage has it."""
    made = finished[1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pixel_light, "PATHS_OF_NODE", 400)
        return traced_photo(made.capture, made.records, work(made.capture))


@pytest.fixture(scope="module")
def lighting(scene):
    """The photo with the light on it, the light's scale, and the spectra of the materials."""
    return scene_light.converge_light(scene, lambda _: None)[:3]


@pytest.fixture(scope="module")
def truth():
    return painted_truth(PATTERNS, SIZE)


def stored(folder, name):
    return layers(folder / "results" / "picture" / name)


def layers(path):
    """Pixels (H, W, P) of a spectral EXR."""
    file = oiio.ImageInput.open(str(path))
    pixels, channels = np.asarray(file.read_image("float")), list(file.spec().channelnames)
    first = 3 if len(channels) > 3 and channels[0] == "R" else 0    # colours for viewers
    return pixels[..., first:]


def at_step(spectra):
    return np.array([np.interp(STEP_NM, NM, each) for each in spectra])


def scores(found, true):
    """Mean over pixels of the RMSE, and the share of wavelengths that bands hold."""
    mean, spread = found
    off = mean - true
    return (np.sqrt(np.mean(off**2, axis=1)).mean(),
            np.mean(np.abs(off) <= SIGMAS_95 * spread))


def test_the_bands_of_pixels_hold_their_paints(finished, truth):
    folder, made = finished
    mean, spread = (stored(folder, f"{name}.exr") for name in ("mean", "standard_deviation"))
    some = np.isfinite(mean[..., 0]) & np.isfinite(truth[..., 0])
    assert some.sum() > 100
    rmse, held = scores((mean[some][:, ::2], spread[some]), at_step(truth[some]))
    # twelve surfaces and errors that all pixels share: few independent cases, so one-sided bounds
    assert rmse < 0.06 and held > 0.9
    changes = made.records.picture.rounds
    assert changes[-1] <= scene_light.TOLERANCE
    # a patterned wall sends on other light than one of a single spectrum
    assert changes[0] > scene_light.TOLERANCE
    assert made.records.picture.findings[0].code == "picture.light-converged"


def near_the_walls(lit, truth):
    """Mean and spread of the pixels next to the back wall's coloured neighbours, and their truth.
    """
    width = SIZE[1]
    rows = lit.block(0, SIZE[0], direct=True)
    column = np.tile(np.arange(width), SIZE[0])
    some = rows.seen & np.isfinite(truth[..., 0]).ravel() \
        & ((column < width // 4) | (column >= 3 * width // 4))
    picked = np.flatnonzero(some)[::3]
    rows = replace(rows, **{name: getattr(rows, name)[picked] for name in (
        "signals", "error_level", "measured", "flags", "grey_error", "variance")},
        light=None if rows.light is None else rows.light[picked], white=rows.white.rows(picked))
    mean, deviation, _ = lit.direct(rows)
    at = np.searchsorted(PRIOR_GRID.nm, STEP_NM)
    return (mean[:, at], deviation[:, at]), at_step(
        truth.reshape(-1, NM.size)[picked])


def test_light_from_other_walls_counts_with_its_colour(scene, lighting, truth, monkeypatch):
    def scored(scene):
        photo, *_ = scene_light.converge_light(scene, lambda _: None)
        return scores(*near_the_walls(photo, truth))

    # the light's strength as from a chart, which no light from walls can make up for; and the
    # simulated paints mirror nothing: the usual gloss taken off would be an error of all lights
    _, scale, _ = lighting
    scene = replace(scene, view=replace(scene.view, light_scale=scale), surface="matt")
    whole = scored(scene)
    made = scene_light.illumination
    lamp = scene.view.light

    def grey(light, to_signals):
        return made(light.mean(axis=1, keepdims=True) * lamp / lamp.mean(), to_signals)

    monkeypatch.setattr(scene_light, "illumination", grey)
    as_grey = scored(scene)
    monkeypatch.undo()
    begun = scene.traced.exponents.sum(axis=1) <= 1
    alone = scored(replace(scene, traced=replace(
        scene.traced, passes=scene.traced.passes * begun)))
    # light that is left out makes walls too bright, which a prior of even level pulls back little
    assert whole[0] < 0.05 and whole[0] < as_grey[0] / 1.2 and whole[0] < alone[0] / 1.8
    assert whole[1] > 0.9 and as_grey[1] < whole[1]


def test_painted_patterns_are_no_lamp_elsewhere(finished):
    first = finished[1].records.reconstruct.joint.views[0]
    assert "scene.estimated" not in [one.code for one in first.findings]


def test_a_picture_under_the_light_as_stated_has_no_scale_of_an_estimated_scene(scene, lighting):
    first = scene.joint.views[0]
    estimated = replace(first, light_scale=replace(
        first.light_scale, value=2 * first.light_scale.value),
        findings=(*first.findings, scene_estimate.finding([])))
    scene = replace(scene, joint=replace(scene.joint, views=(estimated,)),
                    view=replace(scene.view, light_scale=first.light_scale))
    _, scale, spectra = lighting
    light = scene.light(spectra)
    # the same light, by the same known walls
    assert scene_light.light_photo(scene, light)[1].value == pytest.approx(scale.value, rel=0.01)


def test_few_typical_lights_stand_for_the_light_on_every_pixel(lighting):
    """Spectra as of each pixel's own response, of which none are shared."""
    lit, _, _ = lighting
    rows = lit.block(0, SIZE[0], direct=True)
    picked = np.flatnonzero(rows.seen)[::40]
    errors, light = lit.errors, lit.errors.light
    maps = errors.between(0, SIZE[0])[picked] @ light.maps
    own = np.einsum("nq,qkp->nkp", maps, light.shapes)
    white = own.sum(axis=2)
    measured = (lit.photo.signal.reshape(-1, 3) - errors.glare)[picked]
    # what surfaces mirror is the same share of white under every light: less its mean, as shared
    gloss = errors.gloss.pattern @ errors.gloss.mean
    signals = np.clip(measured / rows.white.signal[picked] - gloss, 1e-4, 1)
    of_pixels = errors.errors(rows.within, rows.white, rows.variance)
    each = [of_pixels.rows(slice(pixel, pixel + 1)) for pixel in picked]
    alone = [uplift_signals(errors.prior, response, signal[None], error)
             for response, signal, error in zip(own / white[..., None], signals, each,
                                                strict=True)]
    shared = [uplift_signals(errors.prior, errors.responses[kind], signal[None], error)
              for kind, signal, error in zip(rows.light[picked], rows.within[picked], each,
                                             strict=True)]
    mean, spread, _ = (np.concatenate(each) for each in zip(*alone, strict=True))
    off = np.vstack([each for each, _, _ in shared]) - mean
    assert picked.size > 25 and len(light.typical) > 1
    # measured: 1.1 % of what spectra are known to
    assert np.sqrt(np.mean(off**2)) < 0.02 * np.sqrt(np.mean(spread**2))


def test_what_leaves_a_node_is_its_reflectance_times_its_light(scene):
    traced = scene.traced
    spectra = np.random.default_rng(1).uniform(0.1, 0.9, (traced.exponents.shape[1], 7))
    lamps = np.linspace(0.5, 2, 7)[None]
    leaves = traced.coefficients @ products(traced.exponents, spectra) * lamps
    # a pixel beside an edge may show a sliver of the other surface
    region = scene.nodes.region
    kept = np.unique(region[(region >= 0) & ~scene.edges])
    assert len(kept) > 0.7 * len(leaves) and not scene.lamp[kept].any()
    found = spectra[scene.own] * pixel_light.light_on_nodes(traced, scene.own, spectra, lamps)
    # sums of a hundred products
    np.testing.assert_allclose(found[kept], leaves[kept], rtol=1e-10)


def test_pixels_at_edges_and_in_penumbra_have_no_spectrum(finished, scene):
    folder, made = finished
    mean = stored(folder, "mean.exr")
    shares = made.records.picture.flag_shares
    assert shares[SEEN] == pytest.approx(np.isfinite(mean[..., 0]).mean())
    assert shares[EDGE] > 0 and shares[PENUMBRA] > 0
    assert np.isnan(mean[scene.edges]).all()
    colours = stored(folder, "mask.png")
    hidden = (colours != colours[SIZE[0] // 3, SIZE[1] // 2]).any(axis=2)
    np.testing.assert_array_equal(np.isnan(mean[..., 0]), hidden)


def test_the_report_shows_the_picture_and_why_pixels_are_missing(finished):
    folder, made = finished
    said, *_ = rewritten_outputs(read_session(folder), made, ["spectrabox"], "cpu")
    facts = json.loads(json.dumps(said))["picture"]
    assert facts["size_px"] == [SIZE[1], SIZE[0]]
    assert any("penumbra" in words for words in facts["masked_because"])
    assert all((folder / file).is_file() for file in facts["files"])
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Picture of spectra" in page and "has converged" in page and "penumbra" in page
    # patterns are no fault of the session: one sentence for all
    assert said["verdict"] == "warn"
    assert [one["code"] for one in said["findings"]].count("scene.patterns") == 1


def test_the_demo_of_a_picture_is_a_session_that_is_ready_to_run(tmp_path):
    folder = tmp_path / "demo"
    write_picture_demo(folder, size=(104, 156), spp=4)
    assert not check_session(folder).problems
    with pytest.raises(InputError, match="already holds"):
        write_picture_demo(folder)
    both = CliRunner().invoke(app, ["demo", str(tmp_path / "none"), "--flat", "--picture"])
    assert both.exit_code != 0 and "two demos" in both.output


def test_another_part_makes_the_picture_again_and_nothing_else(finished, tmp_path, monkeypatch):
    monkeypatch.setattr(pixel_light, "PATHS_OF_NODE", 100)
    folder = shutil.copytree(finished[0], tmp_path / "session")
    text = (folder / "session.toml").read_text(encoding="utf-8")
    (folder / "session.toml").write_text(text.replace(
        "[picture]\n", "[picture]\nrect = [4, 20, 35, 51]\n"), encoding="utf-8")
    said = []
    states = run(folder, lambda stage, share, what: said.append((stage, share))).states
    assert states == {"photo": "kept", "calibrate": "kept", "reconstruct": "kept",
                      "sample": "kept", "picture": "run"}
    shares = [share for stage, share in said if stage == "picture"]
    assert shares == sorted(shares) and shares[-1] == 1
    part, whole = stored(folder, "mean.exr"), stored(finished[0], "mean.exr")
    assert part.shape[:2] == (16, 16)
    both = np.isfinite(part[..., 0]) & np.isfinite(whole[10:26, 2:18, 0])
    assert both.sum() > 60
    # the same pixels under light that was traced anew, of a quarter as many paths
    assert np.median(np.abs(part - whole[10:26, 2:18])[both]) < 0.02


@pytest.mark.parametrize("more, sentence", [
    ("[reconstruct]\nengine = \"gradient\"\n", "needs its light traced"),
    ("[reconstruct]\nlight_error = 0.1\n", "takes lights and bands as they are stated")])
def test_what_a_picture_of_a_scene_cannot_do_is_said_at_once(finished, tmp_path, more, sentence):
    text = (finished[0] / "session.toml").read_text(encoding="utf-8")
    (tmp_path / "session.toml").write_text(text.replace("[reconstruct]\nwidth = 64\n", more),
                                           encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_session(tmp_path)


def test_rendering_the_textures_gives_back_the_photo(finished, scene, lighting, truth):
    folder, made = finished
    files = made.records.picture.files
    assert {"texture-left_wall.exr", "texture-right_wall.exr", "textures.xml"} <= set(files)
    results = folder / "results" / "picture"
    root = ET.fromstring((results / "textures.xml").read_text(encoding="utf-8"))
    textures = {node.get("id").split(" of ")[1]: str(results / node.find("texture/string").get(
        "value")) for node in root}
    for name in files:      # a texel that no pixel shows has the spread of those that pixels show
        if name.startswith("texture-"):
            assert np.isfinite(layers(results / name)).all()
    register_spectral_texture()
    view, size = scene.view, SIZE[::-1]
    lit, scale, of_materials = lighting
    spectra = {material.bsdf: spectrum for material, spectrum in zip(
        view.scene_materials, of_materials, strict=True)}
    whole = ET.fromstring(view.xml(spectra, integrator="path"))
    for shape in whole.findall("shape"):
        if shape.get("id") in textures:
            shape.remove(shape.find("ref"))
            bsdf = ET.SubElement(shape, "bsdf", type="diffuse")
            texture = ET.SubElement(bsdf, "texture", name="reflectance", type="spectral_picture")
            ET.SubElement(texture, "string", name="filename", value=textures[shape.get("id")])
    import mitsuba as mi
    with all_cores():
        image = np.array(mi.render(mi.load_string(ET.tostring(whole, encoding="unicode")), spp=256,
                                   seed=3))
    column = np.arange(size[0])
    # where fields meet, a texel is not a pixel
    seen = np.isfinite(stored(folder, "mean.exr")[..., 0]) & np.isfinite(truth[..., 0])
    walls = seen & ((column < 12) | (column >= 48))
    assert walls.sum() > 50
    # of each paint as a whole: single pixels have noise, and texels lie otherwise than they do
    rows = lit.block(0, SIZE[0], direct=True)
    white = rows.white.signal.reshape(*SIZE, 3)[walls]
    off = (scale.value * image - view.photo.signal)[walls] / white
    _, paint = np.unique(truth[walls][:, ::50], axis=0, return_inverse=True)
    count = np.bincount(paint.ravel())
    off = np.array([np.bincount(paint.ravel(), band) for band in off.T])[:, count >= 5] \
        / count[count >= 5]
    assert off.shape[1] >= 4
    # in units of white: by what light and noise leave open, means lie nearer to the prior's
    assert np.median(np.abs(off)) < 0.02 and np.abs(off).max() < 0.08, off


def test_a_glossy_surface_is_refused_before_anything_is_traced(finished, tmp_path):
    folder = shutil.copytree(finished[0], tmp_path / "session")
    scene = folder / "scene" / "box.xml"
    text = scene.read_text(encoding="utf-8")
    glossy = '<bsdf type="plastic" id="cube"><rgb name="diffuse_reflectance" value="0.2"/></bsdf>'
    scene.write_text(re.sub(r'<bsdf type="diffuse" id="cube">.*?</bsdf>', glossy, text,
                            flags=re.DOTALL), encoding="utf-8")
    said = []
    with pytest.raises(InputError, match=r"cube of box\.xml is coated or glossy"):
        run(folder, lambda stage, share, what: said.append(what))
    assert "tracing light" not in said
