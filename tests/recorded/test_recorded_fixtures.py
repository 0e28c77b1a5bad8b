"""What the synthetic inputs hold: paints, lamps, scenes, photos, files and damage: recorded."""
import hashlib
from fractions import Fraction

import numpy as np
import pytest
from capture_pictures import counts, outcome

from spectrabox.fixtures import (
    box_render,
    chart_scene,
    cornell_box,
    demo_folder,
    demo_photos,
    demo_scenes,
    demo_session,
    dng,
    flat_demo,
    flat_sample,
    lamp,
    meter_transcripts,
    mutations,
    object_views,
    painted_box,
    paints,
    pigments,
    spectral_files,
)
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.reconstruct.rendering.llvm import ensure_llvm


def _hash(data):
    return hashlib.sha256(data if isinstance(data, bytes) else data.encode()).hexdigest()[:20]


def test_paints_and_pigments(recorded):
    recorded({"formulas": {name: paints.paint(name) for name in paints.FORMULAS},
              "chart": paints.chart_truth(np.random.default_rng(5)),
              "random": paints.random_paints(7, np.random.default_rng(6)),
              "pigments": pigments.PIGMENTS}, rtol=1e-7)
    curves = [paints.paint(name)[1] for name in paints.FORMULAS]
    for curve in (*pigments.PIGMENTS.values(), *curves):
        assert curve.min() > 0 and curve.max() < 1


def test_lamps(recorded):
    recorded({"radiance": lamp.radiance(), "coarse": lamp.radiance(np.arange(395.0, 720.0, 32.0)),
              "measured": lamp.measured(np.random.default_rng(4)),
              "meters": meter_transcripts.lamp(np.arange(380.0, 781, 40)),
              "level": meter_transcripts.lamp(np.array([545.0, 600.0]), 0.5)}, rtol=1e-7)


@pytest.mark.parametrize("fault", meter_transcripts.SPECTRUM_FAULTS, ids=lambda fault: fault.name)
def test_instruments_that_send_another_spectrum(recorded, fault):
    values = np.arange(1.0, 12.0) ** 2
    recorded({"of": fault.change(values), "luminance": fault.luminance, "unseen": fault.unseen_by,
              "texts": {meter.name: _hash(meter.text())
                        for meter in meter_transcripts.faulty_meters(fault)}})


def test_recordings_of_instruments(recorded):
    meters = (*meter_transcripts.all_meters(), *meter_transcripts.changed_meters())
    recorded({meter.name: [meter.driver, meter.line, meter.settings, meter.change.decode(),
                           meter.leave.decode(), _hash(meter.text()),
                           meter.values] for meter in meters}, rtol=1e-7)


def test_damaged_copies(recorded):
    content = b"wavelength_nm,value\n380,0.25\n# name: a wall\n" * 30
    recorded({"mutated": [_hash(mutations.mutated(content, seed)) for seed in range(28)],
              "rewritten": [_hash(mutations.rewritten(content, seed)) for seed in range(28)],
              "empty": [_hash(mutations.mutated(b"", seed)) for seed in range(7)],
              "short": [_hash(mutations.rewritten(b"?", 3)), _hash(mutations.mutated(b"ab", 4))]})


def test_views_of_an_object(recorded, tmp_path):
    at = object_views.cameras(5, 0.3)
    np.testing.assert_allclose(np.linalg.norm(at, axis=1), object_views.DISTANCE, rtol=1e-12)
    vertices, faces = object_views.object_mesh(9)
    object_views.write_ply(tmp_path / "a.ply", vertices, faces)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    # closed: every edge belongs to two faces
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)
    recorded({"cameras": at, "default": object_views.cameras(4), "vertices": vertices,
              "faces": faces, "xml": [object_views.view_xml(camera, 33).split("\n") for camera
                                      in (at[0], np.array([0.0, 4.0, 0.1]))],
              "ply": (tmp_path / "a.ply").read_text().split("\n")[:30],
              "default mesh": [part.shape for part in object_views.object_mesh()]}, rtol=1e-7)


