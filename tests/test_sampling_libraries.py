"""Folders of measured reflectances in all their formats, and damaged ones."""
import bz2
import gzip
import json
import os
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.libraries import (
    read_library,
    read_r_columns,
    usable,
    without_near_duplicates,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior

NM = np.arange(380.0, 781.0, 10)
CURVES = np.array([0.2 + 0.001 * (NM - 380), 0.7 - 0.001 * (NM - 380), np.full(NM.size, 0.4)])
EXPECTED = np.array([np.interp(PRIOR_GRID.nm, NM, curve) for curve in CURVES])


def text(value):
    return struct.pack(">ii", 9, len(value)) + value.encode()


def r_file(columns):
    """A data frame as R would save it, version 2 of the format."""
    symbol = struct.pack(">i", 1)
    names = struct.pack(">ii", 16, len(columns)) + b"".join(text(name) for name in columns)
    values = b"".join(struct.pack(">ii", 14, len(column)) + np.asarray(column, ">f8").tobytes()
                      for column in columns.values())
    frame = struct.pack(">ii", 19 | 1 << 9, len(columns)) + values
    attributes = struct.pack(">i", 2 | 1 << 10) + symbol + text("names") + names + struct.pack(">i",
                                                                                               254)
    head = b"RDX2\nX\n" + struct.pack(">iii", 2, 0x30402, 0x20300)
    return head + struct.pack(">i",
                              2 | 1 << 10) + symbol + text(
        "frame") + frame + attributes + struct.pack(">i", 254)


def write_envi(folder):
    (folder / "a.hdr").write_text(f"ENVI\nsamples = {NM.size}\nlines = 3\ndata type = 4\nbyte "
                                  f"order = 0\nwavelength = {{ {' , '.join(map(str, NM))} }}\n")
    CURVES.astype("<f4").tofile(folder / "a.sli")


def write_patches(folder):
    main = {f"{nm:g}": column.tolist() for nm, column in zip(NM, CURVES.T, strict=True)}
    (folder / "a.json").write_text(json.dumps({"spectral_data": {"data": {"main": main}}}))


def csv_across():
    return "\n".join([",".join(f"{nm:g}" for nm in NM), *(",".join(f"{v:.9f}" for v in curve)
                                                          for curve in CURVES)])


def write_across(folder):
    (folder / "a.csv").write_text(csv_across())


def write_down(folder):
    rows = [f"{nm:g}," + ",".join(f"{value:.9f}" for value in column)
            for nm, column in zip(NM, CURVES.T, strict=True)]
    (folder / "a.csv").write_text("\n".join(["# source: test", "wavelength_nm,a,b,c", *rows]))


def write_zip(folder):
    with zipfile.ZipFile(folder / "a.zip", "w") as archive:
        archive.writestr("inner/a.csv", csv_across())
        archive.writestr("ReadMe.txt", "nothing")


def write_r(folder):
    columns = {f"X{nm:g}": column for nm, column in zip(NM, CURVES.T, strict=True)}
    (folder / "a.rda").write_bytes(bz2.compress(r_file(columns)))


@pytest.mark.parametrize("write",
                         [write_envi, write_patches, write_across, write_down, write_zip, write_r])
def test_every_format_gives_the_same_curves(write, tmp_path):
    write(tmp_path)
    # Single precision in the ENVI file, nine decimals in the texts.
    np.testing.assert_allclose(read_library(tmp_path), EXPECTED, atol=1e-7)


def test_what_is_left_out_is_counted():
    curves = np.vstack([CURVES, np.full(NM.size, 1.2), np.full(NM.size, np.nan)])
    kept, why = usable(NM, curves)
    assert len(kept) == 3
    assert why == {"gaps": 1, "outside 0 to 1": 1}
    assert usable(NM[:20], CURVES[:, :20])[1] == {"400-700 nm not covered": 3}


def test_absorbance_called_reflectance_is_read_as_what_it_is(tmp_path):
    columns = {f"X{nm:g}": -np.log10(column) for nm, column in zip(NM, CURVES.T, strict=True)}
    (tmp_path / "ikeogu.2017.rda").write_bytes(bz2.compress(r_file(columns)))
    # Between two wavelengths a straight line in absorbance is none in reflectance: curves are
    # compared at their own.
    shared = np.isin(PRIOR_GRID.nm, NM)
    np.testing.assert_allclose(read_library(tmp_path)[:, shared], EXPECTED[:, shared],
                               atol=1e-9)


def test_a_file_far_above_one_outside_the_visible_holds_no_reflectance():
    nm = np.arange(350.0, 2501, 10)
    water = 0.3 + 1.6 * np.exp(-0.5 * ((nm - 1930) / 200)**2)
    kept, why = usable(nm, np.tile(water, (4, 1)))
    assert len(kept) == 0
    assert why == {"far above 1: absorbance, or per cent": 4}


def test_a_curve_that_ends_5_nm_short_is_continued_by_its_end():
    kept, _ = usable(np.arange(405.0, 701, 5), np.full((1, 60), 0.3))
    np.testing.assert_array_equal(kept, np.full((1, 61), 0.3))


def test_near_duplicates_are_dropped():
    doubled = np.concatenate([EXPECTED, EXPECTED + 0.001])
    np.testing.assert_array_equal(without_near_duplicates(doubled), EXPECTED)


def test_r_integers_and_gzip_are_read(tmp_path):
    (tmp_path / "a.rda").write_bytes(
        gzip.compress(r_file({"X400": [1.0, 2.0], "name": [3.0, 4.0]})))
    np.testing.assert_array_equal(read_r_columns(tmp_path / "a.rda")["name"], [3, 4])


@pytest.mark.parametrize("content", [b"", b"RDX2\nX\n", b"something else entirely"])
def test_damaged_r_files_are_errors(content, tmp_path):
    (tmp_path / "a.rda").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.rda is no R data file that can be read"):
        read_library(tmp_path)


def test_an_r_file_cut_short_is_an_error(tmp_path):
    whole = r_file({f"X{nm:g}": column for nm, column in zip(NM, CURVES.T, strict=True)})
    (tmp_path / "a.rda").write_bytes(whole[:len(whole) // 2])
    with pytest.raises(InputError, match="is no R data file that can be read"):
        read_library(tmp_path)


def test_damaged_envi_libraries_are_errors(tmp_path):
    write_envi(tmp_path)
    (tmp_path / "a.sli").write_bytes(b"1234")
    with pytest.raises(InputError, match=r"a\.sli holds 1 numbers; its header promises 3 x 41"):
        read_library(tmp_path)
    (tmp_path / "a.hdr").unlink()
    with pytest.raises(InputError, match=r"needs its header a\.hdr"):
        read_library(tmp_path)


def test_an_empty_or_missing_folder_is_an_error(tmp_path):
    with pytest.raises(InputError, match="holds no usable reflectance"):
        read_library(tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        read_library(tmp_path / "none")


@pytest.mark.skipif("SPECTRABOX_DATA" not in os.environ,
                    reason="SPECTRABOX_DATA does not name the folder of real data")
@pytest.mark.parametrize("name, curves",
                         [("cassava", 175), ("kremer_pigments", 1586), ("ntu_watercolour", 2444),
                          ("rawtoaces190", 187), ("usgs_minerals", 497)])
def test_real_libraries_are_read_whole_and_covered(name, curves):
    library = read_library(Path(os.environ["SPECTRABOX_DATA"]) / "reflectance" / name)
    assert len(library) == curves
    from sampling_cameras import response

    from benchmarks.bench_calibration_of_bands import certify
    certificate = certify(load_prior(), name, library[::7], response(3)[1])
    assert certificate.coverage > 0.93


@pytest.mark.skipif("SPECTRABOX_DATA" not in os.environ,
                    reason="SPECTRABOX_DATA does not name the folder of real data")
def test_yellow_roots_absorb_blue():
    roots = read_library(Path(os.environ["SPECTRABOX_DATA"]) / "reflectance"
                         / "cassava")
    assert np.all(roots[:, PRIOR_GRID.nm == 450] < roots[:, PRIOR_GRID.nm == 650])
