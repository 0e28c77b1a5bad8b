"""Recorded: spectra by name, column and unit, on other wavelengths, and layers of pictures."""
import numpy as np
import pytest
from recorded_refusals import placeless, said

from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.published.aces_idt import aces_idt
from spectrabox.radiometry.records import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.beside import envi_partner, metadata_beside
from spectrabox.radiometry.spectra.formats.table import SpectralTable
from spectrabox.radiometry.spectra.kept_cameras import (
    cameras_folder,
    keep_camera,
    own_cameras,
    require_new_name,
)
from spectrabox.radiometry.spectra.light_words import vague_words
from spectrabox.radiometry.spectra.named_spectra import (
    light,
    nearest_names,
    relative_response,
    sensitivities,
)
from spectrabox.radiometry.spectra.named_spectra import test_reflectances as sets_of_reflectances
from spectrabox.radiometry.spectra.pchip import pchip
from spectrabox.radiometry.spectra.readings import ReadingOutcome
from spectrabox.radiometry.spectra.resampling import resampled, sprague
from spectrabox.radiometry.spectra.spectral_layers import (
    MULTIPLES,
    layer_names,
    layout_attributes,
    spectral_layers,
)
from spectrabox.radiometry.spectra.spectrum_files import (
    SI_FACTORS,
    column_index,
    format_of,
    on_grid,
    read_curves,
    read_reflectances,
    read_spectrum,
    read_table,
    spectrum_of,
    spectrum_on_grid,
    table_text,
)
from spectrabox.radiometry.spectra.stated_light import spectrum_of_name, stated_light, vague_light

GRID = grid_from_nm(np.array([400.0, 437, 461, 512, 555, 611, 660, 700]))
RNG = np.random.default_rng(31)


def test_interpolated_samples(recorded):
    uneven = np.array([390.0, 402, 409, 431, 455, 470.5, 502, 540, 610, 705])
    jumpy, smooth = RNG.uniform(0, 1, (2, 10)), np.sin(uneven / 60)
    even = np.linspace(390, 710, 17)
    at = np.array([390.0, 391, 405, 431, 468, 500, 609.5, 640, 705])
    recorded({
        "pchip": [pchip(uneven, values, at) for values in (*jumpy, smooth)],
        "rows": pchip(uneven, jumpy, at), "two": pchip(uneven[:2], jumpy[:, :2], uneven[:2] + 0.1),
        "overshoot": pchip(np.array([0.0, 1, 3, 4]), np.array([0.0, 0.1, 5.0, -5]),
                           np.array([0.2, 0.7, 2.5, 3.5, 3.9])),
        "sprague": sprague(even, np.cos(even / 40), at)})
    found = {}
    for name, nm in (("even", even), ("uneven", uneven), ("five", even[:5])):
        values = RNG.uniform(0, 1, nm.size)
        for first, last, step in ((400, 460, 5.0), (400, 460, 20.0), (395, 455, 30), (390, 470, 40),
                                  (380, 460, 10), (400, 720, 10)):
            target = np.arange(first, last + 1, step)
            found[f"{name} {first} {step}"] = said(
                lambda nm=nm, values=values, target=target: resampled(nm, values, target, "lamp"))
    values = np.linspace(1, 2, 17)
    for off in (0.9e-6, 1.1e-6):    # beyond the ends
        found[f"ends {off}"] = said(
            lambda off=off: resampled(even, values, np.array([390 - off, 400, 410]), "lamp")[1])
    for off in (0.9e-5, 1.1e-5):    # of even steps of 10
        found[f"steps {off}"] = said(
            lambda off=off: resampled(even, values, np.array([400, 410, 420 + off]), "lamp")[1])
    found["falling"] = said(lambda: resampled(even, values, np.array([420.0, 410, 400]), "lamp"))
    found["one"] = said(lambda: resampled(even, values, np.array([420.0]), "lamp"))
    recorded(found, case="resampled")


