"""The whole report of a synthetic session: its data, and every text and table cell of its page."""
import pytest
from compact_results import compact
from report_example import example_session
from report_variants import content, full

from spectrabox.session.summary_text import run_facts, run_text

pytestmark = pytest.mark.usefixtures("figures_undrawn")


def test_the_data_and_the_page_of_a_usual_session(tmp_path, recorded):
    numbers, lines, readouts = content(example_session(tmp_path))
    recorded(numbers, case="data")
    recorded(lines, case="page")
    recorded(readouts, case="read-outs")


@pytest.mark.parametrize("case", ["usual", "everything", "no truth"])
def test_what_a_run_says_of_its_results(case, tmp_path, recorded):
    results = full(tmp_path) if case == "everything" else \
        example_session(tmp_path, truth=case == "usual", chart=case == "usual")
    recorded(compact(run_facts(results, tmp_path / "report.html"), [tmp_path]), case="data")
    recorded(run_text(results).splitlines(), case="text")
