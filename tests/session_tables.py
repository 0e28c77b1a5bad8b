"""A whole session as one short table in physical units, read from the files that its run wrote.

Colours, deviations and shares are calculated here from ``spectra.csv``, so that a mistake in the
report's own scores does not repeat itself in the record.
"""
import csv
import json

import colour
import numpy as np
from spectral.io import envi

STEP_NM = np.arange(400, 701, 5)
PER_CENT, NONE = 100.0, "-"

# How far a number may be from its record: of itself, and in its unit. Draws are 1000 or more: a
# mean is known to a thirtieth of a standard deviation, a quarter of the band; an end of a band to
# 9 % of a standard deviation. Four such errors, so that other draws from the same posterior pass.
CLOSE = {
    "L*": (0, 0.15),            # 1 % of a white's light is 0.36, of a dark grey's 0.2
    "a*": (0, 0.5), "b*": (0, 0.5),         # posterior 2 to 4 wide
    "rmse": (0.06, 0.1),        # % of white
    "band": (0.06, 0.05),       # % of white, mean width; 90 % in place of 95 % is 16 % narrower
    "inside": (0, 10),          # % of wavelengths, which leave a band in runs of several
    "bounds": (0.02, 0.05),     # % of white, mean width: no draws, but the noise of the photo
    "share": (0, 3),            # % of the posterior
    # % of white. No draws; a renderer's round-off moves a scene's by 0.1 %.
    "signal": (0.003, 0.02),
    # % of the signal. Sizes of errors are estimates themselves, good to several per cent.
    "error": (0.05, 0.02),
    "calibration": (0.03, 0.005),       # a search ends where its steps are small
    "picture": (0.03, 0.1),     # % of white, and of the pixels
}
BLOCKS = {"signals": "signal", "errors": "error", "causes": "error", "calibration": "calibration",
          "picture": "picture"}
WORDS = {"verdict", "batch"}    # blocks that hold no measured number


def table_of(folder, answer):
    """Blocks {name: (columns, rows)} of a finished session; a row begins with its label.

    Parameters
    ----------
    folder : Path
        With ``report.json`` and ``spectra.csv``.
    answer : dict
        What the command said with ``--json``.
    """
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    surfaces = report.get("materials") or report["regions"]
    unknown = [each for each in surfaces if not each["known"]]
    states = [each["status"] for each in report["verdict"]["criteria"]]
    assert report["verdict"]["status"].lower() == answer["verdict"]
    blocks = {"verdict": (["status", "warnings", "failures"], [
        ["session", report["verdict"]["status"], states.count("WARN"), states.count("FAIL")]])}
    outcomes = {each["name"]: each["outcome"]
                for each in answer.get("materials") or answer["regions"] if not each["known"]}
    blocks["spectra"] = spectra_block(folder, unknown, outcomes)
    bands = report["signal_bands"]
    blocks["signals"] = (bands, [[each["name"], *per_cent(each["signal"])] for each in surfaces])
    blocks["errors"] = (bands, [[each["name"], *per_cent(relative_error(each))]
                                for each in unknown])
    causes = list(dict.fromkeys(cause for each in unknown for cause in each["error_budget"]))
    blocks["causes"] = ([each["name"] for each in unknown], [
        [cause, *per_cent(root_mean_square(each["error_budget"].get(cause, [None]))
                          for each in unknown)] for cause in causes])
    blocks["calibration"] = calibration_block(report)
    if "picture" in answer:
        blocks["picture"] = picture_block(folder, answer["picture"])
    return blocks


def per_cent(values):
    """Numbers times 100; a band that a surface was not seen in stays a dash."""
    return [NONE if value is None or np.isnan(value) else PER_CENT * value for value in values]


def relative_error(surface):
    """Standard error of a surface's signal, relative to the signal."""
    signal, *covariances = (np.array(surface[name], float) for name in (
        "signal", "signal_covariance", "model_covariance"))
    return np.sqrt(np.diag(sum(covariances))) / signal


def root_mean_square(values):
    """Of the values that are numbers."""
    kept = np.array([value for value in values if value is not None], float)
    return np.sqrt(np.mean(kept**2)) if kept.size else np.nan


def spectra_block(folder, unknown, outcomes):
    """Colour, deviation from the truth, band, share of the truth inside, and exact bounds."""
    heading, *lines = csv.reader((folder / "spectra.csv").read_text(encoding="utf-8").splitlines())
    columns = dict(zip(heading, np.array(lines, float).T, strict=True))
    nm, rows = columns["wavelength_nm"], []
    for each in unknown:
        name, level = each["name"], f"{each['summary']['level']:g}"
        mean, lower, upper, least, most = (
            np.interp(STEP_NM, nm, columns[f"{name} {part}"])
            for part in ("mean", f"lower {level}", f"upper {level}", "bound lower", "bound upper"))
        rmse = inside = NONE
        if each["truth"] is not None:
            truth = np.interp(STEP_NM, each["truth"]["nm"], each["truth"]["values"])
            rmse = PER_CENT * np.sqrt(np.mean((mean - truth) ** 2))
            inside = PER_CENT * np.mean((lower <= truth) & (truth <= upper))
        rows.append([name, *lab(STEP_NM, mean), rmse, PER_CENT * np.mean(upper - lower), inside,
                     PER_CENT * np.mean(most - least), *likeliest(each["families"]),
                     outcomes[name]])
    columns = ["L*", "a*", "b*", "rmse", "band", "inside", "bounds", "family", "share", "outcome"]
    return columns, rows


