"""What to do next, of results and of signals."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from spectrabox.api import arguments, estimates, session
from spectrabox.measure.advice.advice import Advice
from spectrabox.measure.advice.advise import advice_on_signal, stated_outlook
from spectrabox.measure.estimate import Estimate
from spectrabox.measure.more_bands.filter_fit import AtHand
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.spectra.filters import filters_at_hand
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.radiometry.system.threads import one_blas_thread


@one_blas_thread()
def advise(known: estimates.MeasuredSpectra | Estimate | session.Session | str | Path, *,
           lamps: Sequence[str] | Mapping[str, arguments.LightLike] | None = None,
           filters: str | Path | Mapping[str, arguments.FilterLike] | None = None,
           camera: arguments.CameraLike | None = None,
           light: arguments.LightLike | None = None) -> tuple[Advice, ...]:
    """What to do next, the best first.

    Parameters
    ----------
    known : result of `flat` or `reconstruct_scene`, Session or its folder, or estimate
    lamps : sequence of names or files, or mapping, optional
        Lamps at hand; where neither they nor filters are given, common ones.
    filters : path or mapping, optional
        Filters at hand: a file, a folder of files, or transmittances by name.
    camera : name, path, CameraEstimate, Calibration or (nm, curves), optional
        That saw the signal of an estimate, so that lamps and filters are weighed for it.
    light : name, path, (nm, values) or Spectrum
        Of that signal, with ``camera``.

    Returns
    -------
    tuple of Advice
        Each with ``says``, ``cost``, ``width_before``, ``width_after``, ``colour_before``,
        ``colour_after`` and ``how_to``.

    Raises
    ------
    InputError
        If a lamp, a filter or a session cannot be read, lamps and filters are asked of one region,
        or ``known`` is none of these.

    References
    ----------
    What each action is, and how it is forecast: docs/how-to/next.md.

    Examples
    --------
    >>> orange = sb.sample([0.53, 0.24, 0.08], camera="Nikon 5100 (NPL)", light="D65", noise=0.003)
    >>> for one in sb.advise(orange, lamps=["A", "FL11"], camera="Nikon 5100 (NPL)", light="D65"):
    ...     print(one.text)
    """
    hand = _at_hand(lamps, filters)
    if isinstance(known, str | Path):
        known = session.Session(known)
    if isinstance(known, session.Session):
        known = known.spectra
    if isinstance(known, estimates.MeasuredSpectra):
        if hand is None and known.found.failed_advice is None:
            return known.advice
        return known.found.advise(hand).overall
    if isinstance(known, Estimate):
        if (camera is None) != (light is None):
            raise errors.InputError(
                "lamps and filters are weighed for a signal by its camera and its "
                "light: give both, camera= and light=")
        if hand is None and camera is None:
            return known.advise() if known.failed_extras else known.advice
        if known.measurement is None or known.prior is None or known.measurement.states is not None:
            raise errors.InputError(
                f"lamps and filters are weighed for all regions of a photo together: "
                f"give the result that {known.name!r} is of")
        return advice_on_signal(
            known.measurement, known.prior, found=stated_outlook(known), hand=hand,
            curves=None if camera is None else arguments.as_curves(camera), present=None
            if light is None else spectrum_on_grid(arguments.as_spectrum(light), grid.FINE_GRID))
    raise errors.InputError(
        f"advise() takes a result of flat or reconstruct_scene, a session or its "
        f"folder, or an estimate, and got {type(known).__name__}")


def _at_hand(lamps: Sequence[str] | Mapping[str, arguments.LightLike] | None,
             filters: str | Path | Mapping[str, arguments.FilterLike] | None) -> AtHand | None:
    """Lamps and filters by name; None where neither is given."""
    if lamps is None and filters is None:
        return None
    by_name = lamps if isinstance(lamps, Mapping) else {name: name for name in lamps or ()}
    if isinstance(filters, str | Path):
        passed = filters_at_hand(Path(filters))
    else:
        passed = {name: arguments.as_filter(each) for name, each in (filters or {}).items()}
    return {**{name: spectrum_on_grid(arguments.as_spectrum(each), grid.FINE_GRID)
               for name, each in by_name.items()}, **passed}
