"""Commands on signals and spectra without a session: sample, uplift and match.
"""
from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.measure.signals.options import SampleOptions
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.light_words import DELTA_LIGHTS
from spectrabox.session.commands import requests
from spectrabox.session.terminal import command_line

if TYPE_CHECKING:
    import numpy as np

    from spectrabox.measure.signals.matching import SurfaceMatch

MATCHES_SHOWN, LEFT_OUT_NAMED = 10, 3       # rows of a table, and sentences on spectra left out

def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (sample, uplift, match):
        app.command()(function)


@command_line.Command
def sample(
    measured: requests.MeasuredSignal,
    prior: requests.PriorFile = None,
    family: requests.Families = (),
    sensitivity: requests.OptionalSensitivity = None,
    light: requests.OptionalLight = None,
    srgb: Annotated[str | None, typer.Option(
        "--srgb", metavar="R,G,B|#RRGGBB",
        help="In place of --signal, --sensitivity and --light: a colour of a screen or a web "
        "page. Its spectra are of surfaces that would look so in "
        "daylight.")] = None,
    lab: Annotated[str | None, typer.Option(
        "--lab", metavar="L,A,B", help="In place of --signal and --sensitivity: a colour by L*a*b* "
        "of the CIE 1931 observer under --light, a CIE name, D65 by default.")] = None,
    xyz: Annotated[str | None, typer.Option(
        "--xyz", metavar="X,Y,Z", help="The same by X, Y, Z, with Y = 100 for white.")] = None,
    signals: Annotated[Path | None, typer.Option(
        metavar="CSV", help="Many signals: a header that names the bands, a row for each, with its "
        "name first or without.")] = None,
    coefficients: requests.Coefficients = SampleOptions.coefficients,
    method: Annotated[str, typer.Option(
        metavar="prior|uniform|paper", help="How spectra are drawn: by the learnt prior, uniformly "
        "among all that fit, or as the paper draws them.")] = SampleOptions.method,
    samples: Annotated[int, typer.Option(
        help="Draws of each signal; 1000 at least for a 95 % band.")] = SampleOptions.samples,
    seed: requests.Seed = SampleOptions.seed,
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="NPZ|CSV", help="Where to write the draws (.npz), or means and "
        "bands (.csv).")] = None,
    plot: Annotated[Path | None, typer.Option(
        "--plot", metavar="PNG", help="Draw means and bands into this picture.")] = None,
    level: Annotated[float, typer.Option(
        help="Level of the bands: 0.95 for 95 %.")] = SampleOptions.level,
    twice: Annotated[str | None, typer.Option(
        metavar="V1,V2,V3:E1,E2,E3", help="Signal of light reflected twice off the "
        "surface.")] = None,
    keep: Annotated[int | None, typer.Option(
        "--best",
        help="Method paper: rank by the further measurements and give the best so many (Eqs. 9, "
        "10).")] = None,
    refine: Annotated[int | None, typer.Option(
        help="Coefficients of a finer basis with nested knots; uniform, or paper (Eqs. "
        "11-16).")] = None,
    light_error: Annotated[float, typer.Option(
        help="Relative standard error of the light scale.")] = 0.0,
    sensitivity_error: Annotated[float, typer.Option(
        help="Relative standard error of each curve.")] = 0.0,
    baseline: requests.Baseline = False,
    truth: Annotated[Path | None, typer.Option(
        help="File of the measured spectrum, to judge by.")] = None,
    column: Annotated[str | None, typer.Option(
        metavar="NAME", help="Column of the truth.")] = None,
    as_json: command_line.Json = False,
) -> command_line.Answer:
    """Recover the spectra behind a colour: mean, 95 % band, exact bounds and draws."""
    command_line.check_ending(out, {".npz": "the draws", ".csv": "means and bands"})
    command_line.check_ending(plot, {".png": "a picture of means and bands"}, "--plot")
    colours = [(kind, text) for kind, text in (("srgb", srgb), ("lab", lab), ("xyz", xyz))
               if text is not None]
    if not colours and None in (sensitivity, light):
        raise command_line.UsageProblem(
            "give --sensitivity and --light, the camera that saw the signal and the "
            "light it was seen under; or a colour as --lab L,A,B, --xyz X,Y,Z or "
            "--srgb R,G,B")
    if srgb is not None and (sensitivity or light or measured.white):
        raise command_line.UsageProblem(
            "--srgb is a colour under D65; leave --sensitivity, --light and --white "
            "out")
    if colours and (sensitivity or measured.white):
        raise command_line.UsageProblem(
            f"--{colours[0][0]} is what the CIE observer sees, relative to white; "
            "leave --sensitivity and --white out")
    if len(colours) + [measured.signal is None, signals is None].count(False) != 1:
        raise InputError("give one of --signal V1,V2,V3, --signals FILE.csv, --lab L,A,B, "
                         "--xyz X,Y,Z and --srgb R,G,B")
    if signals is not None and (truth or twice or measured.signal_under or measured.same
                                or measured.more):
        raise InputError("a truth and further measurements belong to one surface; give its "
                         "--signal, not --signals")
    from spectrabox.measure.estimate import columns_of, draws_of
    from spectrabox.measure.signals.sample import compared, sample_signals
    from spectrabox.session.signals.given_signals import signal_capture, stated_truth
    capture = signal_capture(
        measured, signals, colours[0] if colours else None, sensitivity or requests.OBSERVER,
        light or "D65", twice=twice, light_error=light_error, sensitivity_error=sensitivity_error,
        prior=prior, family=family)
    true = None if truth is None else stated_truth(truth, column)
    options = SampleOptions(method, samples, seed, coefficients, level, keep, refine)
    one, as_table, started = signals is None, _ends_in(out, ".csv"), time.perf_counter()
    estimates = sample_signals(capture, options, with_draws=one or baseline
                               or _ends_in(out, ".npz"))
    seconds = (time.perf_counter() - started) / len(estimates)
    facts, texts = [], []
    for estimate in estimates:
        facts.append(estimate.facts() | {"seed": seed, "seconds": seconds})
        # of thousands of signals a text takes a while
        texts.append("" if as_json else estimate.text())
        if baseline or true is not None:
            compared_facts, compared_text = compared(estimate, options, true, DELTA_LIGHTS,
                                                     baseline)
            facts[-1] |= compared_facts
            texts[-1] += f"\n\n{compared_text}"
    written: dict[str, Path] = {}
    if out is not None:
        written["file"] = out
        if as_table:
            _write_columns(out, estimates[0].nm, columns_of(estimates))
        else:
            write_arrays(out, draws_of(estimates))
    if plot is not None:
        from spectrabox.session.signals.given_signals import write_plot
        written["plot"] = plot
        write_plot(plot, estimates)
    if one:
        return command_line.Answer(facts[0] | written, texts[0])
    return command_line.Answer({"results": facts, **written}, "\n\n".join(
        f"signal {estimate.name}\n{text}"
        for estimate, text in zip(estimates, texts, strict=True)))