def test_boxes_and_charts_as_scenes(recorded):
    recorded({"cornell": [_hash(cornell_box.cornell_box_xml()),
                          *cornell_box.cornell_box_xml(31, 5, True).split("\n")],
              "box": [line for line in demo_scenes.box_scene((40, 60)).split("\n") if line.strip()],
              "chart": [line for line in demo_scenes.chart_scene_xml((40, 60)).split("\n")
                        if line.strip()],
              "filled": _hash(demo_scenes.box_scene((40, 60), {"white": "<a/>", "light": "<b/>"},
                                                    "<film/>", 5, {"cube": "<c/>"})),
              "spectrum": demo_scenes.regular_spectrum("reflectance", np.arange(400.0, 441, 10),
                                                       np.array([0.1, 0.25, 0.3, 0.2, 0.15]))})


def test_photos_of_the_demo(recorded, tmp_path):
    size = (46, 68)
    nm_count = paints.NM.size
    light = lamp.radiance(paints.NM)
    curves = demo_photos.camera_sensitivities()
    reflectances = paints.random_paints(24, np.random.default_rng(8))
    shown = demo_photos.chart_light(reflectances, light, curves, size)
    card = demo_photos.card_light(light, curves, size)
    recorded({"sensitivities": curves, "seen": demo_photos.seen_by_camera(reflectances * light,
                                                                          curves),
              "vignetting": demo_photos.vignetting(size),
              "factor": [demo_photos.light_factor(np.array(point)) for point in (
                  (0.0, 0.0), (-9.0, 6.0), (11.0, -8.0))],
              "corners": demo_photos.chart_corners(size), "chart": shown, "card": card,
              "exposures": [float(demo_photos.exposure_for(picture, target))
                            for picture in (shown, card, 40 * card) for target in (0.3, 0.75)],
              "spectra": nm_count}, rtol=1e-6)
    path = tmp_path / "a.dng"
    demo_photos.take_photo(path, shown, Fraction(1, 30), np.random.default_rng(3))
    demo_photos.take_photo(tmp_path / "b.dng", card, Fraction(1, 8), np.random.default_rng(4))
    recorded([_samples(path), _samples(tmp_path / "b.dng")], rtol=1e-3, case="files")


def _samples(path):
    """Counts of an uncompressed DNG; single ones may round otherwise on another machine."""
    import rawpy
    with rawpy.imread(str(path)) as raw:
        return [raw.raw_image.shape, raw.raw_image.astype(float).mean(axis=0),
                raw.raw_image.astype(float).std(axis=1), raw.other.shutter_speed]


def test_flat_samples(recorded, tmp_path):
    size = (40, 60)
    corners = flat_sample.chart_corners(0.1, 0.15, 0.4, 7.0)
    responses = demo_photos.camera_sensitivities() * lamp.radiance(paints.NM)
    areas = [(flat_sample.box(0.6, 0.1, 0.9, 0.5), pigments.PIGMENTS["vermilion"]),
             (np.array([[0.7, 0.2], [0.95, 0.3], [0.8, 0.6]]), pigments.PIGMENTS["viridian"])]
    patches = paints.random_paints(24, np.random.default_rng(9))
    ground = np.full(paints.NM.size, 0.17)
    even = flat_sample.surface_signals(size, responses, patches, corners, areas, ground)
    lit = flat_sample.lamplight(size, [(0.2, -0.5, 1.1, 1.0), (1.3, 0.6, 0.8, 0.3)], 0.1)
    gains = [flat_sample.write_photo(tmp_path / "a.dng", even * lit[..., None], Fraction(1, 30),
                                     np.random.default_rng(2)),
             flat_sample.write_photo(tmp_path / "b.dng", even, Fraction(1, 50),
                                     np.random.default_rng(3), brightest=0.6, electrons=5000.0),
             flat_sample.write_photo(tmp_path / "c.dng", even, Fraction(1, 50),
                                     np.random.default_rng(4), brightest=None, gain=20.0)]
    recorded({"corners": [corners, flat_sample.chart_corners(0.1, 0.15, 0.4)], "even": even,
              "without": flat_sample.surface_signals(size, responses, patches, None, areas, ground),
              "lit": lit, "plain": flat_sample.lamplight(size, [(0.2, -0.5, 1.1, 1.0)]),
              "lens": flat_sample.vignetting(size, 0.8), "gains": gains}, rtol=1e-5)
    recorded([_samples(tmp_path / name) for name in ("a.dng", "b.dng", "c.dng")], rtol=1e-3,
             case="files")


