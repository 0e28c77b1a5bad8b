"""Where a curve of session.toml comes from: a column of a file, a light's word, a camera's name."""
from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from spectrabox.radiometry.checked_tables import ListOf, Table
from spectrabox.radiometry.files import names_a_file
from spectrabox.radiometry.spectra.light_words import UNKNOWN, vague_words

FROM_CHART = "chart"                    # of the sensitivities


class SpectrumTable(Table):
    """A spectrum in a text file."""

    file: str = Field(description="name of the file")
    column: str | int | None = Field(None, description="name or number, where it holds several")


class CurvesTable(Table):
    """Several curves in a text file, such as camera sensitivities."""

    file: str = Field(description="name of the file")
    columns: ListOf[str | int] | None = Field(None, description="names or numbers of the curves")


def _as_table(written: Any) -> Any:
    return {"file": written} if isinstance(written, str) else written


SpectrumRef = Annotated[SpectrumTable, BeforeValidator(
    _as_table, json_schema_input_type=str | SpectrumTable)]
CurvesRef = Annotated[CurvesTable, BeforeValidator(
    _as_table, json_schema_input_type=str | CurvesTable)]


class LightTable(Table):
    """A light: a spectrum in a text file, a word (CIE name, kind of lamp, "unknown"), or a colour
    temperature.
    """

    file: str | None = Field(None, description="name of the file of its spectrum")
    column: str | int | None = Field(None, description="name or number, where it holds several")
    word: str | None = Field(None, description="unknown, daylight, halogen, led, fluorescent, or a "
                             "CIE name such as D65")
    cct: float | None = Field(None, ge=1500, le=25000, description="correlated colour temperature "
                              "in kelvin, where nothing else is known")

    @model_validator(mode="after")
    def _says_one_thing(self) -> LightTable:
        if sum(said is not None for said in (self.file, self.word, self.cct)) != 1:
            raise ValueError("a light is either a file, a word or a cct: write \"light.csv\", "
                             "\"unknown\", \"D65\", or {cct = 3200}")
        return self

    @property
    def files(self) -> tuple[str, ...]:
        """The file of its spectrum, if it has one."""
        return () if self.file is None else (self.file,)

    @property
    def stated(self) -> bool:
        """Whether its spectrum is stated, by a file or by a CIE name."""
        return self.file is not None or (self.word is not None and vague_words(self.word) is None)


def _as_light(written: Any) -> Any:
    if not isinstance(written, str):
        return written
    by_name = vague_words(written) is not None or not (names_a_file(written) or "/" in written)
    return {"word" if by_name else "file": written}


LightRef = Annotated[LightTable, BeforeValidator(
    _as_light, json_schema_input_type=str | LightTable)]


class FilterTable(Table):
    """A filter before the lens or the lamp: its transmittance in a text file, or not known."""

    file: str | None = Field(None, description="name of the file of its transmittance, 0 to 1; of "
                             "a filter that nobody measured left out")
    column: str | int | None = Field(None, description="name or number, where it holds several")


def _as_filter(written: Any) -> Any:
    if not isinstance(written, str):
        return written
    return {} if written == UNKNOWN else {"file": written}


FilterRef = Annotated[FilterTable, BeforeValidator(
    _as_filter, json_schema_input_type=str | FilterTable)]


class SourceTable(Table):
    """Sensitivities: the chart's fit, measured curves in a text file, or a camera by its name."""

    file: str | None = Field(None, description="name of the file, or \"chart\"")
    columns: ListOf[str | int] | None = Field(None, description="names or numbers of the curves")
    camera: str | None = Field(None, description="a published camera or observer, or one of your "
                               "own that 'spectrabox camera add' keeps")

    @model_validator(mode="after")
    def _says_one_thing(self) -> SourceTable:
        if (self.file is None) == (self.camera is None):
            raise ValueError("sensitivity.from is either \"chart\", a file of measured curves, or "
                             "a camera's name")
        return self

    @property
    def words(self) -> str:
        """What it is called in a sentence."""
        return self.file or self.camera or ""


def _as_source(written: Any) -> Any:
    if not isinstance(written, str):
        return written
    by_name = written != FROM_CHART and not names_a_file(written) and "/" not in written
    return {"camera" if by_name else "file": written}


SourceRef = Annotated[SourceTable, BeforeValidator(
    _as_source, json_schema_input_type=str | SourceTable)]
