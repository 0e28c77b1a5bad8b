"""Commands on signals and spectra without a session: sample, uplift, plan, certify, judge, match,
prior train.
"""
from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from spectrabox.session.commands.requests import (
    CertifyRequest,
    JudgeRequest,
    MatchRequest,
    PlanRequest,
    SampleRequest,
    TrainRequest,
    UpliftRequest,
)
from spectrabox.session.terminal.command_help import Commands
from spectrabox.session.terminal.command_line import (
    Answer,
    UsageProblem,
    check_ending,
    command,
)

if TYPE_CHECKING:
    import numpy as np

    from spectrabox.measure.signals.matching import SurfaceMatch

MATCHES_SHOWN, LEFT_OUT_NAMED = 10, 3       # rows of a table, and sentences on spectra left out

def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (sample, uplift, plan, certify, judge, match):
        app.command()(function)
    prior = Commands(help="What is known of reflectances beforehand, the prior: learn one from "
                          "your own measurements.")
    prior.command("train")(prior_train)
    prior.callback()(lambda: None)  # keeps "train" a word of its own while it is the only command
    app.add_typer(prior, name="prior")


@command
def sample(request: SampleRequest) -> Answer:
    """Recover the spectra behind a colour: mean, 95 % band, exact bounds and draws."""
    check_ending(request.out, {".npz": "the draws", ".csv": "means and bands"})
    check_ending(request.plot, {".png": "a picture of means and bands"}, "--plot")
    if request.srgb is None and None in (request.sensitivity, request.light):
        raise UsageProblem("give --sensitivity and --light, the camera that saw the signal and the "
                           "light it was seen under; or a colour of a screen as --srgb R,G,B")
    if request.srgb is not None and (request.sensitivity or request.light or request.white):
        raise UsageProblem("--srgb is a colour under D65; leave --sensitivity, --light and --white "
                           "out")
    from spectrabox.measure.signals.estimate import SampleOptions, columns_of, draws_of
    from spectrabox.measure.signals.judgement import compared
    from spectrabox.measure.signals.sample import sample_signals
    from spectrabox.session.signals.signal_capture import signal_capture, stated_truth
    capture, truth = signal_capture(request), stated_truth(request)
    options = SampleOptions(**{each.name: getattr(request, each.name)
                               for each in fields(SampleOptions)})
    one, as_table = request.signals is None, _ends_in(request.out, ".csv")
    estimates = sample_signals(capture, options, with_draws=one or request.baseline
                               or _ends_in(request.out, ".npz"))
    if request.baseline or truth is not None:
        estimates = [compared(estimate, options, truth, request.delta_light, request.baseline)
                     for estimate in estimates]
    written: dict[str, Path] = {}
    if request.out is not None:
        written["file"] = request.out
        if as_table:
            _write_columns(request.out, estimates[0].wavelengths_nm, columns_of(estimates))
        else:
            write_arrays(request.out, draws_of(estimates))
    if request.plot is not None:
        from spectrabox.session.signals.sample_plot import write_plot
        written["plot"] = request.plot
        write_plot(request.plot, estimates)
    if one:
        return Answer(estimates[0].facts() | written, estimates[0].text())
    text = "" if request.as_json else "\n\n".join(      # of thousands of signals it takes a while
        f"signal {estimate.name}\n{estimate.text()}" for estimate in estimates)
    return Answer({"results": [estimate.facts() for estimate in estimates], **written}, text)


@command
def uplift(request: UpliftRequest) -> Answer:
    """Recover the spectrum behind every pixel: mean and spread, as EXR, ENVI or OME-Zarr."""
    out = request.out
    if out.suffix.lower() in (".exr", ".hdr", ".img"):
        raise typer.BadParameter(f"{out.name} is the name of a file; a folder is needed, into "
                                 "which mean and standard deviation go", param_hint="--out")
    from spectrabox.session.pictures.uplift import uplift_answer
    from spectrabox.session.terminal.progress_display import progress_display, with_time_left
    with progress_display(request.quiet) as progress:
        if request.workers is None and request.cluster is None:
            return Answer(*uplift_answer(request, with_time_left(progress)))
        from spectrabox.session.pictures.shared_uplift import shared_uplift_answer
        return Answer(*shared_uplift_answer(request, with_time_left(progress)))