@command_line.Command
def uplift(request: requests.UpliftRequest) -> command_line.Answer:
    """Recover the spectrum behind every pixel: mean and spread, as EXR, ENVI or OME-Zarr."""
    out = request.out
    if out.suffix.lower() in (".exr", ".hdr", ".img"):
        raise typer.BadParameter(f"{out.name} is the name of a file; a folder is needed, into "
                                 "which mean and standard deviation go", param_hint="--out")
    if request.encoded and (request.sensitivity or request.light or request.white):
        raise command_line.UsageProblem(
            "--encoded is a picture in sRGB, what the CIE observer sees under D65; "
            "leave --sensitivity, --light and --white out")
    if not request.encoded and None in (request.sensitivity, request.light):
        raise command_line.UsageProblem(
            "give --sensitivity and --light, the camera that took the picture and "
            "the light it was taken under; or --encoded of a PNG or JPEG in sRGB")
    from spectrabox.measure import texts
    from spectrabox.radiometry.findings import faults
    from spectrabox.session.signals.uplift_answer import stated_white, uplift_answer
    from spectrabox.session.terminal.progress_display import progress_display, with_time_left
    request, white_from, chart = stated_white(request)
    with progress_display(request.quiet) as progress:
        facts, findings, text = uplift_answer(request, with_time_left(progress))
    white = [float(value) for value in (request.white or "").replace(";", ",").split(",")]
    text += f"\nwhite reads {', '.join(f'{value:.4g}' for value in white)} ({white_from})"
    if request.encoded:
        from spectrabox.measure.signals.signal_capture import OF_SRGB
        facts["caveat"] = texts.says(OF_SRGB)
        text += f"\n{texts.says(OF_SRGB)}"
    if chart is not None:
        findings.append(chart)
    doubts = faults(findings)
    text += "".join(f"\n{'warning: ' * (one in doubts)}{texts.says(one)}" for one in findings)
    return command_line.Answer(facts | {
        "white": white, "white_from": white_from,
        "chart_residual": None if chart is None else chart.values["value"],
        "warnings": [texts.says(one) for one in doubts],
        "findings": [texts.facts(one) for one in findings]}, text)