def test_spectra_on_a_grid(recorded):
    fine, coarse = np.arange(395.0, 705.5, 2.5), np.arange(395.0, 706, 7.5)
    found = {name: on_grid(nm, np.stack([np.sin(nm / 37), np.cos(nm / 50)]), GRID, "lamp")
             for name, nm in (("fine", fine), ("coarse", coarse), ("between", fine * 1.003 - 1.5),
                              ("mixed", np.r_[fine[:40], fine[40::4], 708.0]))}
    for off in (0.9e-6, 1.1e-6):
        ends = np.linspace(400 + off, 700 - off, 40)
        found[f"{off}"] = said(lambda ends=ends: on_grid(ends, ends, GRID, "lamp")[[0, -1]])
    recorded(found)

    def holed(gap, step, start=470.0):
        nm = np.r_[np.arange(390.0, start + 0.1, step), np.arange(start + gap, 711 + step, step)]
        spectrum = Spectrum(grid_from_nm(nm), nm / 500, Quantity.RELATIVE, "a lamp")
        return said(lambda: spectrum_on_grid(spectrum, GRID)[2:5])
    recorded({f"{gap} {step} {start}": holed(gap, step, start) for gap, step, start in (
        (19.5, 5, 470), (20, 5, 470), (20.5, 5, 470), (29.5, 10, 470), (30, 10, 470),
        (30.5, 10, 470), (25, 2, 470), (45, 20, 470), (61, 20, 470), (61, 20, 390),
        (9.9, 5, 390), (35, 5, 395))}, case="holes")


def _table(names=("a", "standard_error", "", "b"), facts=None, column_facts=None, main=None, top=1):
    nm = np.array([390.0, 400, 500, 700, 710])
    values = top * np.array([[2.1, 0.2, 0.3, 0.5, 3], [0.01, 0.02, 0.03, 0.05, 0.06],
                             [1, 2, 3, 4, 5], [0.4, np.nan, 0.6, 0.7, 0.8]])[:len(names)]
    return SpectralTable(nm, names, values, facts or {}, "x.csv", main, column_facts or {})


def test_columns(recorded):
    table = _table()
    asked = (None, "a", "b", "c", 1, 2, 3, 4, 5, 6, 0, -1)
    recorded({f"{column!r} {wavelength}": said(
        lambda c=column, w=wavelength: column_index(table, c, w)) for column in asked
        for wavelength in (1, 3)})
    many = _table(tuple(f"p{number}" for number in range(26)))
    recorded({"one": column_index(_table(("a", "standard_error")), None),
              "main": [column_index(_table(main="b"), column) for column in (None, "a", 2, "b")],
              "errors": [said(lambda n=names: column_index(_table(n), None)) for names in (
                  ("standard_error a", "a"), ("a", "a standard_error"))],
              "alike": said(lambda: column_index(_table(("a", "a")), "a")),
              "many": said(lambda: column_index(many, None)),
              "as many": said(lambda: column_index(_table(many.names[:24]), None))}, case="others")


def test_quantities_and_units(recorded):
    roles = list(Quantity)
    found = {}
    for stated in ("reflectance", "IRRADIANCE", "radiance", "relative", "flux", None):
        for role in roles:
            table = _table(facts={} if stated is None else {"quantity": stated})
            found[f"{stated} {role.name}"] = said(
                lambda table=table, role=role: spectrum_of(table, role=role, column="a").quantity)
    recorded(found)
    units = (*SI_FACTORS, *(member.value for member in roles), "mW  m-2 nm-1", "lux", None)
    recorded({f"{unit}": said(lambda unit=unit: spectrum_of(_table(
        facts={} if unit is None else {"unit": unit, "source": "a lamp"}), role=Quantity.RADIANCE,
        column="a")) for unit in units}, case="units")
    recorded({"of a column": spectrum_of(_table(facts={"unit": "%"}, column_facts={
        "b": {"unit": "1"}}), role=Quantity.REFLECTANCE, column="b"),
        "empty": said(lambda: spectrum_of(_table(("a",), top=np.nan), role=Quantity.RADIANCE))},
        case="columns")


