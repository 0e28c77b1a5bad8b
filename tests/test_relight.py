"""The recovered scene under another light."""
import json
import time
from pathlib import Path
from types import SimpleNamespace

import colour
import numpy as np
import OpenImageIO as oiio
import pytest

from spectrabox.measure.scene.relight import colour_spread
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.session.config.session_file import read_session
from spectrabox.session.replayed import OBSERVER
from spectrabox.session.store.locks import outputs_writer

from tests.killed_runs import started
from tests.session_runs import call


def lab_of(reflectance, name):
    weights = sensitivities(OBSERVER, FINE_GRID) * light(name, FINE_GRID) * FINE_GRID.weights_nm
    weights /= weights[1].sum()
    return colour.XYZ_to_Lab(weights @ reflectance, colour.XYZ_to_xy(weights.sum(axis=1)))


@pytest.mark.parametrize("name", ["A", "FL11"])
def test_the_spread_of_the_draws_holds_the_true_colour_under_another_light(finished, name):
    outcome = call("relight", finished, "--light", name, "--width", "48", "--spp", "16", "--device",
                   "cpu", "--json")
    assert outcome.exit_code == 0, outcome.output
    facts = json.loads(outcome.stdout)
    materials = read_session(finished).capture().materials
    for found in facts["colours"]:
        truth = spectrum_on_grid(materials[found["name"]].truth, FINE_GRID)
        apart = colour.delta_E(np.array(found["lab"]), lab_of(truth, name), method="CIE 2000")
        assert 0 < found["delta_e00_median"] < found["delta_e00_95"]
        # four materials: twice the radius of 95 % is rarely exceeded
        assert apart < 2 * found["delta_e00_95"], found
    xyz = oiio.ImageBuf(facts["exr"]).get_pixels(oiio.FLOAT)
    assert xyz.shape == (32, 48, 3)
    assert np.percentile(xyz[..., 1], 99.5) == pytest.approx(1, abs=1e-3)


def test_an_unknown_light_is_named(finished):
    outcome = call("relight", finished, "--light", "FL99", "--device", "cpu")
    assert outcome.exit_code == 3
    assert "'FL99' is no light that is known; nearest are" in outcome.output


def test_draws_that_stand_mode_after_mode_spread_as_shuffled_ones_do():
    rng = np.random.default_rng(4)
    modes = np.where(np.arange(2000) < 1000, 0.3, 0.6)[:, None] * np.ones((1, FINE_GRID.nm.size))
    spectra = modes * (1 + 0.05 * rng.standard_normal((2000, 1)))
    power, matching = light("A", FINE_GRID), sensitivities(OBSERVER, FINE_GRID)
    found = [colour_spread(spectra.mean(axis=0),
                           SimpleNamespace(grid=FINE_GRID, spectra=order), FINE_GRID, power,
                           matching)
             for order in (spectra, rng.permutation(spectra))]
    # 400 draws tell a median to about 5 % of the spread.
    (_, median, upper), (_, shuffled_median, shuffled_upper) = found
    assert upper == pytest.approx(shuffled_upper, rel=0.1)
    assert median == pytest.approx(shuffled_median, rel=0.15)


def test_results_that_a_run_replaced_meanwhile_make_no_picture(finished, monkeypatch):
    from spectrabox.reconstruct.rendering import renderer
    render = renderer.render

    def rendered(*arguments, **options):
        facts = finished / "results" / "sample" / "facts.json"
        kept = json.loads(facts.read_text("utf-8"))
        kept["key"]["capture"] = "another"
        facts.write_text(json.dumps(kept), encoding="utf-8")
        return render(*arguments, **options)
    monkeypatch.setattr(renderer, "render", rendered)
    outcome = call("relight", finished, "--width", "16", "--spp", "1", "--device", "cpu")
    assert outcome.exit_code == 3
    assert "results changed while they were used; run 'spectrabox relight' again" in outcome.output
    assert not list(finished.glob("relit*"))


@pytest.mark.skipif(not Path("/proc/locks").exists(), reason="no /proc/locks on this system")
def test_both_pictures_wait_for_another_that_writes_outputs(finished):
    with outputs_writer(finished):
        waiting = started("relight", str(finished), "--width", "16", "--spp", "1", "--device",
                          "cpu")
        lock = finished / "results" / ".outputs.lock"
        while waiting.poll() is None and not _waits_for(waiting.pid, lock):
            time.sleep(0.01)
        assert waiting.poll() is None and not list(finished.glob("relit*"))
    _, said = waiting.communicate(timeout=60)
    assert waiting.returncode == 0, said
    assert len(list(finished.glob("relit*"))) == 2


def _waits_for(process, lock):
    """Whether a process waits for a lock, by the kernel's own list."""
    rows = Path("/proc/locks").read_text().splitlines()
    return any("->" in row and f" {process} " in row and row.split()[6].endswith(
        f":{lock.stat().st_ino}") for row in rows)
