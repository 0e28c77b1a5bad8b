"""The answers of certify and prior train: names and folders in, numbers and text out."""
from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.judge.certificate import LEVELS, Certificate, certificate_page, certify
from spectrabox.sampling.prior.band_calibration import AT_95, LeftOut, band_figures, train
from spectrabox.sampling.prior.families.family_models import FAMILIES
from spectrabox.sampling.prior.families.family_names import WORDS
from spectrabox.sampling.prior.libraries import ReflectanceLibrary, read_library
from spectrabox.sampling.prior.mixture import LogitMixture, load_prior, of_families
from spectrabox.sampling.prior.training import MIXED
from spectrabox.session.commands.requests import CertifyRequest, TrainRequest
from spectrabox.session.signals.signal_options import response_of_names


def certify_answer(request: CertifyRequest) -> tuple[dict[str, Any], str]:
    """JSON object and page of ``spectrabox certify``."""
    if not 0 <= request.noise < 0.5:
        raise InputError(f"a relative noise of {request.noise:g} was given; 0 to 0.5 is needed")
    prior = of_families(load_prior(request.prior), request.family)
    relative_response = response_of_names(request.sensitivity, request.light)
    certificates = [certify(prior, read_library(folder), relative_response, request.noise,
                            lights=request.delta_light)
                    for folder in request.folders]
    return ({"libraries": [_certificate_facts(certificate) for certificate in certificates],
             "prior": prior.source, "noise": request.noise},
            certificate_page(certificates, prior, f"{request.sensitivity} under {request.light}"))


def _certificate_facts(certificate: Certificate) -> dict[str, Any]:
    same = ("name", "curves", "left_out", "rmse", "spectral_angle", "curve_coverage", "width",
            "sharpness", "winkler", "delta_e00", "by_wavelength", "bright", "shares", "by_family",
            "stated", "unfamiliar", "trained_on", "verdict")
    return {**{name: getattr(certificate, name) for name in same},
            "coverage": {f"{level:g}": certificate.coverage[level] for level in LEVELS},
            "coverage_standard_error": certificate.coverage_error}


def train_answer(request: TrainRequest) -> tuple[dict[str, Any], str, LogitMixture]:
    """JSON object, text and prior of ``spectrabox prior train``."""
    libraries: dict[str, list[ReflectanceLibrary]] = {}
    for text in request.folders:
        family, folder = family_and_folder(text)
        libraries.setdefault(family, []).append(read_library(folder))
    families = {name: family if request.models else replace(family, models={}, stated_components=0,
                                                    stated_models={})
                for name, family in FAMILIES.items()}
    prior, left_out = train(libraries, response_of_names(request.sensitivity, request.light),
                            request.seed, families)
    rows = [left_out_facts(prior, part) for part in left_out]
    lines = [f"{'left out':<20} {'family':<8} {'curves':>6} {'RMSE':>7} {'95 % holds':>10} "
             f"{'width':>6} | {'stated: RMSE':>12} {'95 % holds':>10} {'width':>6}"]
    lines += [_left_out_line(row) for row in rows]
    lines += [f"{library.name}: left out {count} curves, {reason}"
              for read in libraries.values() for library in read
              for reason, count in library.left_out.items()]
    factors = {name: {"none stated": prior.band_factors[index, AT_95].tolist(),
                      "stated": prior.stated_factors[index, AT_95].tolist()}
               for index, name in enumerate(prior.families)}
    facts = {"left_out_in_turn": rows,
             "certificates": {name: asdict(one) for name, one in prior.certificates.items()},
             "band_factors_95": factors,
             "curve_factor": prior.curve_factor, "source": prior.source}
    return facts, "\n".join(lines), prior


def family_and_folder(text: str) -> tuple[str, Path]:
    """The family and the folder of FAMILY=FOLDER; paint where a folder stands alone."""
    family, separator, folder = text.partition("=")
    word = WORDS.get(family, family)
    named = bool(separator) and word in (*FAMILIES, MIXED)
    return (word, Path(folder)) if named else ("paint", Path(text))


def left_out_facts(prior: LogitMixture, part: LeftOut) -> dict[str, Any]:
    """What the calibrated 95 % bands did on a library or model left out; without its figures with
    none stated where it counts only for a stated family.
    """
    figures = {kind: {"rmse": judgement.rmse} | asdict(band_figures(prior, part, kind))
               for kind in ("unstated", "stated")
               if (judgement := getattr(part, kind)) is not None}
    return {"name": part.name, "family": part.family, "curves": part.curves,
            "measured": part.measured, **figures.get("unstated", {}), "stated": figures["stated"]}


def _left_out_line(row: dict[str, Any]) -> str:
    free = (f"{row['rmse']:7.4f} {row['coverage']:10.3f} {row['width']:6.3f}" if "rmse" in row else
            f"{'only where stated':>25}")
    said = row["stated"]
    return (f"{row['name']:<20} {row['family']:<8} {row['curves']:6d} {free} | {said['rmse']:12.4f}"
            f" {said['coverage']:10.3f} {said['width']:6.3f}")
