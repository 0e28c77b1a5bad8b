"""Writes the table of keys of docs/reference/session.md: each key with default, range and meaning
from the model of a shoot, and what else there is to say of it.
"""
from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from spectrabox.session.config.template import session_schema

PAGE = Path(__file__).resolve().parent / "reference" / "session.md"
HEAD = "| key | default | range | meaning |\n|---|---|---|---|\n"
BOX = "[measured with a tape](#a-box-measured-with-a-tape)"
# defaults that another key or a file of the program says
DEFAULTS = {"chart.reference": "a copy of the layout",
            "sensitivity.prior": "shipped", "materials.NAME.bsdf": "`NAME`",
            "views.NAME.light": "`light.spectrum`", "views.NAME.scene": "`scene.file`",
            "views.NAME.camera": "that of `scene.box`", "sensitivity.from": '`"chart"`'}
# what else there is to say, by key
REMARKS = {
    "photos.object": 'A table is `{ "450 nm" = "photos/450.dng", ... }`, stacked into one band '
    "each.",
    "photos.flat": "It is applied to the other photos; a table where each band has its own.",
    "photos.dark": "They are subtracted, and hot pixels left out.",
    "photos.not_linear": "They are marked as such everywhere.",
    "photos.orientation": "`flat` and `open` write that of the first photo.",
    "chart.layout": "[Other charts](charts.md).",
    "chart.reference": "What copies differ by is its error then; stated, it is taken as it is: of "
    "a ColorChecker `BabelColor Average`, or `ColorChecker after November 2014`, `ISO 17321-1`, "
    "`ColorChecker N Ohta`; or a file of measured patches: CSV, CGATS.",
    "chart.scene": "Both are in their places.",
    "chart.corners_px": "[Other charts](charts.md) say theirs. Of a scene pixels are as the sensor "
    "gives them, before the turning that viewers and the command `chart` do.",
    "chart.leave_out": "`[5, 10]`, say.",
    "camera.lens": "The renderer has a pinhole.",
    "repeatability.light": "A standard error. With `shutter` it enters the light scale, the same "
    "in all bands, unless the chart lies in the object photo itself.",
    "repeatability.lamp_position": "A standard error; moving the lamp in `chart.scene` by as much "
    "says what the light scale owes to it.",
    "repeatability.scene_level": "A standard error, the same in all bands and on all surfaces: the "
    "lamp stood a little elsewhere, shines unevenly to different sides, the chart was tilted. A "
    "known material that the photo shows measures it too (`materials.NAME.known`).",
    "repeatability.plane": "A standard error, the same in all bands and of all regions: tilt, "
    "height, distance.",
    "stray_light.glare": "A standard error, the same everywhere in the picture.",
    "stray_light.ambient": "A standard error; it matters most on surfaces in shadow.",
    "light.spectrum": "[What each says](../explanation/calibration.md"
    "#a-light-that-nobody-measured).",
    "light.by_id": '`{ ID = "spectra/other.csv" }`.',
    "sensitivity.from": "A camera is a published one, or one of your own that [`camera add` or "
    "`camera fit --keep`](../how-to/camera.md) keeps.",
    "sensitivity.method": "For other than three bands `prior` is smoothness.",
    "sensitivity.relative_error": "Where no chart photo tells.",
    "scale.from": "From the chart, materials with a known spectrum count too, together by their "
    'errors; with `"material"` they alone set the scale. Photograph chart and objects at the same '
    "exposure, since the exposure times and f-numbers that cameras record are rounded (1/60 s is "
    "really 1/64 s, f/11 is f/11.3): where they differ, up to 7 % for this rounding enters the "
    "scale's error.",
    "scene.file": "`[scene]` and `[materials]` make a session of a scene, `[regions]` in their "
    "place one of a [flat sample](#regions-of-a-flat-sample).",
    "scene.box": f"It is {BOX}.",
    "materials.NAME.bsdf": "A coat or a metal stays, any other plugin with a reflectance becomes "
    "`diffuse` (below).",
    "materials.NAME.known": "A [grey card in the box](../how-to/box.md#a-grey-card-in-the-box), "
    "say. It tells how bright the light on the scene is and whether its colour changed since the "
    "chart's photo, to 1 % and 0.5 % of a surface, and both are corrected.",
    "materials.NAME.family": "Textile holds paper and plastic too, earth wood, soil and stone. "
    'Several are a list. Bands of the method `"prior"` are narrower then, and so is what the fit '
    'with `spectrum_prior = "learnt"` expects; without it they cover every family by its share.',
    "materials.NAME.surface": "Of a coat or a metal the scene says it.",
    "regions.NAME.rect": "In pixels of the photo.",
    "regions.NAME.polygon": "In place of `rect`.",
    "regions.NAME.known": "A white card, say, which tells how bright the light is there.",
    "regions.NAME.family": "As of a material.",
    "regions.NAME.surface": "Beyond what the chart's patches do, it adds to all bands 0.2 ± 0.1, "
    "1.2 ± 0.6 or 3 ± 1.2 % of white, never less than none; where nothing is stated a mixture of "
    "the three, 78 % matt, 13 % satin, 9 % glossy.",
    "views.NAME.light": "It needs a chart photo of its own where either is unknown.",
    "views.NAME.lamp": "It [measures gloss, plane and shadow](../how-to/gloss.md); the photo shows "
    "the chart.",
    "views.NAME.filter": "Transmittance runs from 0 to 1, or in per cent; a column "
    "`standard_error` states its error, else 2 %. `[photos]` itself is without filter ([more "
    "bands](../how-to/more-bands.md)).",
    "views.NAME.lamp_at_mm": "[The lamp in two places](../how-to/box.md#the-lamp-in-two-places); a "
    "panel faces what it faced.",
    "reconstruct.engine": 'With `"auto"` it is `"gradient"` where a material is coated or glossy; '
    '`"gradient"` is that of the paper; `"single-bounce"` has direct light only.',
    "reconstruct.surface_error": "Lamp profile, pose and uneven paint make it.",
    "reconstruct.errors_from_scene": "Of a known paint too.",
    "reconstruct.mixing_error": "For photos that went through a camera's colour processing.",
    "reconstruct.spectrum_prior": '`"learnt"` is from measured reflectances. The signals for the '
    "samplers are taken with it off.",
    "sampling.through": "The traced light sees what interreflection tells, in every region of the "
    'photo; one photo, method `"prior"`.',
    "picture.step_nm": "The standard deviation has every second.",
    "picture.rect": "The table `[picture]` asks for the spectra of every pixel of the photo of "
    "`[photos]`, of a flat sample in the bands of all its photos; see [of a flat "
    "sample](../how-to/flat.md#a-picture-of-spectra), [of a scene](../how-to/picture.md).",
    "picture.format": "Mean and standard deviation are written so."}