@command
def plan(request: PlanRequest) -> Answer:
    """Say which reading or photo to take next, and how much narrower it would make the band of a
    signal, or of every surface of a finished session.
    """
    from spectrabox.session.signals.plan_answer import plan_answer
    return Answer(*plan_answer(request))


@command
def certify(request: CertifyRequest) -> Answer:
    """Test on your own measured spectra whether the bands hold the truth, as a certificate."""
    check_ending(request.out, {".md": "the certificate as a page"})
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.sampling.judge.certificate import certificate_page
    from spectrabox.sampling.judge.certificate import certify as certify_library
    from spectrabox.sampling.prior.libraries import read_library
    from spectrabox.sampling.prior.mixture import load_prior, of_families
    from spectrabox.session.signals.signal_options import response_of_names
    prior = of_families(load_prior(request.prior), request.family)
    response = response_of_names(request.sensitivity, request.light)
    certificates = [certify_library(prior, read_library(folder), response, request.noise,
                                    lights=request.delta_light) for folder in request.folders]
    page = certificate_page(certificates, prior, f"{request.sensitivity} under {request.light}")
    facts = {"libraries": [certificate.facts() for certificate in certificates],
             "prior": prior.source, "noise": request.noise}
    if request.out is not None:
        write_text_whole(request.out, page)
        facts["page"] = request.out
    return Answer(facts, page)


@command
def judge(request: JudgeRequest) -> Answer:
    """Score another method's hyperspectral picture next to ours, by the same measures."""
    check_ending(request.out, {".csv": "the regions' spectra"})
    from spectrabox.capture.photo.image_files import read_plane
    from spectrabox.measure.signals.judgement import JudgeOptions, judge_picture
    from spectrabox.measure.signals.spectral_pictures import open_picture
    from spectrabox.radiometry.errors import InputError
    from spectrabox.radiometry.grid import FINE_GRID
    from spectrabox.radiometry.spectra.named_spectra import relative_response
    from spectrabox.radiometry.spectra.spectrum_files import read_table
    from spectrabox.sampling.judge.cube_regions import point_region, read_regions
    from spectrabox.sampling.judge.cubes import parse_wavelengths
    from spectrabox.sampling.prior.mixture import load_prior, of_families
    from spectrabox.session.signals.signal_options import (
        optional_noise,
        optional_numbers,
        read_signals,
    )
    cube = open_picture(request.cube, None if request.wavelengths is None
                        else parse_wavelengths(request.wavelengths), request.variable)
    regions = [point_region(text, cube.width, cube.height) for text in request.point]
    if request.regions is not None:
        regions += read_regions(request.regions, cube.width, cube.height,
                                lambda path: read_plane(path)[0])
    if not regions:
        raise InputError("no region was given; give --regions FILE.toml or --point x,y")
    response = relative_response(request.sensitivity, request.light, FINE_GRID)
    bands = len(response)
    options = JudgeOptions(
        request.delta_light, request.samples, request.seed, request.coefficients, request.baseline,
        request.column, request.full_scale, request.white_region,
        f"{request.sensitivity} under {request.light}")
    judgement = judge_picture(
        cube, regions, None if request.truth is None else read_table(request.truth), response,
        of_families(load_prior(request.prior), request.family), options,
        signals=None if request.signals is None else read_signals(request.signals, bands),
        white=optional_numbers(request.white, bands, "white"),
        noise=optional_noise(request.noise, bands))
    facts = judgement.facts()
    if request.out is not None:
        _write_regions(request.out, cube.nm, judgement.columns(), request.cube.name)
        facts["file"] = request.out
    return Answer(facts, judgement.text())


