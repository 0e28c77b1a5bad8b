"""The stored results of a finished session, rendered under another light."""
from __future__ import annotations

from spectrabox.measure.captured import require_scene
from spectrabox.measure.results.calibration_facts import checks
from spectrabox.measure.scene.box_camera import scene_of
from spectrabox.measure.scene.relight import Relit, light_by_itself
from spectrabox.measure.scene.relight import relight as relight_scene
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.named_spectra import sensitivities as named_observer
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.session.kept_stages import FinishedRun

OBSERVER = "CIE 1931 2 Degree Standard Observer"


def relight(run: FinishedRun, *, light: str | None, observer: str,
            size: tuple[int, int], spp: int, device: str) -> tuple[Relit, tuple[str, ...]]:
    """Render the scene with the means of the draws.

    Parameters
    ----------
    run : FinishedRun
    light : str or None
        A CIE illuminant or a file; None for the session's own.
    observer : str
        Colour-matching functions by name or from a file of three curves.
    size : (width, height)
        In pixels.
    spp : int
        Paths per pixel.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    relit : Relit
    notes : tuple of str
        How surely the light by itself is known.

    Raises
    ------
    InputError
        If light or observer are not known.
    """
    records = run.records
    capture = require_scene(run.capture, "session.toml describes regions of a flat sample and no "
                            "scene; this needs a session with [scene]")
    joint, calibration = records.reconstruct.joint, records.calibrations(capture.views)[0]
    grid = joint.grid
    power = light_by_itself(calibration, grid) if light is None else named_light(light, grid)
    matching = named_observer(observer, grid)
    spectra = {name: spectrum if known else records.sample.spectra[name].samples
               for name, known, spectrum in zip(joint.materials, joint.known, joint.spectra,
                                                strict=True)}
    start_mitsuba(device)
    scene = scene_of(capture.views[0].scene)
    relit = relight_scene(scene, capture.bsdfs, spectra, grid, power, matching,
                          size=size, spp=spp, seed=capture.seed)
    posterior = calibration.light_posterior
    if light is not None or posterior is None:
        return relit, ()
    return relit, ("nobody measured the session's light: rendered under the most likely one",
                   *checks(posterior.findings))