@command_line.Command
def match(
    *,
    folder: Annotated[Path, typer.Argument(
        metavar="SESSION", help="The folder of a finished session.", show_default=False)],
    allow_outside: command_line.Outside = False,
    library: Annotated[tuple[str, ...], typer.Argument(
        metavar="LIBRARY...", help="Files of reflectances of any format, folders of them, or "
        "published sets: \"CES99\", \"BabelColor Average\" ...", show_default=False)],
    only: Annotated[tuple[str, ...], typer.Option(
        metavar="NAME", help="This surface or region alone.")] = (),
    variation: Annotated[float, typer.Option(
        help="How far samples of one material differ from each other: standard deviation, of "
        "white.")] = 0.01,
    ratio: Annotated[float | None, typer.Option(
        help="A spectrum counts as not told apart from the best while its evidence is at most so "
        "many times lower; by default the true one is kept 19 times in 20.")] = None,
) -> command_line.Answer:
    """List the measured spectra of a library that could be each surface, and how many of them the
    camera cannot tell apart.
    """
    from spectrabox.measure.signals.matching import facts_of_matches, match_signal
    from spectrabox.measure.surfaces.surface_signals import measurement
    from spectrabox.sampling.evaluation.identification import read_spectral_libraries
    from spectrabox.sampling.prior.mixture import load_prior, of_families
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.kept_stages import load_finished
    config = read_session(folder, allow_outside)
    signals = load_finished(config).records.signals
    unknown = [name for name, known in zip(signals.names, signals.known, strict=True) if not known]
    for name in only:
        if name not in unknown:
            raise InputError(f"{name!r} is no surface of unknown spectrum in this session; these "
                             f"are {', '.join(unknown) or 'none'}")
    if not unknown:
        raise InputError("every surface of this session has a known spectrum: there is nothing to "
                         "identify")
    known = read_spectral_libraries(library, signals.grid)
    matches = [match_signal(
        name, measurement(signals, signals.names.index(name)), known,
        of_families(load_prior(), config.surfaces[name].families), variation=variation,
        evidence_ratio=ratio) for name in only or unknown]
    texts = [_match_text(match) for match in matches]
    left_out = [f"left out: {sentence}" for sentence in known.left_out[:LEFT_OUT_NAMED]]
    if len(known.left_out) > LEFT_OUT_NAMED:
        left_out.append(f"left out: {len(known.left_out) - LEFT_OUT_NAMED} more (--json lists all)")
    if left_out:
        texts.append("\n".join(left_out))
    return command_line.Answer(facts_of_matches(matches, known, variation), "\n\n".join(texts))


def _match_text(match: SurfaceMatch) -> str:
    from spectrabox.measure.signals.matching import HEADINGS
    from spectrabox.measure.tables import text_table
    lines = [text_table(HEADINGS, match.rows(MATCHES_SHOWN), text=("spectrum", "library", ""),
                        title=match.surface), match.says]
    hidden = match.may_be[MATCHES_SHOWN:].sum()
    if hidden:
        lines.insert(1, f"and {hidden} more that may be it (--json lists all)")
    return "\n".join(lines)


def _ends_in(path: Path | None, ending: str) -> bool:
    return path is not None and path.suffix.lower() == ending


def _write_columns(path: Path, nm: np.ndarray, columns: dict[str, np.ndarray]) -> None:
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import table_text
    write_text_whole(path, table_text(nm, columns, quantity=Quantity.REFLECTANCE,
                                      source="spectrabox sample"))


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write an .npz under exactly the name that was asked for."""
    import numpy as np

    from spectrabox.radiometry.files import whole_file
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **arrays)
