"""What sessions that are not the usual one change in the data and on the page of the report."""
import dataclasses

import numpy as np
import pytest
from compact_results import changes, different
from report_example import SURFACES, example_session
from report_variants import content, full, with_fit

from spectrabox.session.report import svg

pytestmark = pytest.mark.usefixtures("figures_undrawn")


@pytest.fixture(scope="module")
def content_of_usual(tmp_path_factory):
    """Data and lines of the page of a usual session."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(svg, "_svg_text", lambda drawing: '<svg viewBox="0 0 1 1"></svg>')
        return content(example_session(tmp_path_factory.mktemp("usual")))[:2]


def test_the_data_and_the_page_of_a_session_with_everything(tmp_path, content_of_usual,
                                                               recorded):
    numbers, lines, _ = content(full(tmp_path))
    usual, usual_lines = content_of_usual
    recorded(different(numbers, usual), case="data")
    recorded(changes(lines, usual_lines), case="page")


VARIANTS = {
    "five bands": {"bands": ("410", "480", "550", "620", "690")},
    "four bands": {"bands": ("R", "G", "B", "NIR"), "materials": ("one", "two")},
    "no chart": {"chart": False},
    "no truth": {"truth": False, "notes": "", "name": "Another"},
    "one material": {"materials": ("grey",)}}


@pytest.mark.parametrize("case", VARIANTS)
def test_what_another_session_changes_on_the_page(case, tmp_path, content_of_usual, recorded):
    numbers, lines, _ = content(example_session(tmp_path, **VARIANTS[case]))
    usual, usual_lines = content_of_usual
    recorded(changes(lines, usual_lines), case="page")
    recorded(different({key: numbers[key] for key in ("calibration", "agreement", "bands")},
                       usual), case="data")


def test_what_could_not_be_measured(tmp_path, content_of_usual, recorded):
    """Losses that reach 0, one iteration, an agreement that is not known, errors not stated."""
    results, (usual, usual_lines) = example_session(tmp_path), content_of_usual
    ratio = np.full((len(SURFACES), 3), np.nan)
    made = dataclasses.replace(results.reconstruction.agreement, ratio=ratio)
    made = dataclasses.replace(
        results.reconstruction, agreement=made, loss_history=np.array([0.01]),
        light_scale=dataclasses.replace(results.light_scale, standard_error=None))
    photo = dataclasses.replace(results.photo, exposure_s=None, iso=None, f_number=None, camera="")
    light = dataclasses.replace(results.calibration.light, standard_error=None)
    results = with_fit(dataclasses.replace(
        results, reconstruction=made, photo=photo, operator="", light_scale=made.light_scale,
        calibration=dataclasses.replace(results.calibration, light=light)),
        standard_error=None, held_out_residuals=None, condition_number=None)
    numbers, lines, _ = content(results)
    recorded(changes(lines, usual_lines), case="page")
    recorded(different(numbers, usual), case="data")
