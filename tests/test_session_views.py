"""Sessions with several photos of the same materials."""
import numpy as np

from spectrabox.fixtures.box_render import box_light
from spectrabox.fixtures.demo_photos import (
    camera_sensitivities,
    exposure_for,
    take_photo,
)
from spectrabox.fixtures.demo_session import PAINTS
from spectrabox.fixtures.paints import NM, paint
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import load_finished, run_stages
from spectrabox.session.report.page import write_report
from spectrabox.session.stages.assemble import assemble
from spectrabox.session.stages.stored_records import joint_of
from spectrabox.session.store.surface_files import write_surface_files

SIZE = (208, 312)


def add_warm_view(folder):
    """The same box under a lamp like a black body of 2856 K, whose strength only the photos
    tell.
    """
    warm = 0.6 * (NM / 560.0) ** -5 * (np.expm1(1.4388e7 / 560 / 2856)
                                       / np.expm1(1.4388e7 / NM / 2856))
    curves, rng = camera_sensitivities(), np.random.default_rng(5)
    reflectances = {name: paint(of)[1] for name, of in PAINTS.items()}
    box = box_light(NM, reflectances, warm, curves, size=SIZE, spp=4, seed=3,
                    progress=lambda *_: None)
    take_photo(folder / "photos" / "box_warm.dng", box, exposure_for(box, 0.7), rng)
    (folder / "spectra" / "warm.csv").write_text(table_text(NM, {"value": warm},
                                                            quantity=Quantity.RADIANCE,
                                                            source="warm lamp"), encoding="utf-8")
    view = '\n[views.warm]\nphoto = "photos/box_warm.dng"\nlight = "spectra/warm.csv"\n'
    with (folder / "session.toml").open("a", encoding="utf-8") as stream:
        stream.write(view)
    return read_session(folder)


def run(config):
    return run_stages(config, device="cpu", only=None, force=False, progress=lambda *_: None)


def test_a_second_light_narrows_the_bands(captured, finished):
    """Without a chart under it: its scale comes from the materials that both photos show."""
    config = add_warm_view(captured)
    both, one = run(config), load_finished(read_session(finished))
    joint = joint_of(both.stored)
    assert joint.names == ("photo", "warm")
    assert joint.bands == ("photo: R", "photo: G", "photo: B", "warm: R", "warm: G", "warm: B")
    results, alone = assemble(config, both, {}), assemble(read_session(finished), one, {})
    width, before = (np.mean([material.scores.band_width for material in found.materials])
                     for found in (results, alone))
    assert width < before
    assert np.mean([material.scores.coverage_95 for material in results.materials]) > 0.9
    for view in joint.views:
        assert np.median(np.abs(view.agreement.ratio - 1)) < 0.03

    page = write_report(results).read_text(encoding="utf-8")
    assert "Photo “warm”" in page and "warm lamp" in page
    write_surface_files(results, results.reconstruction.grid.nm)
    assert (captured / "comparison warm.exr").is_file()
