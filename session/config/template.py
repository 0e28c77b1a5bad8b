"""What ``spectrabox new`` writes: a commented session.toml, and the schema that editors read."""
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from spectrabox.measure.shoot import options, shoot
from spectrabox.radiometry.files import write_text_whole

SCHEMA_NAME = "session.schema.json"
TEMPLATES = Path(__file__).parent / "templates"
SESSION, CHART = shoot.SessionSection(), shoot.ChartSection()
REPEATABILITY, STRAY_LIGHT = options.Repeatability(), options.StrayLight()
RECONSTRUCT, SAMPLING = options.Inversion(), options.Sampling()
SESSION_TEMPLATE = f'''#:schema ./{SCHEMA_NAME}
# A spectrabox session. Every file name is relative to this folder. Lines with # are comments.
# Put photos into photos/, spectra into spectra/, Mitsuba scenes into scene/.
# Then: spectrabox check . and spectrabox run .

[session]
name = "{SESSION.name}"
operator = ""
notes = ""
seed = {SESSION.seed}                            # same seed, same results

[photos]
object = "photos/object.dng"        # the scene: camera raw, or linear EXR / TIFF
chart = "photos/chart.dng"          # a ColorChecker Classic under the same light, same camera
# flat = "photos/flat.dng"          # evenly lit white card: corrects vignetting
# dark = ["photos/dark.dng"]        # lens covered, same exposures
# A list of files in place of one photo is an exposure bracket.

[chart]
# layout = "{CHART.layout}"   # or another chart that is sold, or a file of your own
# reference = "spectra/chart.csv"   # your own, measured; by default copies as they are sold
scene = "scene/chart.xml"           # light and chart in place; the chart is a rectangle, id "chart"
# Only if the chart is not found: its corners at dark skin, bluish green, black and white.
# corners_px = [[x, y], [x, y], [x, y], [x, y]]

# [camera]
# lens = "lens.json"                # from 'spectrabox geometry lens': object photos are undistorted

# [repeatability]                   # from chart photo to object photo
# light = {REPEATABILITY.light}
# shutter = {REPEATABILITY.shutter}
# lamp_position = {REPEATABILITY.lamp_position}             # in the chart scene, of its distance
# scene_level = {REPEATABILITY.scene_level}                # on the scene, against the chart's
# plane = {REPEATABILITY.plane}                      # of the light on flat samples

# [stray_light]                     # in the object photo; a dark room and a lens hood lower it
# glare = {STRAY_LIGHT.glare}                     # of the picture's mean signal
# ambient = {STRAY_LIGHT.ambient}                   # of the brightest irradiance

[light]
spectrum = "spectra/light.csv"      # {{ file = "spectra/all.csv", column = 2 }} for one of several

[sensitivity]
from = "chart"                      # or a file of measured curves: "spectra/camera.csv"
# method = "prior"                  # from measured cameras; or "smooth", "nonnegative", "paper"
# truth = "spectra/camera.csv"      # measured curves to compare with

[scale]
from = "chart"                      # or "material": a material with a known spectrum sets it

[scene]
file = "scene/scene.xml"            # geometry, camera pose and light in their places

# [views.warm]                      # the same materials under another light, or from elsewhere
# photo = "photos/warm.dng"
# light = "spectra/warm.csv"        # or "unknown"; without it the lamp above
# same_light_as = "warm"            # in place of light: the lamp of another view
# lamp = "moved"                    # of flat samples: the same lamp, in another place
# filter = "spectra/orange.csv"     # its transmittance, or "unknown"; before lens or lamp
# chart = "photos/chart_warm.dng"   # without it: materials in common tell its strength

[materials.wall]                    # one table for every BSDF of the scene's surfaces
bsdf = "wall"                       # its id in the scene
# known = "spectra/wall.csv"        # measured, taken as given
# truth = "spectra/wall.csv"        # measured, only compared with

[reconstruct]
engine = "{RECONSTRUCT.engine}"                     # "gradient" where a material has a coat
coefficients = {RECONSTRUCT.coefficients}                   # B-spline coefficients of each spectrum
width = {RECONSTRUCT.width}                          # pixels of the rendered view
steps = {RECONSTRUCT.steps}                         # of the gradient engine
spp = {RECONSTRUCT.spp}                            # paths per pixel of each step

[sampling]
method = "{SAMPLING.method}"                    # from measured reflectances; or "uniform", "paper"
draws = {SAMPLING.draws}
level = {SAMPLING.level}
'''


class TomlSchema(GenerateJsonSchema):
    """A schema without null, which TOML does not have: a key is left out instead."""

    def nullable_schema(self, schema: Any) -> dict[str, Any]:
        """Of what may be null: of what it is otherwise."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: Any) -> dict[str, Any]:
        """Of what has a default, said unless it is null."""
        written = super().default_schema(schema)
        return {name: value for name, value in written.items()
                if name != "default" or value is not None}


def session_schema() -> str:
    """The JSON Schema of session.toml, by which editors complete and check it."""
    return json.dumps(shoot.Shoot.model_json_schema(schema_generator=TomlSchema), indent=1) + "\n"


def write_schema(folder: Path) -> None:
    """Write the schema beside session.toml, whose first line names it."""
    write_text_whole(folder / SCHEMA_NAME, session_schema())


def template_names() -> tuple[str, ...]:
    """Names of the filled-in sessions that ``write_template`` knows."""
    return tuple(sorted(path.stem for path in TEMPLATES.glob("*.toml")))


def write_template(folder: Path, template: str | None = None) -> Path:
    """Write session.toml and its schema.

    Parameters
    ----------
    template : str, optional
        One of ``template_names``; by default every key is there, commented.

    Returns
    -------
    Path
        Of session.toml.
    """
    text = SESSION_TEMPLATE
    if template is not None:
        text = (TEMPLATES / f"{template}.toml").read_text(encoding="utf-8")
    write_text_whole(folder / shoot.FILE_NAME, text)
    write_schema(folder)
    return folder / shoot.FILE_NAME
