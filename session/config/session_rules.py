"""Faults of a session.toml between keys that are each well written."""
from __future__ import annotations

from spectrabox.radiometry.outside.names import name_fault, sharing_a_file
from spectrabox.radiometry.outside.words import shortened
from spectrabox.sampling.prior.families.words import unknown_families
from spectrabox.session.config.session_schema import (
    FILE_NAME,
    ONE_PHOTO,
    SessionConfig,
    by_band,
)


def inconsistencies(config: SessionConfig) -> list[str]:
    """A sentence for every pair of keys that do not go together."""
    problems = []
    if config.sampling.through == "transport" and config.sampling.method != "prior":
        problems.append(f"{FILE_NAME}: sampling.through = \"transport\" draws from the learnt "
                        "prior alone; set sampling.method = \"prior\" in place of "
                        f"{config.sampling.method!r}")
    if config.needs_chart and config.photos.chart is None:
        problems.append(f"{FILE_NAME}: photos.chart is missing, but sensitivities or scale are to "
                        "come from it; add the photo, or give [sensitivity] from = \"curves.csv\" "
                        "and [scale] from = \"material\"")
    if config.scale.source == "chart" and config.chart.scene is None:
        problems.append(f"{FILE_NAME}: chart.scene is missing: a scale from the chart photo needs "
                        "light and chart in their places; add it, or use [scale] from = "
                        "\"material\"")
    if config.scale.source == "material" and not any(m.known for m in config.materials.values()):
        problems.append(f"{FILE_NAME}: scale.from is \"material\", but no material has a known "
                        "spectrum; add known = \"spectra/NAME.csv\" to one")
    if all(material.known for material in config.materials.values()):
        problems.append(f"{FILE_NAME}: every material is known, so there is nothing to find; leave "
                        "out one 'known'")
    owners: dict[str, str] = {}
    for name, material in config.materials.items():
        if material.bsdf in owners:
            problems.append(f"{FILE_NAME}: materials {owners[material.bsdf]!r} and {name!r} name "
                            f"the same BSDF {material.bsdf!r}")
        owners[material.bsdf] = name
        if (wrong := unknown_families(material.families)) is not None:
            problems.append(f"{FILE_NAME}: materials.{name}.family: {wrong}")
    if config.chart.corners_px is not None and [len(c) for c in config.chart.corners_px] != [2] * 4:
        problems.append(f"{FILE_NAME}: chart.corners_px needs four [x, y] pairs: the outer corners "
                        "at dark skin, bluish green, black and white")
    if len(config.drift.chart_px) != len(config.drift.object_px):
        problems.append(f"{FILE_NAME}: drift.chart_px names {len(config.drift.chart_px)} "
                        f"references and drift.object_px {len(config.drift.object_px)}; name the "
                        "same ones in both, in one order")
    if config.drift.chart_px and not config.needs_chart:
        problems.append(f"{FILE_NAME}: [drift] compares the object photo with the chart photo, but "
                        "nothing of this session comes from a chart photo; leave it out")
    return problems + _names(config) + _views(config) + _bands(config)


def _names(config: SessionConfig) -> list[str]:
    """Names of the session and of what it has, by one rule; files are named after them."""
    named: dict[str, list[str]] = {
        "session.name = ": [config.session.name], "materials.": [*config.materials],
        "views.": [*config.views],
        "photos.object.": [band for band in by_band(config.photos.object) if band != ONE_PHOTO]}
    problems = []
    for place, names in named.items():
        problems += [f"{FILE_NAME}: {place}{shortened(name)}: {fault}" for name in names
                     if (fault := name_fault(name)) is not None]
        problems += [f"{FILE_NAME}: {place}{shortened(first)} and {shortened(other)}: files would "
                     "be named alike after both; rename one"
                     for first, other in sharing_a_file(names)]
    return problems


def _views(config: SessionConfig) -> list[str]:
    problems = []
    for name, view in config.views.items():
        if view.chart is not None and config.chart.scene is None:
            problems.append(f"{FILE_NAME}: views.{name}.chart needs chart.scene: a scale from a "
                            "chart photo needs light and chart in their places")
    if config.views and config.reconstruct.engine not in ("auto", "transport"):
        problems.append(f"{FILE_NAME}: several views are fitted by reconstruct.engine = "
                        f"\"transport\" alone; {config.reconstruct.engine!r} takes one photo")
    return problems


def _bands(config: SessionConfig) -> list[str]:
    """Photos taken band by band must name the same bands."""
    problems = []
    wanted = list(by_band(config.photos.object))
    others = {"photos.chart": by_band(config.photos.chart)}
    others |= {f"views.{name}.{key}": by_band(getattr(view, key)) for name,
               view in config.views.items()
               for key in ("photo", "chart")}
    if wanted == []:
        problems.append(f"{FILE_NAME}: photos.object names no file")
    for place, photo in others.items():
        if photo and list(photo) != wanted:
            said = " and ".join(", ".join(repr(name) for name in names) if any(names)
                                else "a single photo"
                                for names in (list(photo), wanted))
            problems.append(f"{FILE_NAME}: {place} and photos.object must have the same bands in "
                            f"the same order; they have {said}")
    if unknown := [name for name in config.photos.flats if name not in (ONE_PHOTO, *wanted)]:
        problems.append(f"{FILE_NAME}: photos.flat has {', '.join(map(repr, unknown))}, which "
                        "photos.object lacks")
    return problems
