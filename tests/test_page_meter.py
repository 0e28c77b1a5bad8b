"""A marked colour measured from the page, in a real browser, with what a genuine CR30 said."""
import json
import os
import socket
import tomllib

import pytest
from served_page import asked, drag, opened_in, served, wait_for, wait_ready

from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.fixtures.line_faults import Fault, FaultKind, distortion

from tests.cr30_player import FOLDER, measurements, playing, steps_of

CALIBRATED = FOLDER / "Calibrate_White_and_Black_and_Test_Target.spm"
WHITE, BLACK, _ = steps_of(CALIBRATED)
GREEN, = measurements(FOLDER / "Test_Sample_36.61_-20.75_-2.86.spm")
PRESSED, = measurements(FOLDER / "button_presses_and_disconnected_presses.spm")


@pytest.fixture(autouse=True)
def fast(monkeypatch):
    monkeypatch.setenv("SPECTRABOX_METER_PACE", "0.1")


def regions_of(folder):
    return tomllib.loads((folder / "session.toml").read_text(encoding="utf-8"))["regions"]


def test_a_mark_is_measured_by_a_click_and_by_the_instruments_button(browser, calibrated_flat):
    session = calibrated_flat
    player = playing([WHITE, BLACK, GREEN, PRESSED])
    with player, served(session, meter_ports=[player.port]) as (address, _), \
            opened_in(browser) as open_address:
        page = open_address(address)
        wait_ready(page)
        name = next(iter(regions_of(session)))
        page.click(f'#marks li[data-name="{name}"] .lab')
        page.click(f'[aria-label="Measure {name} now"]')
        page.fill("#meter-port", player.port)
        assert page.is_disabled("#meter-measure")       # before both calibrations
        page.click("#meter-white")
        page.wait_for_selector("#panel:has-text('White is calibrated')")
        assert page.is_disabled("#meter-measure")
        page.click("#meter-black")
        page.wait_for_selector("#meter-measure:not([disabled])")
        page.click("#meter-measure")
        # the file that the session has already keeps its name
        wait_for(lambda: regions_of(session)[name].get("truth") == f"spectra/{name}-2.csv")
        page.wait_for_selector("#looked-plot .truth")       # drawn beside the band
        page.wait_for_selector("#looked-words:has-text('Measured')")
        wait_for(lambda: "93.6" not in page.inner_text("#looked-words"))
        text = (session / "spectra" / f"{name}-2.csv").read_text()
        assert "calibration of the instrument: white 2" in text
        stored = json.loads((session / "spectra" / "readings" / f"{name}-2" / "001.json")
                            .read_text())
        assert stored["lab"] == pytest.approx((36.61, -20.75, -2.86), abs=0.01)
        # the next one by the button, which is pressed while the panel is open
        page.click(f'[aria-label="Measure {name} now"]')
        wait_for(lambda: regions_of(session)[name]["truth"] == f"spectra/{name}-3.csv")
        stored = json.loads((session / "spectra" / "readings" / f"{name}-3" / "001.json")
                            .read_text())
        assert stored["lab"] == pytest.approx((38.68, -19.64, -7.89), abs=0.01)
        page.wait_for_selector("#panel", state="hidden")
        page.wait_for_selector("#undo:not([disabled])")
        page.keyboard.press("Control+z")                # the earlier reading again
        wait_for(lambda: regions_of(session)[name]["truth"] == f"spectra/{name}-2.csv")
    assert not player.problems


def test_a_reading_without_calibration_is_asked_for_and_says_so(browser, calibrated_flat):
    session = calibrated_flat
    player = playing([GREEN])
    with player, served(session, meter_ports=[player.port]) as (address, _), \
            opened_in(browser) as open_address:
        page = open_address(address)
        wait_ready(page)
        drag(page, 40, 240, 80, 280)
        page.wait_for_selector('[aria-label="Measure sample 1 now"]')
        page.click('[aria-label="Measure sample 1 now"]')
        page.fill("#meter-port", player.port)
        page.check("#meter-without")
        page.click("#meter-measure")
        wait_for(lambda: regions_of(session)["sample 1"].get("truth"))
    assert "none before these readings" in (session / "spectra" / "sample 1.csv").read_text()


def test_an_instrument_that_is_not_there_or_breaks_off_is_said(calibrated_flat):
    clean = playing([GREEN]).transcript
    replies = [step for step, event in enumerate(clean.events) if event.direction == "<"]
    broken = TranscriptPlayer(clean, time_scale=0.0, distort=distortion(
        Fault(FaultKind.DISCONNECT, replies[7])))
    step = {"what": "measure", "name": "wall"}
    with broken, served(calibrated_flat, meter_ports=[broken.port]) as (address, _):
        status, answer = asked(f"{address}/api/meter/step", step | {"port": "/dev/ttyNONE"})
        assert status == 409 and "there is no port '/dev/ttyNONE'" in answer["error"]
        status, answer = asked(f"{address}/api/meter/step", step | {"port": broken.port})
        assert status == 409 and "the line broke" in answer["error"]
        status, answer = asked(f"{address}/api/meter")
        assert status == 200 and answer["port"] == "" and answer["calibrated"] == []
        status, answer = asked(f"{address}/api/meter/step", {"what": "explode", "name": "wall",
                                                             "port": "x"})
        assert status == 409 and "no step" in answer["error"]
    assert not (calibrated_flat / "spectra" / "wall.csv").exists()


def test_the_page_opens_listed_ports_alone_whatever_a_request_names(calibrated_flat, tmp_path):
    """pyserial's addresses empty files (spy://) and speak to other computers (socket://)."""
    file = tmp_path / "of the user"
    file.write_text("kept")
    with socket.create_server(("127.0.0.1", 0)) as listening, \
            served(calibrated_flat) as (address, _):
        listening.settimeout(0.5)
        number = listening.getsockname()[1]
        for port in (f"spy:///dev/null?file={file}", f"spy://{os.devnull}?file={file}&all",
                     f"socket://127.0.0.1:{number}", f"rfc2217://127.0.0.1:{number}",
                     "loop://", "hwgrep://.*", "alt:///dev/null", "cp2110://", os.devnull,
                     str(file), "", "../" + os.devnull):
            status, answer = asked(f"{address}/api/meter/step", {"what": "measure", "name": "wall",
                                                                 "port": port})
            assert status == 409 and "there is no port" in answer["error"], (port, answer)
        with pytest.raises(TimeoutError):
            listening.accept()
    assert file.read_text() == "kept"