def keys(schema: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Every key of session.toml with what the schema says of it, and whether it is required."""
    for table, written in schema["properties"].items():
        of_names = written.get("additionalProperties")
        reference = (of_names or written).get("$ref", "") or next(
            each["$ref"] for each in written.get("anyOf", written.get("allOf", []))
            if "$ref" in each)
        section = schema["$defs"][reference.rpartition("/")[2]]
        for key, said in section["properties"].items():
            yield (f"{table}.NAME.{key}" if of_names else f"{table}.{key}", said,
                   key in section.get("required", ()))


def default_of(key: str, said: dict[str, Any], required: bool) -> str:
    """The default of a key as session.toml would write it."""
    if required or key in DEFAULTS:
        return DEFAULTS.get(key, "required")
    default = said.get("default", "")
    if isinstance(default, float):
        return f"{default:g}"
    return f"`{json.dumps(default)}`" if default not in ("", []) else ""


def range_of(said: dict[str, Any]) -> str:
    """The limits of a number, or the words that are possible."""
    for kind in (said, *said.get("anyOf", ())):
        if "minimum" in kind:
            return f"{kind['minimum']} to {kind['maximum']}".replace(".0 ", " ")
        if "enum" in kind:
            return ", ".join(f"`{json.dumps(word)}`" for word in kind["enum"])
        if "const" in kind:
            return f"`{json.dumps(kind['const'])}`"
    return ""


def key_table() -> str:
    """The table of every key."""
    rows = []
    for key, said, required in keys(json.loads(session_schema())):
        meaning = said["description"]
        if key in REMARKS:
            meaning = f"{meaning.rstrip('.')}. {REMARKS[key]}"
        cells = (f"`{key}`", default_of(key, said, required), range_of(said), meaning)
        rows.append("| " + " | ".join(cells) + " |\n")
    return HEAD + "".join(rows)


def reference_page(page: str) -> str:
    """The page with its table of keys written anew."""
    return re.sub(r"(## Keys\n\n).*?(\n\n)", lambda found: found[1] + key_table().rstrip("\n")
                  + found[2], page, count=1, flags=re.DOTALL)


if __name__ == "__main__":
    PAGE.write_text(reference_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
