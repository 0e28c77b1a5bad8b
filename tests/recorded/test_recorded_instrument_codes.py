"""What every driver makes of every status and error code of the manuals, and of variants of its
instrument: recorded.
"""
import pytest
from simulated_instruments import BAUD, D602, SIMULATED, session

from spectrabox.capture.meter.instruments import cr250, jeti
from spectrabox.capture.meter.instruments import cs2000 as cs2000_driver
from spectrabox.capture.meter.instruments.interface import MeterSettings

NOTHING = MeterSettings()
VARIANTS = {
    "cs2000": {"A without variant": {"said": {"IDDR\n": "OK00,CS-2000  ,1,10012345\n"}},
               "old firmware": {"said": {"RMTS,2\n": "ER17\n", "RMTS,1\n": "OK00\n",
                                         "SPMR\n": "OK00,0\n"}},
               "older firmware": {"said": {"RMTS,2\n": "ER00\n", "RMTS,1\n": "OK00\n"}},
               "filter on": {"said": {"SPMR\n": "OK00,2,3,1\n"}},
               "filter off": {"said": {"SPMR\n": "OK00,3,20000,0\n"}},
               "fast, filter on": {"said": {"SPMR\n": "OK00,1,1\n"}},
               "multi, no filter stated": {"said": {"SPMR\n": "OK00,4,1\n"}}},
    "cr250": {"irradiance, 1 nm": {"unit": 1, "step": 1},
              "echo": {"said": {"\r": [[(0.02, b"\r\n>")], []], "E\r": [[]]}},
              "old dialect": {"said": {"SM ExposureX 3\r": "OK:0:ExposureX:No errors\r\n",
                                       "M\r": "OK:102:M:limit\r\n"}},
              "value repeated": {"said": {"SM ExposureX 3\r": "OK:0:SM ExposureX 3:No\r\n"}},
              "as wanted already": {"said": {"RS ExposureX\r": "OK:0:RS ExposureX:3\r\n",
                                             "RS SyncMode\r": "OK:0:RS SyncMode:2 Manual\r\n"}},
              "words": {"said": {"RS ExposureX\r": "OK:0:RS ExposureX:Single\r\n"}},
              "photometer": {"said": {"RC InstrumentType\r": "OK:0:RC InstrumentType:0\r\n"}}},
    "pr655": {"irradiance, 2 nm": {"unit": 1, "step": 2},
              "metric, fixed": {"said": {"D602\r": "00000," + D602.replace("English", "SI").replace(
                  "Adaptive,0 msec", "Fixed,250 msec").replace("1 cycles", "12 cycles") + "\r\n"}},
              "sync on": {"said": {"D602\r": "00000," + D602.replace("No Sync", "Auto Sync")
                                   + "\r\n"}},
              "other frequency": {"said": {"D602\r": "00000," + D602.replace("60.00", "59.94")
                                           + "\r\n"}},
              "no frequency": {"said": {"D602\r": "00000," + D602.replace("60.00 Hertz", "-")
                                        + "\r\n"}},
              "echo": {"said": {"D111\r": [[(0.02, b"D111\r\n")], [(0.02, b"00000,PR-655\r\n")]]}},
              "few settings": {"said": {"D602\r": "00000,MS-75,None,None,None\r\n"}},
              "error in readings": {"said": {"M1\r": "-8\r\n"}}},
    "pr650": {"irradiance": {"unit": 1}, "bare returns": {"end": "\r"}, "feeds": {"end": "\n\r"},
              "coded serial number": {"said": {"d110\n": "000,60964418\r\n"}},
              "echo": {"said": {"d110\n": "d110\r\n60964417\r\n"}},
              "echo without an end": {"said": {"d110\n": "d11060964417\r\n"}}},
    "specbos1211": {"irradiance": {"head": 1}, "one header": {"label": "\r"},
                    "enquiries": {"said": {"*CONF:FUNC 6\r": "\x05\x05\x06", "*idn?\r":
                                           "\x05JETI_SB1211\r"}},
                    "old firmware": {"said": {"*FETCH:XYZ\r": "\x15", "*vers?\r": "1.48\rJun 07\r",
                                              "*stat:err?\r": "Error Code: 4 command\r"}},
                    "no laser": {"said": {"*CONTR:LASER 0\r": "\x15"}},
                    "spectrocal": {"said": {"*idn?\r": "SpectroCAL\r"}}},
    "specbos2501": {"other range": {"wran": "350 830 2"}, "named": {
        "said": {"*para:form?\r": "form: 0\r", "*para:form 0\r": "\x06",
                 "*para:spnum?\r": "spectrometer number: 417\r"}},
                    "acknowledged": {"said": {"*idn?\r": "PECFIRM_JETI_1501\r"}},
                    "words": {"said": {"*para:form?\r": "text\r"}}}}
