"""What later stages take, loaded while the first ones decode photos."""
from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable, Iterator, Mapping

from spectrabox.radiometry.outside.loaded_beside import loaded_beside
from spectrabox.session.stages.order import FLAT_WRITER, SCENE_WRITER, Stage

DECODING = ("chart", "photo")       # LibRaw, OpenCV and OpenImageIO are at work there, not Python


@contextlib.contextmanager
def loading_ahead(stages: Mapping[str, Stage], flat: bool, writer: bool,
                  device: str) -> Iterator[Callable[[str], None]]:
    """Load modules and renderer in a thread, from the first stage that decodes photos on.

    The block is given a function to be called with the name of each stage before it is run. It
    waits for what is being loaded where a stage takes it: no other thread may be at work where a
    second process begins.

    Parameters
    ----------
    stages : mapping
        Of the session, by name.
    flat : bool
        Whether it measures flat samples, which need no renderer.
    writer : bool
        Whether what writes the report is loaded too.
    device : {"auto", "cpu", "cuda"}
        Where that works.
    """
    def load() -> None:
        for name in ("calibrate", "reconstruct", "signals"):
            if name in stages:
                importlib.import_module(stages[name].module)
        if writer:
            importlib.import_module(FLAT_WRITER if flat else SCENE_WRITER)
        if not flat:
            from spectrabox.reconstruct.rendering.renderer import start_mitsuba
            start_mitsuba(device)

    waits: list[Callable[[], None]] = []
    with contextlib.ExitStack() as ended:
        def ready_for(stage: str) -> None:
            if stage not in DECODING:
                for wait in waits:
                    wait()
            elif not waits:
                waits.append(ended.enter_context(loaded_beside(load)))

        yield ready_for
