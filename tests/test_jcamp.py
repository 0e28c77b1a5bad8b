"""JCAMP-DX: every form of XYDATA and XYPOINTS gives the ordinates that were written."""
import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum, read_table

# The example of the standard (Appl. Spectrosc. 42 (1988) 151): ordinates and their DIFDUP form.
STANDARD = [0, 0, 0, 0, 2, 4, 4, 4, 7, 5, 4, 4, 5, 5, 7, 10, 11, 11, 6, 5, 7, 6, 9, 9, 7, 10, 10, 9,
            10, 11, 12, 15, 16, 16, 14, 17, 38, 38, 35, 38, 42, 47, 54, 59, 66, 75, 78, 88, 96, 104,
            110, 121, 128]
DIFDUP = "400@VKT%TLkj%J%KLJ%njKjL%kL%jJULJ%kLK1%lLMNPNPRLJ0QTOJ1P\n452A28\n"
POSITIVE = {"SQZ": "@ABCDEFGHI", "DIF": "%JKLMNOPQR", "DUP": " STUVWXYZs"}
NEGATIVE = {"SQZ": "@abcdefghi", "DIF": "%jklmnopqr"}


def document(lines, nm, ordinates, yfactor, form="(X++(Y..Y))", xunits="NANOMETERS",
             yunits="REFLECTANCE", xfactor=1):
    label = "XYDATA" if "++" in form else "XYPOINTS"
    return "\n".join([
        "##TITLE= on behalf of spectrabox $$ a comment", "##JCAMP-DX= 4.24",
        "##DATA TYPE= UV/VIS SPECTRUM", "##ORIGIN= test", "##OWNER= nobody",
        f"##XUNITS= {xunits}", f"##YUNITS= {yunits}", f"##XFACTOR= {xfactor}",
        f"##YFACTOR= {yfactor}", f"##FIRSTX= {nm[0]:.10g}", f"##LASTX= {nm[-1]:.10g}",
        f"##NPOINTS= {len(nm)}", f"##FIRSTY= {ordinates[0] * yfactor:.10g}", f"##{label}= {form}",
        *lines, "##END="]) + "\n"


def letters(number, kind):
    """A number in squeezed or difference form: its first digit and sign become a letter."""
    text = str(abs(number))
    table = NEGATIVE[kind] if number < 0 else POSITIVE[kind]
    return table[int(text[0])] + text[1:]


def encoded(axis, ordinates, form, per_line):
    """Lines of XYDATA in one of the forms of the standard."""
    lines = []
    for start in range(0, len(ordinates), per_line):
        own = ordinates[start:start + per_line]
        tokens = [f"{axis[start]:g}"]
        if form in ("AFFN", "PAC"):
            tokens += [f"{'+' if y >= 0 else ''}{y}" if form == "PAC" else f" {y}" for y in own]
        else:
            words = [letters(own[0], "SQZ")]
            differ = form.startswith("DIF")
            if differ and start:        # the last ordinate again, as a check
                words = [letters(ordinates[start - 1], "SQZ"),
                         letters(own[0] - ordinates[start - 1], "DIF")]
                tokens[0] = f"{axis[start - 1]:g}"
            words += [letters(after - before, "DIF") if differ else letters(after, "SQZ")
                      for before, after in itertools.pairwise(own)]
            if form.endswith("DUP"):
                grouped = []
                for word in words:
                    if grouped and grouped[-1][0] == word and len(grouped) > (1 if differ else 0):
                        grouped[-1][1] += 1
                    else:
                        grouped.append([word, 1])
                words = [word + (POSITIVE["DUP"][int(str(times)[0])] + str(times)[1:]
                                 if times > 1 else "") for word, times in grouped]
            tokens += words
        lines.append("".join(tokens))
    if form.startswith("DIF"):
        lines.append(f"{axis[-1]:g}{letters(ordinates[-1], 'SQZ')}")
    return lines


def write(tmp_path, text):
    path = tmp_path / "a.jdx"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_standards_own_example_of_repeated_differences_is_read(tmp_path):
    nm = np.arange(400, 453)
    table = read_table(write(tmp_path, document([DIFDUP.strip()], nm, STANDARD, 1)))
    assert table.facts["format"] == "JCAMP-DX" and table.names == ("on behalf of spectrabox",)
    np.testing.assert_array_equal(table.values[0], STANDARD)
    np.testing.assert_array_equal(table.nm, nm)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture,
                                                   HealthCheck.too_slow],
          deadline=None, derandomize=True)