def test_the_flat_demo(recorded, tmp_path):
    flat_demo.write_flat_demo(tmp_path / "flat", 3, size=(104, 156))
    files = sorted(path for path in (tmp_path / "flat").rglob("*") if path.is_file())
    recorded({str(path.relative_to(tmp_path)): (
        _samples(path) if path.suffix == ".dng" else
        path.read_text().split("\n") if path.suffix == ".toml" else
        path.read_text().split("\n")[:12]) for path in files}, rtol=1e-3)
    recorded({"strokes": flat_demo._strokes((50, 70), np.random.default_rng(1)),
              "painting": [[polygon, curve] for polygon, curve in flat_demo._painting()]},
             case="painting")


def test_folders_of_demos(recorded, tmp_path):
    def claim(name, parts=("photos", "spectra"), fails=False):
        with demo_folder.claimed_folder(tmp_path / name, parts):
            (tmp_path / name / "session.toml").write_text("x")
            if fails:
                raise InputError("broken off")
        return sorted(path.name for path in (tmp_path / name).iterdir())
    (tmp_path / "file").write_text("")
    (tmp_path / "half" / "spectra").mkdir(parents=True)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("")
    found = {"new": claim("new"), "again": outcome(lambda: claim("new")),
             "file": outcome(lambda: claim("file")), "half": outcome(lambda: claim("half")),
             "full": claim("full"), "failed": outcome(lambda: claim("gone", fails=True))}
    (tmp_path / "full2").mkdir()
    (tmp_path / "full2" / "notes.txt").write_text("")
    outcome(lambda: claim("full2", fails=True))
    found["left"] = [sorted(path.name for path in (tmp_path / "full2").iterdir()),
                     (tmp_path / "gone").exists()]
    recorded({key: str(value).replace(str(tmp_path), "") for key, value in found.items()})


def test_painted_patterns(recorded, tmp_path):
    spectra = np.array(list(pigments.PIGMENTS.values()))[:3]
    pattern = painted_box.chequered(spectra, 5, 4)
    assert np.bincount(pattern.paint.ravel()).tolist() == [9, 8, 8]
    recorded({"paint": pattern.paint, "spectra": pattern.spectra,
              "text": [painted_box.TOML.split("\n"), painted_box.DEMO_TOML.split("\n")]})


def test_dng_files(recorded, tmp_path):
    table = {}
    for case, options in (
            ("plain", {}), ("14 bits", {"bits": 14, "white": 16000}),
            ("10 bits", {"bits": 10, "white": 1000}),
            ("fractions", {"black": (60.5, 61, 62.25, 63)}),
            ("area", {"active_area": (2, 4, 38, 50), "masked_areas": (0, 0, 40, 3)}),
            ("mono", {"pattern": "mono"}), ("X-Trans", {"pattern": "X-Trans"}),
            ("stated", {"exposure_s": Fraction(3, 8), "f_number": 3.4, "iso": 640, "make": "M",
                        "model": "N", "serial": "7", "orientation": 8,
                        "taken_at": "2025:05:04 03:02:01", "camera_from_xyz": None}),
            ("odd pattern", {"pattern": "RGBW"}), ("bits", {"bits": 11}),
            ("too few bits", {"bits": 10, "top": 4095})):
        top = options.pop("top", 2 ** options.get("bits", 12) - 100 if options.get("bits") != 16
                          else 4000)
        mosaic = np.minimum(counts(40, 52, (0, 1, 1, 2)), max(top, 900) if case != "10 bits"
                            else 900)
        path = tmp_path / f"{case}.dng"
        said = outcome(lambda path=path, mosaic=mosaic, options=options: dng.write_dng(
            path, mosaic, **options))
        table[case] = said or [_hash(path.read_bytes()), path.stat().st_size]
    for case, mosaic in (("odd", np.zeros((3, 4), np.uint16)), ("kind", np.zeros((4, 4))),
                         ("bands", np.zeros((4, 4, 2), np.uint16))):
        table[case] = outcome(lambda mosaic=mosaic: dng.write_dng(tmp_path / "a.dng", mosaic))
    table["packed"] = {bits: list(dng.packed(np.array([[1, 1023, 512], [7, 300, 2]], np.uint16),
                                             bits)) for bits in dng.BITS}
    recorded(table)