def test_reflectances_that_cannot_be(recorded):
    def read(top, bottom, nm=(400.0, 500.0, 700.0)):
        table = SpectralTable(np.array(nm), ("a",), np.array([[bottom, 0.5, top]]), {}, "x.csv")
        return said(lambda: spectrum_of(table, role=Quantity.REFLECTANCE).values)
    recorded({f"{top} {bottom}": read(top, bottom) for top, bottom in (
        (1.98, 0), (2.0, 0), (2.02, 0), (100, 0), (1, -0.0196), (1, -0.02), (1, -0.0204))}
        | {"beyond": read(90, -3, (399.0, 500.0, 701.0)), "nowhere": read(9, 9, (300, 310, 320))})


def test_spectra_of_files(recorded, tmp_path, monkeypatch):
    nm = np.arange(395.0, 706, 5)
    columns = {"R": 0.2 + 0.1 * np.sin(nm / 30), "standard_error": nm / 1e5,
               "G": 0.3 + 0.1 * np.cos(nm / 30), "standard_error G": nm / 1e4,
               "own standard_error": 0.5 + nm / 1e4}
    path = tmp_path / "own.csv"
    path.write_text(table_text(nm, columns, quantity=Quantity.REFLECTANCE, source="ours"), "utf-8")
    (tmp_path / "own.sp").write_text(path.read_text("utf-8"), "utf-8")
    recorded({
        "table": read_table(path).notes, "named": read_table(tmp_path / "own.sp").notes,
        "spectrum": read_spectrum(path, role=Quantity.REFLECTANCE, column="G"),
        "curves": read_curves(path), "some": read_curves(path, ["G"]),
        "by number": read_curves(path, [4, 2]), "reflectances": read_reflectances(path, GRID),
        "missing": said(lambda: read_table(tmp_path / "no.csv"), tmp_path),
        "folder": said(lambda: read_table(tmp_path), tmp_path)})
    (tmp_path / "holed.csv").write_text("nm,a\n400,1\n410,\n", "utf-8")
    starts = {"zip": b"PK\x03\x04", "excel": b"\xd0\xcf\x11\xe0", "pdf": b"%PDF", "png": b"\x89PNG",
              "jpeg": b"\xff\xd8\xff", "tiff": b"II*\x00", "hdf": b"\x89HDF", "mat": b"MATLAB",
              "gz": b"\x1f\x8b", "exr": b"\x76\x2f\x31\x01", "envi": b"\xef\xbb\xbfENVI\nx = 1",
              "csv": b"nm,a", "nul": b"nm\x00"}
    recorded({"holed": said(lambda: read_curves(tmp_path / "holed.csv")),
              "formats": {name: said(lambda start=start: format_of(start + b"\n1,2\n",
                                                                   tmp_path / "a.csv"))
                          for name, start in starts.items()},
              "binary": format_of(b"\x00", tmp_path / "a.sli")}, case="formats")
    from spectrabox.radiometry.spectra import spectrum_files
    size = path.stat().st_size
    found = {}
    for limit in (size - 1, size):
        monkeypatch.setattr(spectrum_files, "MAX_FILE_BYTES", limit)
        found[f"{limit - size}"] = said(lambda: read_table(path).names)
    recorded(found, case="large")