@given(st.data())
def test_every_form_gives_the_ordinates_that_were_written(tmp_path, data):
    count = data.draw(st.integers(5, 60))
    # runs of equal values, so that some are repeated
    runs = data.draw(st.lists(st.tuples(st.integers(-150, 9000), st.integers(1, 14)), min_size=1))
    ordinates = ([y for y, times in runs for _ in range(times)] * count)[:count]
    form = data.draw(st.sampled_from(["AFFN", "PAC", "SQZ", "SQZDUP", "DIF", "DIFDUP"]))
    unit, to_nm = data.draw(st.sampled_from([
        ("NANOMETERS", lambda x: x), ("1/CM", lambda x: 1e7 / x), ("MICROMETERS",
                                                                  lambda x: 1e3 * x)]))
    axis = {"NANOMETERS": 400 + 5.0 * np.arange(count), "1/CM": 14000 + 100.0 * np.arange(count),
            "MICROMETERS": (400 + 5.0 * np.arange(count)) / 1000}[unit]
    xfactor = data.draw(st.sampled_from([1, 0.125]))
    if data.draw(st.booleans()):
        axis = axis[::-1]
    lines = encoded(axis / xfactor, ordinates, form, data.draw(st.integers(3, 12)))
    percent = data.draw(st.booleans())
    factor = 0.01 if percent else 0.0001
    path = write(tmp_path, document(lines, axis, ordinates, factor, xunits=unit, xfactor=xfactor,
                                    yunits="% REFLECTANCE" if percent else "REFLECTANCE"))
    spectrum = read_spectrum(path, role=Quantity.REFLECTANCE)
    nm, values = to_nm(axis), np.array(ordinates) * 0.0001
    order = np.argsort(nm)
    # ten digits are written, and wavelengths are rounded to 1e-9 nm
    np.testing.assert_allclose(spectrum.grid.nm, nm[order], rtol=1e-9, atol=2e-9)
    np.testing.assert_allclose(spectrum.values, values[order], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("separator, decimal", [(", ", "."), (" ", "."), ("; ", "."), (", ", ",")])
def test_points_are_pairs(tmp_path, separator, decimal):
    nm, values = np.arange(400, 460, 10.0), np.array([0.1, 0.2, 0.25, 0.3, 0.2, 0.15])
    lines = [separator.join([f"{x:.2f}", f"{y:.3f}"]).replace(".", decimal)
             for x, y in zip(nm, values, strict=True)]
    text = document(lines, nm, values, 1.0, "(XY..XY)")
    text = text.replace("##FIRSTX= 400", f"##FIRSTX= 400{decimal}00")
    spectrum = read_spectrum(write(tmp_path, text), role=Quantity.REFLECTANCE)
    np.testing.assert_array_equal(spectrum.grid.nm, nm)
    np.testing.assert_array_equal(spectrum.values, values)


def test_blocks_of_one_axis_are_columns_and_the_processed_one_is_meant(tmp_path):
    nm = np.arange(400, 406)
    block = [document(encoded(nm, [level] * 6, "AFFN", 6), nm, [level] * 6, 0.01).replace(
        "on behalf of spectrabox", title) for level, title in ((90, "REFERENCE SPECTRUM"),
                                                               (30, "PROCESSED SPECTRUM"))]
    path = write(tmp_path, "##TITLE= all\n##DATA TYPE= LINK\n##BLOCKS= 3\n" + "".join(block)
                 + "##END=\n")
    table = read_table(path)
    assert table.names == ("REFERENCE SPECTRUM", "PROCESSED SPECTRUM")
    # one product
    np.testing.assert_allclose(read_spectrum(path, role=Quantity.REFLECTANCE).values, 0.3,
                               rtol=1e-14)


NM = np.arange(400, 430)
GOOD = document(encoded(NM, list(range(30)), "DIF", 10), NM, list(range(30)), 0.01)


@pytest.mark.parametrize("old, new, message", [
    ("##NPOINTS= 30", "##NPOINTS= 31", "states 31 points and holds 30|is due by FIRSTX"),
    ("##LASTX= 429", "##LASTX= 629", "is due by FIRSTX"),
    ("##FIRSTX= 400\n", "", "need FIRSTX"), ("NANOMETERS", "FURLONGS", "FURLONGS"),
    ("##YFACTOR= 0.01", "##YFACTOR= 0", "YFACTOR is 0"),
    ("409I", "409H", "begins with 8, but the one before ends with 9"),
    ("##XYDATA= (X++(Y..Y))", "##PEAK TABLE= (XY..XY)", "a table of peaks"),
    ("UV/VIS", "NMR", "NMR"), ("##XYDATA=", "##NTUPLES=", "NTUPLES"),
    ("REFLECTANCE", "ABSORBANCE", "'absorbance'")])
def test_what_fails_a_check_or_is_no_spectrum_is_refused_by_name(tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(InputError, match=message):
        read_spectrum(write(tmp_path, GOOD.replace(old, new)), role=Quantity.REFLECTANCE)