@command
def match(request: MatchRequest) -> Answer:
    """List the measured spectra of a library that could be each surface, and how many of them the
    camera cannot tell apart.
    """
    from spectrabox.measure.signals.matching import LibraryMatches, match_signal
    from spectrabox.measure.surfaces.surface_signals import measurement
    from spectrabox.radiometry.errors import InputError
    from spectrabox.sampling.judge.spectral_library import read_spectral_libraries
    from spectrabox.sampling.prior.mixture import load_prior, of_families
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.kept_stages import load_finished
    config = read_session(request.folder, request.allow_outside)
    signals = load_finished(config).records.signals
    unknown = [name for name, known in zip(signals.names, signals.known, strict=True) if not known]
    for name in request.only:
        if name not in unknown:
            raise InputError(f"{name!r} is no surface of unknown spectrum in this session; these "
                             f"are {', '.join(unknown) or 'none'}")
    if not unknown:
        raise InputError("every surface of this session has a known spectrum: there is nothing to "
                         "identify")
    library = read_spectral_libraries(request.library, signals.grid)
    matches = LibraryMatches([match_signal(
        name, measurement(signals, signals.names.index(name)), library,
        of_families(load_prior(), config.surfaces[name].families), variation=request.variation,
        evidence_ratio=request.ratio) for name in request.only or unknown],
        library, request.variation)
    texts = [_match_text(match) for match in matches.surfaces]
    if left_out := matches.left_out(LEFT_OUT_NAMED):
        texts.append("\n".join(left_out))
    return Answer(matches.facts(), "\n\n".join(texts))


def _match_text(match: SurfaceMatch) -> str:
    from spectrabox.measure.signals.matching import HEADINGS
    from spectrabox.measure.tables import text_table
    lines = [text_table(HEADINGS, match.rows(MATCHES_SHOWN), text=("spectrum", "library", ""),
                        title=match.surface), match.says]
    hidden = sum(each.indistinguishable for each in match.matches[MATCHES_SHOWN:])
    if hidden:
        lines.insert(1, f"and {hidden} more that may be it (--json lists all)")
    return "\n".join(lines)


@command
def prior_train(request: TrainRequest) -> Answer:
    """Learn a prior from folders of measured reflectances; calibrate it on each left out in
    turn.
    """
    check_ending(request.out, {".npz": "the prior"})
    from spectrabox.measure.signals.prior_training import train_prior
    from spectrabox.sampling.prior.libraries import ReflectanceLibrary, read_library
    from spectrabox.sampling.prior.mixture import save_prior
    from spectrabox.session.signals.signal_options import response_of_names
    libraries: dict[str, list[ReflectanceLibrary]] = {}
    for text in request.folders:
        family, folder = _family_and_folder(text)
        libraries.setdefault(family, []).append(read_library(folder))
    trained = train_prior(libraries, response_of_names(request.sensitivity, request.light),
                          request.seed, models=request.models)
    save_prior(request.out, trained.prior)
    return Answer(trained.facts() | {"prior": request.out},
                  f"{trained.text()}\nwrote {request.out}")


def _family_and_folder(text: str) -> tuple[str, Path]:
    """The family and the folder of FAMILY=FOLDER; paint where a folder stands alone."""
    from spectrabox.sampling.prior.families.family_models import FAMILIES
    from spectrabox.sampling.prior.families.family_names import WORDS
    from spectrabox.sampling.prior.training import MIXED
    family, separator, folder = text.partition("=")
    word = WORDS.get(family, family)
    named = bool(separator) and word in (*FAMILIES, MIXED)
    return (word, Path(folder)) if named else ("paint", Path(text))


def _ends_in(path: Path | None, ending: str) -> bool:
    return path is not None and path.suffix.lower() == ending


def _write_columns(path: Path, nm: np.ndarray, columns: dict[str, np.ndarray]) -> None:
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.records import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import table_text
    write_text_whole(path, table_text(nm, columns, quantity=Quantity.REFLECTANCE,
                                      source="spectrabox sample"))


def _write_regions(path: Path, nm: np.ndarray, columns: dict[str, np.ndarray], cube: str) -> None:
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.records import Quantity
    from spectrabox.radiometry.spectra.companion_files import metadata_path
    from spectrabox.radiometry.spectra.formats.csvw import metadata_text, plain_text
    write_text_whole(path, plain_text(nm, columns))
    write_text_whole(metadata_path(path), metadata_text(
        path.name, columns, quantity=Quantity.REFLECTANCE, source=f"regions of {cube}"))


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write an .npz under exactly the name that was asked for."""
    import numpy as np

    from spectrabox.radiometry.files import whole_file
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **arrays)