def test_mosaics_and_planes(recorded):
    rng = np.random.default_rng(11)
    signal = rng.uniform(0.05, 1.1, (24, 32, 3))
    table = {pattern: chart_scene.mosaic(signal, pattern, np.array([60.0, 64.0, 61.0, 63.0]),
                                         4095.0, 8000.0, 2.5, np.random.default_rng(2))
             for pattern in dng.BAYER_TILES}
    square = np.array([[0.0, 0.0], [10.0, 1.0], [12.0, 9.0], [-1.0, 8.0]])
    matrix = chart_scene.homography(square, chart_scene._grid_corners_mm())
    mapped = np.column_stack([square, np.ones(4)]) @ matrix.T
    np.testing.assert_allclose(mapped[:, :2] / mapped[:, 2:], chart_scene._grid_corners_mm(),
                               atol=1e-9)
    recorded({**table, "matrix": matrix}, rtol=1e-4)    # single counts of 768 round otherwise


def test_spectral_files(recorded, tmp_path):
    made = {}
    for version in ("ASD", "as6", "as7", "as8"):
        for kind in (1, 2):
            for reference in (True, False):
                made[f"{version} {kind} {reference}"] = _hash(spectral_files.asd_bytes(
                    version, kind, with_reference=reference))
    made["single precision"] = _hash(spectral_files.asd_bytes("as7", 1, "<f4"))
    made["examples"] = {name: path.name for name, path in
                        spectral_files.write_examples(tmp_path).items()}
    for name in sorted(vars(spectral_files)):
        if name.endswith(("_text", "_bytes")) and not name.startswith("_"):
            made[name] = outcome(lambda name=name: _content(getattr(spectral_files, name)))
    image = np.random.default_rng(3).random((19, 5, 4)).astype(np.float32)
    nm = np.array([400.0, 450.5, 512.0, 700.0])
    for compression in (0, 2, 3):
        made[f"exr {compression}"] = _hash(spectral_files.spectral_exr_bytes(
            image, nm, compression=compression)) if compression == 0 else len(
            spectral_files.spectral_exr_bytes(image, nm, compression=compression, emissive=True))
    recorded(made)


def _content(of):
    try:
        made = of()
    except TypeError:
        return "needs more"
    return _hash(made)


@pytest.mark.parametrize("seed", [2])
def test_light_that_reaches_the_demo_camera(recorded, seed):
    try:
        ensure_llvm()
    except EnvironmentProblem as problem:
        pytest.skip(str(problem))
    nm = paints.NM
    names = {"white": "white_wall", "green": "green_wall", "red": "red_wall", "cube": "cube"}
    done = []
    found = box_render.box_light(nm, {name: paints.paint(of)[1] for name, of in names.items()},
                                 lamp.radiance(nm), demo_photos.camera_sensitivities(),
                                 size=(16, 24), spp=4, seed=seed, progress=done.append)
    faces = box_render._faces((16, 24))
    # traced in single precision: sums of paths in another order
    recorded({"light": found, "done": done, "faces": faces, "smooth":
              box_render.smooth_within_faces(found, faces)}, rtol=1e-3)
    recorded(outcome(lambda: box_render.box_light(nm, {}, nm, nm, size=(4, 4), spp=5, seed=1,
                                                  progress=done.append)), case="refused")


def test_the_session_of_the_demo(recorded, tmp_path):
    text = demo_session._session_toml(7)
    reflectances = {name: paints.paint(of)[1] for name, of in (
        ("white", "white_wall"), ("green", "green_wall"), ("red", "red_wall"), ("cube", "cube"))}
    (tmp_path / "spectra").mkdir()
    demo_session._write_spectra(tmp_path, reflectances, demo_photos.camera_sensitivities(),
                                np.random.default_rng(7))
    recorded({"text": text.split("\n"), "files": {
        path.name: [_numbers(path), path.read_text().split("\n")[:6]]
        for path in sorted((tmp_path / "spectra").iterdir())}}, rtol=1e-6)


def _numbers(path):
    rows = [line.split(",") for line in path.read_text().split("\n") if line[:1].isdigit()]
    return np.array(rows, float)
