"""The photo that a run decoded last, for the stage that asks for it again."""
from __future__ import annotations

from typing import TYPE_CHECKING

from spectrabox.session.config.session_schema import SessionConfig

if TYPE_CHECKING:
    from spectrabox.radiometry.records import LinearImage

Photo = dict[str, tuple[str, ...]]


class OpenPhotos:
    """Photos of one run. One at a time is held: chart and samples are often in one photo."""

    def __init__(self) -> None:
        self._last: tuple[Photo, LinearImage, tuple[str, ...]] | None = None

    def developed(self, config: SessionConfig,
                  photo: Photo) -> tuple[LinearImage, tuple[str, ...]]:
        """As ``inputs.read_photo``."""
        if self._last is None or self._last[0] != photo:
            from spectrabox.session.stages.inputs import read_photo
            self._last = None           # its memory is wanted for the next
            self._last = (photo, *read_photo(config, photo))
        return self._last[1:]