HALVES = (
    '{"a": 1}', '["spectral_data"]', ' {"spectral_data": 1}', "Spectral Data 380[nm]",
    "Model Name\tX", "Spectral Data 380[nm],1", "\ufeffModel Name\tX\n380nm\t1",
    "Model Name\tX\r380nm\t1", "\n380nm\t1",
    "BEGIN_DATA_FORMAT", "BEGIN_DATA", "BEGIN_DATA_FORMAT BEGIN_DATA",
    "<a>colorexchangeformat.com</a>", "colorexchangeformat.com",
    "<a>" + 3975 * " " + "ColorExchangeFormat.com", "<a>" + 3974 * " " + "ColorExchangeFormat.com",
    "<a>iestm27</a>", "iestm27", "<SpectralDistribution/>", "<a>" + 4000 * " " + "IESTM27",
    "Spectra Vista\ndata=\n", "Spectra Vista\n", "data= \n", 190 * " " + "Spectra Vista\ndata =",
    187 * " " + "Spectra Vista\ndata =", "Data:\nWvl", "Data:\n\"Wvl", "Wvl", "Data:\nx Wvl",
    "Data:\nChan.#\tWvl", "Data:\n\"Chan\",Wvl", "Data:\nChan Wvl", "ASD", "as2", "as7")


def test_how_formats_are_told_apart(recorded, tmp_path):
    path = tmp_path / "a.txt"
    found = {f"{number} {half.strip()[:24]!r}": said(
        lambda half=half: format_of(half.encode(), path)) for number, half in enumerate(HALVES)}
    for start in (b"ASD", b"as1", b"as2", b"as8", b"as9"):
        found[f"{start} and nul"] = [said(lambda end=end, start=start: format_of(
            start + end, path)) for end in (b"\x00", 480 * b" " + b"\x00", 481 * b" " + b"\x00")]
    for start in (b"ENVI", b"\n ENVI", 195 * b" " + b"ENVI", 197 * b" " + b"ENVI"):
        found[f"{start.strip()} {len(start)}"] = [said(lambda end=end, start=start: format_of(
            start + end, path)) for end in (b"\na = 1", b"\na")]
    recorded(found)


def test_files_that_lie_beside(recorded, tmp_path):
    for name in ("a.hdr", "a.sli", "b.hdr", "b", "c.sli.hdr", "c.sli", "d.sli", "e.hdr", "f.lib",
                 "f.hdr", "f.slb"):
        (tmp_path / name).write_text("")
    found = {path.name: partner.name if (partner := envi_partner(path)) else None
             for path in sorted(tmp_path.iterdir())}
    recorded(found | {"metadata": metadata_beside(tmp_path / "x.csv").name})


def test_layers_of_pictures(recorded):
    nm = np.array([400.0, 1000.25, 512.123456789])
    recorded({
        "names": [layer_names(nm), layer_names(nm, "S0")],
        "attributes": {f"{each}": layout_attributes(each) for each in (*Quantity, "deviation")},
        "layers": {" ".join(names): spectral_layers(names, first=first) for names, first in (
            (["T.560,000000nm", "S0.400nm", "T.420nm", "R"], "T"),
            (["T.560nm", "S0.500nm", "S0.400nm", "S1.450nm", "a.S2.400nm"], "S0"),
            (["400nm", "410,5 nm", "0nm"], "T"), (["x.400nm", "y.410nm", "left.x.390nm"], "S0"),
            (["T.400nm.500nm", "R", "G"], "T"), (["S0.5e14Hz", "S0.0,55um", "S0.600THz"], "T"))},
        "units": {unit: spectral_layers([f"T.3{unit}m", f"T.3{unit}Hz"], first="T")[1]
                  for unit in MULTIPLES}})


