"""A serial line keeps its own deadlines and says what is wrong with it."""
import errno
import os
import threading
import time

import pytest
import serial

from spectrabox.capture.meter.instruments.instrument_errors import (
    LineFaultError,
    LineLostError,
    NoReplyError,
    PortError,
)
from spectrabox.capture.meter.serial_line import Pace, list_ports, open_line

BAUD = 9600


def silent(direction, data):
    pass


@pytest.fixture
def line():
    master, slave = os.openpty()
    import tty
    tty.setraw(slave)
    opened = open_line(os.ttyname(slave), BAUD, silent)
    yield opened, master
    opened.close()
    for end in (master, slave):
        try:
            os.close(end)
        except OSError:
            assert end is not None  # the test closed it: the cable was pulled


def test_a_line_that_dribbles_ends_at_the_deadline(line):
    opened, master = line
    stop = threading.Event()

    def dribble():
        while not stop.wait(0.05):
            os.write(master, b"x")
    thread = threading.Thread(target=dribble)
    thread.start()
    started = time.monotonic()
    with pytest.raises(NoReplyError,
                       match=r"no complete reply within 0\.4 s \(only \d+ bytes came"):
        opened.read_line(0.4)
    seconds = time.monotonic() - started
    stop.set()
    thread.join()
    # One inner read of 0.02 s past the limit; the rest is for a busy computer. pyserial's own
    # readline never ends here.
    assert 0.4 <= seconds < 1.4


def test_bytes_nobody_asked_for_are_an_error_and_not_the_next_reply(line):
    opened, master = line
    os.write(master, b"OK00\n")
    time.sleep(0.05)
    with pytest.raises(LineFaultError, match=r"sent 'OK00' unasked"):
        opened.write(b"IDDR\n")


@pytest.mark.parametrize("data", [b"OK\xff00\n", b"OK\x0000\n", b"\x9fOK00\n"])
def test_bytes_that_are_no_text_are_a_fault_of_the_line(line, data):
    opened, master = line
    os.write(master, data)
    with pytest.raises(LineFaultError,
                       match="is not text; the speed is wrong or the line is noisy"):
        opened.read_line(1.0)


def test_a_pulled_cable_is_one_sentence(line):
    opened, master = line
    slave_name = opened.name
    os.close(master)
    with pytest.raises(LineLostError, match=r"the line broke .*readings already taken are kept"):
        for _ in range(50):
            opened.send(b"MEAS,1\n")
            opened.drain(0.02)
    assert slave_name in opened.name


def test_two_programs_cannot_use_one_port(line):
    opened, _ = line
    with pytest.raises(PortError, match="is in use by another program"):
        open_line(opened.name, BAUD, silent)


def test_a_missing_port_is_named_with_those_that_exist():
    with pytest.raises(
            PortError,
            match=r"there is no port /dev/ttyNONE; ports of this computer: .*meter list"):
        open_line("/dev/ttyNONE", BAUD, silent)


def test_a_refused_port_names_the_group(monkeypatch, tmp_path):
    port = tmp_path / "ttyUSB0"
    port.touch()

    def refuse(*args, **kwargs):
        raise serial.SerialException(errno.EACCES, "could not open port")
    monkeypatch.setattr(serial, "serial_for_url", refuse)
    import grp
    group = grp.getgrgid(port.stat().st_gid).gr_name
    with pytest.raises(PortError, match=f"belongs to the group {group}; run 'sudo usermod -aG "
                       f"{group} "):
        open_line(str(port), BAUD, silent)


def test_a_port_address_that_cannot_be_is_refused():
    with pytest.raises(PortError, match="cannot be opened"):
        open_line("nonsense://x", BAUD, silent)


def test_listing_the_ports_opens_none(monkeypatch):
    monkeypatch.setattr(serial, "serial_for_url", lambda *args,
                        **kwargs: pytest.fail("a port was opened"))
    monkeypatch.setattr(serial.Serial, "open", lambda self: pytest.fail("a port was opened"))
    assert all(each.device for each in list_ports())


def test_a_pace_never_shortens_a_limit_below_what_the_computer_needs():
    pace = Pace(scale=0.001, shortest_limit_s=0.2)
    assert pace.limit_s(10) == 0.2 and pace.limit_s(1000) == 1.0
    assert Pace().limit_s(10) == 10


def test_what_came_in_time_is_read_though_the_computer_looks_too_late(line, monkeypatch):
    opened, master = line
    os.write(master, b"OK00\nA")
    while opened._port.in_waiting < 6:      # the system hands them over when it likes
        time.sleep(0.01)
    times = iter([0.0, *[100.0] * 9])
    monkeypatch.setattr(time, "monotonic", lambda: next(times))
    assert opened.read_line(1.0) == "OK00"
    times = iter([0.0, *[100.0] * 9])
    assert opened.read_byte(b"A", 1.0) == b"A"
    times = iter([0.0, *[100.0] * 9])
    with pytest.raises(NoReplyError, match="nothing came"):
        opened.read_line(1.0)
