"""Commands on a camera without a session: camera fit, camera prior, camera preflight."""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from radiometry.errors import InputError
from session.command_line import Debug, Json, answer, command, fail

if TYPE_CHECKING:
    import numpy as np

    from calibrate.camera_prior import CameraPrior
    from calibrate.chart_answers import ChartAnswer
    from radiometry.records import PatchSamples, Spectrum, WavelengthGrid

METHODS = ("prior", "smooth", "nonnegative", "paper", "file")
SECOND_LIGHTS = ("A", "D65", "FL2", "FL11", "LED-B1", "LED-B3", "LED-B5", "LED-RGB1", "LED-V1")
Light = Annotated[str, typer.Option(metavar="FILE|NAME", show_default=False,
                                    help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")]
Reference = Annotated[str, typer.Option(metavar="NAME|CSV", help="Chart reflectances: a published average, or a CSV of "
                                        "24 columns.")]
PriorFile = Annotated[Path | None, typer.Option("--prior", metavar="NPZ",
                                                help="A prior of your own; the shipped one by default.")]
camera = typer.Typer(no_args_is_help=True, help="Sensitivities of a camera: fit, prior, preflight.")


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (fit, prior, preflight):
        camera.command()(function)
    app.add_typer(camera, name="camera")


def fit(light: Light,
        chart: Annotated[Path | None, typer.Option(metavar="PHOTO", help="Raw, DNG, or linear EXR or TIFF of a "
                                                   "ColorChecker.")] = None,
        patches: Annotated[Path | None, typer.Option(metavar="CSV", help="24 rows of signals in place of a photo; "
                                                     "columns named standard_error... hold their errors.")] = None,
        method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "prior",
        curves: Annotated[Path | None, typer.Option(metavar="CSV", help="Measured curves, with method file.")] = None,
        out: Annotated[Path | None, typer.Option(metavar="CSV", help="Write the curves and their band.")] = None,
        samples: Annotated[Path | None, typer.Option(metavar="NPZ", help="Write 1000 draws of the curves.")] = None,
        reference: Reference = "BabelColor Average",
        corners: Annotated[str | None, typer.Option(metavar="'X,Y X,Y X,Y X,Y'", help="Outer corners of the patches at "
                           "dark skin, bluish green, black and white, where the chart is not found.")] = None,
        prior_file: PriorFile = None, as_json: Json = False, debug: Debug = False) -> None:
    """Sensitivities from a chart photo and a light spectrum, with error bars."""
    with command(as_json, debug):
        if method not in METHODS:
            fail(as_json, f"--method {method} is not known; known are {', '.join(METHODS)}", 2)
        if (chart is None) == (patches is None):
            fail(as_json, "give either --chart PHOTO or --patches CSV", 2)
        if (method == "file") != (curves is not None):
            fail(as_json, "measured curves need both --method file and --curves CSV", 2)
        from calibrate.chart_answers import answer_chart, facts_of
        from radiometry.grid import visible_grid
        grid = visible_grid()
        spectrum, reflectances = _light(light, grid), _reflectances(reference, grid)
        measured, names = _patches(chart, patches, corners)
        given = None if curves is None else _curves(curves, len(names), grid)
        result = answer_chart(measured, reflectances, spectrum, grid, method=None if method == "file" else method,
                              prior=None if prior_file is None else _prior(prior_file), curves=given)
        facts = {**facts_of(result, grid), "bands": list(names), "light": spectrum.source}
        if out is not None:
            _write_curves(out, result, names, grid, spectrum.source)
            facts["file"] = str(out)
        if samples is not None:
            _write_draws(samples, result, grid)
            facts["samples"] = str(samples)
        answer(as_json, facts, _fit_text(result, names, out))


def prior(folder: Annotated[Path, typer.Argument(metavar="FOLDER", show_default=False,
                                                 help="Curves: rawtoaces JSON, camspec TXT, CSV.")],
          out: Annotated[Path, typer.Option(metavar="NPZ", help="Where to write the prior.", show_default=False)],
          leave_out: Annotated[list[str] | None, typer.Option(metavar="NAME", help="A camera to leave out; may be "
                                                              "repeated.")] = None,
          source: Annotated[str | None, typer.Option(help="Stored with the prior; the folder by default.")] = None,
          licence: Annotated[str, typer.Option(help="Of the curves.")] = "not stated",
          as_json: Json = False, debug: Debug = False) -> None:
    """A prior on sensitivities from a folder of measured cameras."""
    with command(as_json, debug):
        if out.suffix.lower() != ".npz":
            fail(as_json, f"{out} is no NPZ name; give --out NAME.npz", 2)
        from calibrate.camera_database import read_camera_database
        from calibrate.camera_prior import build_prior, save_prior
        from radiometry.files import writable
        database = read_camera_database(folder, leave_out=tuple(leave_out or ()))
        made = build_prior(database.nm, database.curves, database.names, licence=licence,
                           source=source or f"{len(database.names)} cameras of {folder.name}")
        with writable(out.parent):
            out.parent.mkdir(parents=True, exist_ok=True)
            save_prior(out, made)
        facts = {"file": str(out), "cameras": list(database.names), "skipped": list(database.skipped),
                 "families": list(made.members), "bands": made.bands}
        lines = [f"wrote {out}: {len(database.names)} cameras in {len(made.members) - 1} families",
                 *(f"- skipped: {reason}" for reason in database.skipped)]
        answer(as_json, facts, "\n".join(lines))


def preflight(light: Light,
              noise: Annotated[float, typer.Option(help="Relative error of a patch, everything included.")] = 0.01,
              reference: Reference = "BabelColor Average", prior_file: PriorFile = None,
              as_json: Json = False, debug: Debug = False) -> None:
    """Before shooting: expected error of the curves for this chart and light, and what second light would help."""
    with command(as_json, debug):
        if not 0 < noise < 1:
            fail(as_json, f"--noise {noise:g} is not between 0 and 1; 0.01 means 1 %", 2)
        from calibrate.camera_prior import shipped_prior
        from calibrate.photo_checks import light_power
        from calibrate.preflight import preflight as expected_of
        from radiometry.chart import patch_centres_uv
        from radiometry.grid import visible_grid
        from radiometry.named_spectra import light as named_light
        grid = visible_grid()
        power, unseen = light_power(_light(light, grid), grid)
        second = {name: named_light(name, grid) for name in SECOND_LIGHTS if name != light}
        known = shipped_prior() if prior_file is None else _prior(prior_file)
        expected = expected_of(known, _reflectances(reference, grid), power, grid, relative_error=noise,
                               places=patch_centres_uv(), second=second)
        facts = {"wavelengths_nm": grid.nm.tolist(), "expected_error": expected.expected_error.tolist(),
                 "half_width": expected.half_width.tolist(), "condition_number": expected.condition_number,
                 "unlit_nm": [list(pair) for pair in expected.unlit_nm], "checks": list(unseen),
                 "second_lights": [{"light": name, "expected_error": error} for name, error in expected.second_lights]}
        best, error = expected.second_lights[0]
        lines = ["expected error of the curves: " + ", ".join(f"{value:.1%}" for value in expected.expected_error)
                 + f" at {noise:.1%} a patch (condition number {expected.condition_number:.0f})", *unseen,
                 f"a second photo under {best} would bring the mean to {error:.1%}"]
        answer(as_json, facts, "\n".join(lines))


def _light(name: str, grid: WavelengthGrid) -> Spectrum:
    from radiometry.named_spectra import light as named_light
    from radiometry.records import Quantity, Spectrum
    from radiometry.spectrum_files import read_spectrum
    if Path(name).suffix or Path(name).exists():
        return read_spectrum(Path(name), role=Quantity.RELATIVE)
    return Spectrum(grid, named_light(name, grid), Quantity.RELATIVE, f"CIE {name}")


def _reflectances(reference: str, grid: WavelengthGrid) -> np.ndarray:
    from radiometry.chart import chart_reflectances
    from radiometry.spectrum_files import on_grid, read_curves
    if not Path(reference).suffix:
        return chart_reflectances(reference, grid)
    nm, names, values = read_curves(Path(reference))
    if len(names) != 24:
        raise InputError(f"{reference} holds {len(names)} columns; 24 are needed, one per patch, dark skin first")
    return on_grid(nm, values, grid, reference)


def _patches(chart: Path | None, patches: Path | None, corners: str | None) -> tuple[PatchSamples, tuple[str, ...]]:
    """Patch statistics and band names, from a table or a photo."""
    if patches is not None:
        from calibrate.patch_files import read_patches
        return read_patches(patches)
    assert chart is not None
    import numpy as np

    from capture.chart_detection import find_chart
    from capture.chart_reference import typical_signals
    from capture.linear import open_photo
    from capture.patches import require_unclipped, sample_patches
    from radiometry.chart import PATCH_NAMES
    photo = open_photo(chart)
    bands = photo.signal.shape[2]
    places = None
    if corners is not None:
        try:
            places = np.array([[float(number) for number in word.split(",")] for word in corners.split()])
        except ValueError:
            places = np.zeros(0)
        if places.shape != (4, 2):
            raise InputError(f"--corners {corners} are not four points; write --corners 'x,y x,y x,y x,y'")
    measured = sample_patches(photo, find_chart(photo, typical_signals(bands), places))
    require_unclipped(measured, PATCH_NAMES, chart.name)
    return measured, ("R", "G", "B") if bands == 3 else tuple(f"band {index + 1}" for index in range(bands))


def _curves(path: Path, bands: int, grid: WavelengthGrid) -> np.ndarray:
    from radiometry.spectrum_files import on_grid, read_curves
    nm, names, curves = read_curves(path)
    if len(names) != bands:
        raise InputError(f"{path.name} holds {len(names)} curves, the photo has {bands} bands; give a column per band")
    values = on_grid(nm, curves, grid, path.name)
    if values.max() <= 0 or values.min() < -0.05 * values.max():
        raise InputError(f"{path.name}: sensitivities must be positive; they run from {values.min():.3g} to "
                         f"{values.max():.3g}")
    return values.clip(0) / values.max()


def _prior(path: Path) -> CameraPrior:
    from calibrate.camera_prior import load_prior
    return load_prior(path)


def _write_curves(path: Path, result: ChartAnswer, names: tuple[str, ...], grid: WavelengthGrid, light: str) -> None:
    from radiometry.files import write_text_whole
    from radiometry.records import Quantity
    from radiometry.spectrum_files import table_text
    columns: dict[str, Any] = dict(zip(names, result.curves, strict=True))
    error = result.made.calibration.sensitivity.standard_error
    if error is not None:
        columns |= {f"standard_error {name}": values for name, values in zip(names, error, strict=True)}
    source = f"{result.made.calibration.sensitivity.method}, light {light}".replace("\n", " ")
    write_text_whole(path, table_text(grid.nm, columns, quantity=Quantity.RELATIVE, source=source))


def _write_draws(path: Path, result: ChartAnswer, grid: WavelengthGrid) -> None:
    import numpy as np

    from radiometry.files import writable
    if result.draws is None:
        raise InputError("draws come with the method prior only; leave --samples out")
    with writable(path.parent), path.open("wb") as file:
        np.savez_compressed(file, wavelengths_nm=grid.nm, curves=result.draws)


def _fit_text(result: ChartAnswer, names: tuple[str, ...], out: Path | None) -> str:
    lines = [f"bands {', '.join(names)}: {result.made.calibration.sensitivity.method}",
             f"chart colour difference {result.delta_e.mean():.2f} CIEDE2000, {result.held_out_delta_e.mean():.2f} for "
             "patches left out of the fit", *(f"- {check}" for check in result.made.calibration.checks),
             result.made.calibration.sensitivity.outcome.value]
    return "\n".join([*lines, f"wrote {out}"] if out is not None else lines)