def likeliest(families):
    """Name and share of the family that a signal is most like."""
    best = max(families, key=lambda family: family["share"], default=None)
    return [NONE, NONE] if best is None else [best["name"], PER_CENT * best["share"]]


def lab(nm, reflectance):
    """CIE L*a*b* under D65 of a reflectance, from the tables and formulas of colour-science."""
    shape = colour.SpectralShape(nm[0], nm[-1], nm[1] - nm[0])
    observer, light = (table.copy().align(shape) for table in (
        colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"], colour.SDS_ILLUMINANTS["D65"]))
    weights = observer.values.T * light.values
    white, xyz = weights.sum(axis=1) / weights[1].sum(), weights @ reflectance / weights[1].sum()
    return colour.XYZ_to_Lab(xyz, colour.XYZ_to_xy(white))


def calibration_block(report):
    """Colour differences and deviations of the chart, and the scale of the light."""
    fit, chart, rows = report["calibration"], report["chart"], []
    fitted, true = fit["sensitivity"], report["calibration"]["sensitivity_truth"]
    if chart is not None:
        rows += [["chart dE00, mean", np.mean(chart["swatches"]["delta_e00"])],
                 ["chart residual, rms %", PER_CENT * fit["chart_rms"]],
                 ["left-out patches, rms error %", PER_CENT * chart["left_out"]["rmse_mean"]]
                 if chart["left_out"] else ["no patch left out", 0.0]]
    if fitted["condition_number"] is not None:
        rows.append(["condition number", fitted["condition_number"]])
    if true is not None:
        curves = [np.interp(fitted["nm"], true["nm"], curve) for curve in true["curves"]]
        rows.append(["curves against the truth, rms %",
                     PER_CENT * np.sqrt(np.mean((np.array(fitted["curves"]) - curves) ** 2))])
    if fit.get("light_scale"):
        scale = fit["light_scale"]
        rows += [["light scale", scale["value"]],
                 ["its error %", PER_CENT * scale["standard_error"] / scale["value"]]]
    return ["value"], rows


def picture_block(folder, facts):
    """Means over a picture of spectra, read by colour-science or SPy, and shares of its pixels."""
    rows = []
    for name in ("mean", "standard_deviation"):
        path = next(path for path in facts["files"] if path.rpartition("/")[2] in (
            f"{name}.exr", f"{name}.hdr"))
        if path.endswith(".hdr"):
            picture = envi.open(str(folder / path))
            nm, values = np.array(picture.bands.centers), np.asarray(picture.load())
        else:
            nm, values = colour.read_spectral_image_Fichet2021(str(folder / path))["T"]
        values = values.reshape(-1, len(nm)).astype(float)
        seen = values[np.isfinite(values).all(axis=1)]
        rows += [[f"{name} at {at} nm %", PER_CENT * np.interp(at, nm, seen.mean(axis=0))]
                 for at in (450, 550, 650)]
    rows += [[f"{share} %", PER_CENT * facts[share]] for share in ("masked", "unlike")]
    return ["value"], rows


# ---- the record: text ----------------------------------------------------------------------------

def as_text(blocks):
    """Blocks as a text that a person can read, one surface a line."""
    parts = []
    for name, (columns, rows) in blocks.items():
        cells = [[f"[{name}]", *columns], *([_cell(value) for value in row] for row in rows)]
        widths = [max(len(row[at]) for row in cells) for at in range(len(cells[0]))]
        parts += [" | ".join(cell.ljust(width) if at == 0 else cell.rjust(width) for at, (
            cell, width) in enumerate(zip(row, widths, strict=True))).rstrip() for row in cells]
        parts.append("")
    return "\n".join(parts)


def _cell(value):
    if isinstance(value, str):
        return value
    return str(value) if isinstance(value, int) else f"{round(value, 4):.4g}"


def from_text(text):
    """The blocks of such a text: numbers where a cell holds one."""
    blocks, name = {}, None
    for line in filter(str.strip, text.splitlines()):
        if line.startswith("#"):
            continue
        first, *cells = (cell.strip() for cell in line.split("|"))
        if first.startswith("["):
            name = first.strip("[]")
            blocks[name] = (cells, [])
        else:
            blocks[name][1].append([first, *map(_value, cells)])
    return blocks


def _value(cell):
    try:
        return float(cell)
    except ValueError:
        return cell


def differences(blocks, recorded):
    """Sentences on what lies beyond its tolerance; empty if nothing does."""
    if list(blocks) != list(recorded):
        return [f"blocks {list(blocks)}, recorded {list(recorded)}"]
    beyond = []
    for name, (columns, rows) in from_text(as_text(blocks)).items():
        labels = [row[0] for row in rows]
        if columns != recorded[name][0] or labels != [row[0] for row in recorded[name][1]]:
            beyond.append(f"[{name}] has {columns} of {labels}; recorded {recorded[name]}")
            continue
        for row, other in zip(rows, recorded[name][1], strict=True):
            for column, value, wanted in zip(columns, row[1:], other[1:], strict=True):
                if not _close(value, wanted, name, column):
                    beyond.append(f"[{name}] {row[0]}, {column}: {value}; recorded {wanted}")
    return beyond


def _close(value, wanted, block, column):
    if isinstance(value, str) or isinstance(wanted, str) or block.split()[-1] in WORDS:
        return value == wanted
    relative, absolute = CLOSE[BLOCKS.get(block.split()[-1], column)]
    # what the text rounds to four digits
    return abs(value - wanted) <= absolute + (relative + 1e-3) * abs(wanted)