def test_lights_and_cameras_by_name(recorded, tmp_path, monkeypatch):
    monkeypatch.setenv("SPECTRABOX_CAMERAS", str(tmp_path / "kept"))
    nm = np.arange(390.0, 712, 4)
    curves = {"R": np.exp(-((nm - 610) / 45) ** 2), "standard_error R": nm / 1e6,
              "B": 0.7 * np.exp(-((nm - 455) / 35) ** 2)}
    kept = keep_camera("Own/1", nm, curves, "fitted")
    recorded({"file": kept.name, "text": kept.read_text("utf-8")[:300],
              "own": list(own_cameras()), "curves": sensitivities("Own-1", GRID),
              "response": relative_response("Own-1", "FL3.15", GRID),
              "observer": sensitivities("CIE 1931 2 Degree Standard Observer", GRID),
              "fine": relative_response("Nikon 5100 (NPL)", "LED-B3"),
              "lights": [light(name, GRID) for name in ("A", "D65", "E", "FL2")],
              "near": [nearest_names(name, ["D65", "d50", "LED-B3", "FL2"])
                       for name in ("d6", "D 50", "led b", "zzz")],
              "words": [said(lambda word=word: sensitivities(word, GRID)) for word in
                        ("Nikon 510", "zzzzqqqq", "no.csv")],
              "unknown": said(lambda: light("D66", GRID)),
              "new": [said(lambda name=name: require_new_name(name)) for name in
                      ("Nikon 5100 (NPL)", ".x", "fine", "x" * 80, "x" * 81, "")]})
    np.testing.assert_allclose(relative_response("Own-1", "A", GRID).sum(axis=1), 1, rtol=1e-12)
    monkeypatch.delenv("SPECTRABOX_CAMERAS")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    folders = [placeless(str(cameras_folder()), tmp_path)]
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    recorded([*folders, placeless(str(cameras_folder()), tmp_path), own_cameras()], case="folders")


def test_lights_that_cannot_be(recorded, tmp_path):
    def read(name, values):
        path = tmp_path / f"{name}.csv"
        path.write_text(table_text(GRID.nm, {"v": np.array(values)}, quantity=Quantity.RELATIVE,
                                   source="x"), "utf-8")
        return said(lambda: light(str(path), GRID), tmp_path)
    base = np.linspace(0.5, 2.0, 8)
    recorded({f"low {low}": read(f"low {low}", np.r_[base[:3], low, base[4:]])
              for low in (-0.0198, -0.0202, 0.0)} | {"dark": read("dark", 0 * base)})
    path = tmp_path / "blind.csv"
    blind = {"R": base, "B": np.where(GRID.nm > 450, 0, 1.0), "none": 0 * base}
    path.write_text(table_text(GRID.nm, blind, quantity=Quantity.RELATIVE, source="x"), "utf-8")
    recorded(said(lambda: sensitivities(str(path), GRID), tmp_path), case="blind")
    del blind["none"]
    path.write_text(table_text(GRID.nm, blind, quantity=Quantity.RELATIVE, source="x"), "utf-8")
    read("red", np.where(GRID.nm > 450, base, 0))
    recorded(said(lambda: relative_response(str(path), str(tmp_path / "red.csv"), GRID), tmp_path),
             case="no light")


@pytest.mark.parametrize("call", [vague_words, vague_light])
def test_words_for_lights(recorded, call):
    recorded({word: said(lambda word=word: call(word)) for word in (
        "unknown", "led", "LED", "halogen", "3200K", "1499K", "1500K", "25000K", "25001K",
        "3200.5K", "3.2.0K", "K", "-1K", "D65")})


def test_stated_lights(recorded, tmp_path):
    path = tmp_path / "lamp.csv"
    path.write_text(table_text(GRID.nm, {"v": GRID.nm / 500}, quantity=Quantity.IRRADIANCE,
                               source="lamp"), "utf-8")
    recorded({"file": stated_light(str(path), GRID), "name": stated_light("FL2", GRID),
              "vague": stated_light("daylight", GRID),
              "unknown": said(lambda: spectrum_of_name("FL99x", GRID)),
              "words": [UnknownLight().words, UnknownLight("led").words,
                        UnknownLight(None, 2700.4).words, UnknownLight("led", 3000.0).words],
              "readings": {each.name: (each.has_spectrum, each) for each in ReadingOutcome}})


def test_published_sets(recorded):
    recorded(sets_of_reflectances(GRID))


def test_transform_of_aces(recorded):
    nm = np.arange(400.0, 701, 10)
    curves = np.array([np.exp(-((nm - peak) / width) ** 2)
                       for peak, width in ((605, 44), (538, 51), (457, 33))])
    # an optimiser's end
    recorded(aces_idt(nm, curves, "D55"), rtol=1e-4)
