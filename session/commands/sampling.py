"""Commands on signals and spectra without a session: sample, uplift, plan, certify, prior train."""
from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from session.command_line import Debug, Json, answer, command

Sensitivity = Annotated[str, typer.Option(help="CSV of sensitivities, or a camera or observer by its name.")]
Light = Annotated[str, typer.Option(help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")]
White = Annotated[str | None, typer.Option(help="What a perfect white reads in each band; 1 by default.")]
Noise = Annotated[str | None, typer.Option(help="Standard error of the signal in each band, in its unit.")]
Coefficients = Annotated[int, typer.Option(help="N of the B-spline class: bounds, and the methods uniform and paper.")]
PriorFile = Annotated[Path | None, typer.Option("--prior", help="A prior of your own; the shipped one by default.")]
Seed = Annotated[int, typer.Option(help="The same seed gives the same draws.")]
Level = Annotated[float, typer.Option(help="Of the bands.")]


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (sample, uplift, plan, certify):
        app.command()(function)
    prior = typer.Typer(no_args_is_help=True, help="The prior on reflectances: train one of your own.")
    prior.command("train")(prior_train)
    prior.callback()(lambda: None)  # keeps "train" a word of its own while it is the only command
    app.add_typer(prior, name="prior")


def sample(sensitivity: Sensitivity, light: Light,
           signal: Annotated[str | None, typer.Option(help="One signal: v1,v2,v3.")] = None,
           signals: Annotated[Path | None, typer.Option(help="CSV: a header of bands, one signal per row.")] = None,
           white: White = None, noise: Noise = None, coefficients: Coefficients = 13,
           method: Annotated[str, typer.Option(help="prior, uniform or paper.")] = "prior",
           samples: Annotated[int, typer.Option(help="T, draws per signal; 1000 at least for a 95 % band.")] = 2000,
           seed: Seed = 0, out: Annotated[Path | None, typer.Option(help=".npz of the draws.")] = None,
           prior: PriorFile = None, level: Level = 0.95,
           start: Annotated[str, typer.Option(help="bounded or unbounded: c0 of the method paper.")] = "bounded",
           reading: Annotated[list[str] | None, typer.Option(
               help="One more reading, NM:REFLECTANCE or NM:REFLECTANCE:ERROR; may be repeated.")] = None,
           light_error: Annotated[float, typer.Option(help="Relative standard error of the light scale.")] = 0.0,
           sensitivity_error: Annotated[float, typer.Option(help="Relative standard error of each curve.")] = 0.0,
           baseline: Annotated[bool, typer.Option("--baseline", help="Also other authors' single spectra.")] = False,
           as_json: Json = False, debug: Debug = False) -> None:
    """Every spectrum behind one signal: mean, band, exact bounds and draws."""
    with command(as_json, debug):
        from sampling.answers import SampleRequest, sample_answer
        request = SampleRequest(sensitivity, light, signal, signals, white, noise, coefficients, method, samples, seed,
                                prior, level, start, tuple(reading or ()), baseline,
                                light_error, sensitivity_error)
        facts, text, arrays = sample_answer(request)
        if out is not None:
            write_arrays(out, arrays)
            facts["file"] = str(out)
        answer(as_json, facts, text)


def uplift(image: Annotated[Path, typer.Argument(metavar="IMAGE", help="Linear EXR or TIFF, or a camera raw.")],
           out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder of the results.")],
           sensitivity: Sensitivity, light: Light, white: White = None,
           noise: Annotated[float, typer.Option(help="Relative standard error of a pixel.")] = 0.01,
           side: Annotated[int, typer.Option(help="Points per side of the table; 33 is finer and slower.")] = 25,
           as_json: Json = False, debug: Debug = False) -> None:
    """Mean and spread of the spectrum behind every pixel, as spectral EXR."""
    with command(as_json, debug):
        import numpy as np

        from capture.image_files import write_exr
        from capture.linear import open_photo
        from radiometry.files import writable
        from sampling.answers import numbers
        from sampling.judgement_answers import uplift_answer
        from sampling.logit_mixture import GRID
        signals = np.asarray(open_photo(image).signal, dtype=float)
        if white is not None:
            signals = signals / numbers(white, signals.shape[2], "white")
        mean, spread, beyond = uplift_answer(signals, sensitivity, light, noise, side)
        paths = {"mean": out / "mean.exr", "standard_deviation": out / "standard_deviation.exr"}
        with writable(out):
            for path, values in zip(paths.values(), (mean, spread), strict=True):
                write_exr(path, values.astype(np.float32), [f"{nm:g}nm" for nm in GRID.nm])
        answer(as_json, {**{name: str(path) for name, path in paths.items()}, "pixels": int(mean[..., 0].size),
                         "outside_0_to_1": beyond},
               f"wrote {paths['mean']} and {paths['standard_deviation']}; {100 * beyond:.1f} % of pixels lie outside "
               "what a reflectance between 0 and 1 can give and were taken at the edge")


def plan(sensitivity: Sensitivity, light: Light, signal: Annotated[str, typer.Option(help="v1,v2,v3.")],
         white: White = None, noise: Noise = None,
         steps: Annotated[int, typer.Option(help="Readings to plan.")] = 3,
         other: Annotated[list[str] | None, typer.Option("--second-light", help="A light for another photo.")] = None,
         reading_minutes: Annotated[float, typer.Option(help="Of one spot reading.")] = 2.0,
         photo_minutes: Annotated[float, typer.Option(help="Of one more photo.")] = 5.0, seed: Seed = 0,
         as_json: Json = False, debug: Debug = False) -> None:
    """Which reading or photo to take next: fall of the band's width per minute."""
    with command(as_json, debug):
        from sampling.judgement_answers import plan_answer
        answer(as_json, *plan_answer(sensitivity, light, signal, noise, white, steps, tuple(other or ()),
                                     reading_minutes, photo_minutes, seed))


def certify(folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="Measured reflectances.")],
            sensitivity: Sensitivity = "CIE 1931 2 Degree Standard Observer", light: Light = "D65",
            noise: Annotated[float, typer.Option(help="Relative standard error of the signals.")] = 0.0,
            prior: PriorFile = None,
            out: Annotated[Path | None, typer.Option(help="Write the page there (.md).")] = None,
            as_json: Json = False, debug: Debug = False) -> None:
    """Do the bands hold the truth on your own spectra? A certificate page."""
    with command(as_json, debug):
        from radiometry.files import write_text_whole
        from sampling.judgement_answers import certify_answer
        facts, page = certify_answer(folders, sensitivity, light, noise, prior)
        if out is not None:
            write_text_whole(out, page)
            facts["page"] = str(out)
        answer(as_json, facts, page)


def prior_train(folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="One folder per library.")],
                out: Annotated[Path, typer.Option(help="The prior, .npz.")],
                sensitivity: Sensitivity = "CIE 1931 2 Degree Standard Observer", light: Light = "D65",
                components: Annotated[int, typer.Option(help="Of the mixture.")] = 8, seed: Seed = 0,
                as_json: Json = False, debug: Debug = False) -> None:
    """Learn a prior from folders of measured reflectances; calibrate it on each left out in turn."""
    with command(as_json, debug):
        from radiometry.files import writable
        from sampling.judgement_answers import train_answer
        from sampling.logit_mixture import save_prior
        facts, text, prior = train_answer(folders, sensitivity, light, components, seed)
        with writable(out.parent):
            save_prior(out, prior)
        answer(as_json, {**facts, "prior": str(out)}, f"{text}\nwrote {out}")


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """An .npz under exactly the name that was asked for."""
    import numpy as np

    from radiometry.files import writable
    with writable(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)
