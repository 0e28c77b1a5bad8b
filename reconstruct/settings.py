"""What an operator may choose of a reconstruction, with its defaults."""
from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from spectrabox.radiometry.records.scenes import LearntSpectra

# auto: transport, or gradient for glossy materials
Engine = Literal["auto", "transport", "gradient", "single-bounce"]
SpectrumPrior = Literal["learnt", "smooth", "none"]
ENGINES: tuple[str, ...] = get_args(Engine)
SPECTRUM_PRIORS: tuple[str, ...] = get_args(SpectrumPrior)


@dataclass(frozen=True)
class InversionSettings:
    """Numbers an operator may choose, with the defaults of [reconstruct] in session.toml.

    This is their one definition: ``session.toml`` takes names and defaults from here. ``seed`` is
    the session's, and ``learnt`` the data of the prior "learnt". Errors are standard deviations of
    logarithms, so 0.01 is 1 %.
    """

    coefficients: int = 11          # of the spline of every unknown spectrum
    # steps at most, and paths per pixel and step, of the engines that descend
    steps: int = 160
    spp: int = 16
    seed: int = 1
    # of each surface in each band: light profile, pose, uneven paint
    surface_error: float = 0.01
    # weight of the prior "smooth" (reconstruct/fit/transport_fit.py)
    smoothness: float = 0.1
    engine: Engine = "auto"
    # What follows is for the transport engines alone.
    # of each surface, the same in all bands: light profile, geometry
    brightness_error: float = 0.0
    light_error: float = 0.0        # of each light of the scene, traced separately for it
    # of each entry of a band-mixing matrix: photos that went through colour processing
    mixing_error: float = 0.0
    block_error: float = 0.0        # of each block of pixels, besides its noise
    # raise these errors to what surfaces of one paint, or of a known one, show
    errors_from_scene: bool = True
    spectrum_prior: SpectrumPrior = "learnt"    # which needs ``learnt``
    learnt: LearntSpectra | None = None