# (driver, command in which a code may come, how a code is written, codes)
CODES = [("cs2000", "MEAS,1\n", "ER{:02d}\n", (*cs2000_driver.ERRORS, 1, 11, 18, 70, 72, 98)),
         ("cs2000", "IDDR\n", "ER{:02d}\n", cs2000_driver.ERRORS),
         ("cs2000", "MEDR,1,0,3\n", "ER{:02d}\n", cs2000_driver.ERRORS),
         ("cr250", "M\r", "ER:{}:M:text\r\n", (*cr250.ERRORS, -307, -330, -999)),
         ("cr250", "M\r", "OK:{}:M:text\r\n", (0, 99, 100, 101, 102, 103, 104)),
         ("cr250", "RM Spectrum\r", "ER:{}:RM Spectrum:text\r\n", (-500, -331, -334, -335)),
         ("cr250", "SM ExposureX 3\r", "ER:{}:SM ExposureX:text\r\n", (-514, -500, -519)),
         ("pr655", "M1\r", "{}\r\n", (*range(-16, 0), -100)),
         ("pr655", "M1\r", "{:05d},0,1.0e+00,0.3,0.3\r\n", (0, 1, 8, 10)),
         ("pr655", "SU1\r", "{}\r\n", (-1, -8, -14)), ("pr655", "D5\r", "{}\r\n", (-2, -8, -10)),
         ("pr650", "m0\n", "{:03d}\r\n", range(32)), ("pr650", "m0\n", "{}\r\n", (-1, -2, -10)),
         ("pr650", "s01,,,,,0,01,1\n", "{:03d}\r\n", (1, 5, 8, 50)),
         ("pr650", "b1\n", "{:03d}\r\n", (1, 12))]
JETI_CODES = (*jeti.ERRORS, 3, 122, 142, 199, 999)


def _carried_out(monkeypatch, name, replies, wanted=NOTHING, **options):
    return session(monkeypatch, name, replies, wanted, options.pop("baud", BAUD[name]), **options)


@pytest.mark.parametrize("name", SIMULATED)
def test_variants_of_instruments_and_what_is_refused(monkeypatch, recorded, name):
    for case, options in VARIANTS[name].items():
        wanted = {"cr250": MeterSettings(averages=3, sync_hz=75.0),
                  "pr655": MeterSettings(140.0, 2, 100.0),
                  "cs2000": MeterSettings(33.3)}.get(name, NOTHING)
        result = _carried_out(monkeypatch, name, SIMULATED[name](**options), wanted)
        recorded({key: value for key, value in result.items() if key not in ("opened", "limits")},
                 case=case)


@pytest.mark.parametrize("name, command, form, codes", CODES,
                         ids=[f"{name} {command.strip()} {form.strip()[:6]}"
                              for name, command, form, _ in CODES])
def test_every_code_of_the_manuals(monkeypatch, recorded, name, command, form, codes):
    wanted = MeterSettings(averages=3) if "SM " in command else NOTHING
    table = {}
    for code in codes:
        result = _carried_out(monkeypatch, name,
                              SIMULATED[name](said={command: form.format(code)}), wanted)
        table[form.format(code).strip()] = _summary(result)
    recorded(table)


@pytest.mark.parametrize("name, command", [
    ("specbos1211", "*INIT\r"), ("specbos1211", "*FETCH:SPRAD\r"),
    ("specbos1211", "*CONF:FUNC 6\r"), ("specbos2501", "*MEAS:LIGHT 0 1 0\r"),
    ("specbos2501", "*CALC:SPRAD\r"), ("specbos2501", "*para:form 2\r")])
@pytest.mark.parametrize("acknowledged", ["", "\x06"])
def test_every_error_number_of_a_jeti(monkeypatch, recorded, name, command, acknowledged):
    if acknowledged and "MEAS" not in command and "INIT" not in command:
        return
    table = {}
    for number in JETI_CODES if command == "*INIT\r" and acknowledged else JETI_CODES[::4]:
        said = {command: f"{acknowledged}\x15",
                "*stat:err?\r": (f"Error Code: {number} in words\r" if number % 2
                                 else f"{number} \r")}
        table[str(number)] = _summary(_carried_out(monkeypatch, name, SIMULATED[name](said=said)))
    recorded(table)


def _summary(result):
    """How it ended, and what was sent after the last thing that every session sends."""
    ended = result.get("error") or [f"{reading['outcome']} {'; '.join(reading['flags'])}"
                                    for reading in result["readings"]]
    return " | ".join([*map(str, ended), *result["not put back"], *result["heard"][-4:-1]])
