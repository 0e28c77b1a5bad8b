"""What every driver makes of a bad reply to each of its commands: recorded."""
import ast

import pytest
from simulated_instruments import BAUD, SIMULATED, obeyed, one, session

from spectrabox.capture.meter.instruments.interface import MeterSettings

NOTHING = MeterSettings()


def _carried_out(monkeypatch, name, replies, wanted=NOTHING, **options):
    return session(monkeypatch, name, replies, wanted, options.pop("baud", BAUD[name]), **options)


WRONG = {  # what may come in place of a reply
    "silence": lambda parts: [],
    "half of it": lambda parts: [(delay, data[:len(data) // 2]) for delay, data in parts],
    "noise": lambda parts: [(delay, data[:3] + b"\x9f\x80" + data[3:]) for delay, data in parts],
    "twice": lambda parts: [(delay, data + data) for delay, data in parts],
    "a digit changed once": None,
    "another language": lambda parts: [(0.02, b"?-\r\n")]}


def _digit_changed(data):
    """The last digit but two raised by one: inside a number, wherever it stands."""
    places = [at for at, byte in enumerate(data) if 0x30 <= byte <= 0x39]
    if not places:
        return data + b"7"
    at = places[max(len(places) - 3, 0)]
    return data[:at] + bytes([0x30 + (data[at] - 0x2F) % 10]) + data[at + 1:]


@pytest.mark.parametrize("name", SIMULATED)
def test_a_bad_reply_to_every_command(monkeypatch, recorded, name):
    wanted = {"cs2000": MeterSettings(60.0), "pr650": NOTHING}.get(name, MeterSettings(averages=3))
    clean = _carried_out(monkeypatch, name, SIMULATED[name](), wanted)
    asked = dict.fromkeys(ast.literal_eval(line.partition(" ")[2].partition(" typed")[0])
                          for line in clean["heard"] if "'" in line)
    for case, change in WRONG.items():
        table = {}
        for command in asked:
            replies = SIMULATED[name]()
            said = replies.get(command.encode("latin-1"), one(obeyed(command)))
            if not any(data for _, data in said[0]):
                continue
            bad = ([(delay, _digit_changed(data)) for delay, data in said[0]] if change is None
                   else change(said[0]))
            replies[command.encode("latin-1")] = [bad, *said] if change is None else [bad]
            table[command] = _short(_carried_out(monkeypatch, name, replies, wanted))
        recorded(table, case=case)


def _short(result):
    if "error" not in result:
        return " ".join(f"{reading['outcome']} {reading['luminance']} {reading['serial_number']}"
                        for reading in result["readings"]) + f" {result['heard'][-1]}"
    kind, _, words = result["error"]
    return " | ".join([kind, words[:110], *result["not put back"], *result["heard"][-3:]])


def test_an_instrument_that_was_told_nothing_is_not_waited_for(monkeypatch):
    """Bytes that came unasked keep the command from being sent: nothing measures."""
    replies = SIMULATED["cr250"](said={"RC Firmware\r": "OK:0:RC Firmware:1.26\r\n"})
    replies[b"SM ExposureX 3\r"] = [[(0.02, b"OK:0:SM ExposureX:No errors\r\n" * 2)]]
    result = _carried_out(monkeypatch, "cr250", replies, MeterSettings(averages=3))
    assert result["error"][0] == "LineFaultError" and "M\\r" not in str(result["heard"]).replace(
        "SM", "")
    # pauses, and the answer to the command that puts the setting back
    assert float(result["heard"][-1].split()[0]) < 5.0
