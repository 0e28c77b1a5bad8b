"""Errors and options that a measurement may state: one table for each, with limits and defaults.

session.toml has these tables as they are, and the functions of the library take their defaults.
Those of the inversion are those of ``reconstruct.settings``.
"""
from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from spectrabox.radiometry import checked_tables, error_model
from spectrabox.radiometry.published.published_tables import LIGHTS, published_names
from spectrabox.radiometry.system.words import known_name
from spectrabox.reconstruct.settings import Engine, InversionSettings, SpectrumPrior

INVERSION = InversionSettings()

RelativeError = Annotated[float, Field(ge=0, le=1)]
SplineCoefficients = Annotated[int, Field(ge=5, le=40)]
Surface = Literal["matt", "satin", "glossy"] | None
SURFACE_FIELD = Field(None, description="how much the surface mirrors, matt, satin or glossy, in "
                      "light that no camera tells from its colour")


class Repeatability(checked_tables.Table):
    """How well what two photos have in common comes back: standard errors that no photo tells."""

    light: RelativeError = Field(0.012, description="relative: of the light's strength, from the "
                                 "chart photo to the object photo")
    shutter: RelativeError = Field(0.009, description="relative: of the exposure at one setting, "
                                   "from photo to photo")
    lamp_position: RelativeError = Field(0.005, description="of the lamp in the chart scene, along "
                                         "each axis, relative to its distance from the chart")
    scene_level: RelativeError = Field(
        error_model.SCENE_LEVEL_ERROR,
        description="relative: of the light on a scene against that on its "
        "chart, by the lamp's position and beam and the chart's tilt; [scale] from = \"material\" "
        "measures it")
    plane: RelativeError = Field(
        error_model.PLANE_ERROR, description="relative: of the light on flat "
        "samples, whose plane is not quite the chart's; a white card "
        "among them measures it")

    @property
    def relative_error(self) -> float:
        """Of the exposure by light and shutter together."""
        return math.hypot(self.light, self.shutter)


class StrayLight(checked_tables.Table):
    """Light in the object photo that the scene does not hold: standard errors."""

    glare: RelativeError = Field(0.005, description="veiling glare of the lens, of the picture's "
                                 "mean signal; raised to what the chart photo shows")
    ambient: RelativeError = Field(0.002, description="light from elsewhere than the lamp, of the "
                                   "brightest irradiance in the picture")


class Inversion(checked_tables.Table):
    """How spectra are fitted to the photos."""

    engine: Engine = Field(INVERSION.engine, description="transport: light traced once, then "
                           "algebra; gradient: descent through the renderer; auto: by the "
                           "materials")
    surface_error: RelativeError = Field(
        INVERSION.surface_error, description="relative error of each surface's brightness in each "
        "band")
    brightness_error: RelativeError = Field(
        INVERSION.brightness_error, description="relative error of each surface's brightness in "
        "all bands alike")
    light_error: RelativeError = Field(INVERSION.light_error, description="relative error of each "
                                       "light's strength in a scene of several")
    mixing_error: RelativeError = Field(INVERSION.mixing_error, description="error of each entry "
                                        "of a band-mixing matrix")
    errors_from_scene: bool = Field(INVERSION.errors_from_scene, description="raise these errors "
                                    "to what surfaces of one paint show")
    spectrum_prior: SpectrumPrior = Field(INVERSION.spectrum_prior, description="prior on spectra "
                                          "inside the fit")
    coefficients: SplineCoefficients = Field(INVERSION.coefficients, description="spline "
                                             "coefficients of each reflectance")
    width: int = Field(96, ge=16, le=1024, description="width of the rendered view in pixels")
    steps: int = Field(INVERSION.steps, ge=20, le=5000, description="of the gradient engine")
    spp: int = Field(INVERSION.spp, ge=1, le=4096, description="paths per pixel and step of the "
                     "gradient engine")

    def settings(self) -> dict[str, Any]:
        """What ``reconstruct`` takes: all but the size of its photos."""
        return {name: value for name, value in vars(self).items() if name != "width"}


class Sampling(checked_tables.Table):
    """How spectra are drawn behind the fitted signals."""

    method: Literal["prior", "uniform", "paper"] = Field(
        "prior", description="prior: learnt from measured reflectances; uniform: all splines "
        "alike; paper: as published")
    through: Literal["surface", "transport"] = Field(
        "surface", description="surface: each material from its own signal; transport: all at "
        "once through the traced light")
    coefficients: SplineCoefficients = Field(11, description="of the splines of uniform, paper "
                                             "and of the exact bounds")
    draws: int = Field(4000, ge=1000, le=1_000_000, description="spectra for each material")
    level: float = Field(0.95, ge=0.5, le=0.999, description="of the printed band")


def _published_light(written: Any) -> Any:
    """A light by the name it is published under; what is no such name is refused elsewhere."""
    if not isinstance(written, str):
        return written
    return known_name(written, published_names(LIGHTS)) or written


LightName = Annotated[str, BeforeValidator(_published_light)]
PictureFormat = Literal["exr", "tiled-exr", "envi", "zarr"]


class PictureOptions(checked_tables.Table):
    """A picture of spectra: every pixel of the first photo, of a flat sample in the bands of all
    photos. Off without it.
    """

    rect: checked_tables.ListOf[float] | None = Field(
        None, description="[x0, y0, x1, y1]: two opposite corners "
        "in pixels of the photo; all of it where left out")
    light: LightName | None = Field(None, description="CIE name of a light besides D65 under "
                                    "which colours are shown")
    step_nm: Literal[5, 10, 15, 20, 25, 30, 50, 60] = Field(
        10, description="between wavelengths of the mean")
    format: PictureFormat = Field(
        "exr", description="of the spectra: spectral EXR of scan lines or tiles, ENVI images or "
        "OME-Zarr images")
    family: str | checked_tables.ListOf[str] | None = Field(
        None, description="what the surfaces are, as of a "
        "region")
    surface: Surface = SURFACE_FIELD

    @property
    def families(self) -> tuple[str, ...]:
        """The families that every surface is said to be one of; none where nobody said."""
        return (self.family,) if isinstance(self.family, str) else tuple(self.family or ())
