"""The paper's brute force as a baseline: a monochrome rendering per wavelength and step.

It renders with ``llvm_ad_mono`` in a process of its own, since a process keeps to one variant of
Mitsuba. The light multiplies afterwards; the integral over wavelength is the trapezoid rule on
``WAVELENGTHS`` equal steps.
"""
from __future__ import annotations

import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.grid import basis_matrix, grid_from_nm
from spectrabox.radiometry.interreflection import response_matrix
from spectrabox.reconstruct.gradient_engine import LEARNING_RATE, START, TAIL, cosine_rate
from spectrabox.reconstruct.rendering.llvm import ensure_llvm
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import PhotoView

WAVELENGTHS = 31
VARIANT = "llvm_ad_mono"
_SPECTRUM = re.compile(r'<spectrum name="(\w+)" type="regular">.*?</spectrum>', re.DOTALL)
_FILM = re.compile(r'<film type="specfilm">.*?</film>', re.DOTALL)


@dataclass(frozen=True)
class MonochromeJob:
    """All that the other process needs."""

    xml: str                    # spectra as single values, luminance film
    bsdfs: tuple[str, ...]      # of all materials, the unknown ones first
    basis: np.ndarray           # (J, N) at the J wavelengths
    response: np.ndarray        # (K, J)
    known: np.ndarray           # (M - U, J) reflectances of the known materials
    measured: np.ndarray        # (H, W, K)
    weight: np.ndarray          # (H, W, K)
    scale: float | None
    steps: int
    spp: int                    # per wavelength
    seed: int


def descend(job: MonochromeJob) -> np.ndarray:
    """Coefficients (U, N) after all steps of the job, run in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_descend, job).result()


def monochrome_job(view: PhotoView, settings: InversionSettings) -> MonochromeJob:
    """The view at ``WAVELENGTHS`` wavelengths, as the other process takes it.

    Parameters
    ----------
    view : PhotoView
    settings : InversionSettings
        Of which ``coefficients``, ``steps``, ``spp`` and ``seed`` count.
    """
    grid = grid_from_nm(np.linspace(view.grid.nm[0], view.grid.nm[-1], WAVELENGTHS))
    curves = np.array([np.interp(grid.nm, view.grid.nm, curve) for curve in view.sensitivities])
    response = response_matrix(grid, curves, np.interp(grid.nm, view.grid.nm, view.light))
    known = [material for material in view.scene_materials if material.reflectance is not None]
    weight = view.used[..., None] / view.variance
    return MonochromeJob(
        monochrome_xml(view), tuple(material.bsdf for material in (*view.unknown, *known)),
        basis_matrix(grid.nm, settings.coefficients), response,
        np.array([np.interp(grid.nm, view.grid.nm, material.reflectance) for material in known
                  if material.reflectance is not None]).reshape(-1, WAVELENGTHS),
        view.measured, weight / np.count_nonzero(weight),
        None if view.light_scale is None else view.light_scale.value, settings.steps,
        settings.spp, settings.seed)


def monochrome_xml(view: PhotoView) -> str:
    """The scene with one value in place of every spectrum, light 1, and a film of one channel."""
    half = {material.bsdf: np.full(2, 0.5) for material in view.scene_materials}
    xml = view.xml(half, light=np.ones(2), bands={"one": np.ones(2)})
    width, height = view.size
    film = (f'<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" '
            f'value="{height}"/><string name="pixel_format" value="luminance"/><string '
            'name="component_format" value="float32"/><rfilter type="box"/></film>')

    def one_value(match: re.Match[str]) -> str:
        value = 1.0 if match[1] in ("radiance", "intensity", "irradiance") else 0.5
        return f'<spectrum name="{match[1]}" value="{value}"/>'

    return _SPECTRUM.sub(one_value, _FILM.sub(film, xml))


def _descend(job: MonochromeJob) -> np.ndarray:
    """Adam on the coefficients of the unknown materials; runs where nothing else has been rendered.
    """
    ensure_llvm()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(VARIANT)
    scene = mi.load_string(job.xml, optimize=False)
    parameters = mi.traverse(scene)
    keys = [next(key for key in parameters.keys()  # noqa: SIM118 - not a dict
                 if key.startswith(f"{bsdf}.") and key.endswith(".value")) for bsdf in job.bsdfs]
    parameters.keep(keys)
    count, unknown = job.basis.shape[1], len(keys) - len(job.known)
    names = keys[:unknown]
    optimizer = mi.ad.Adam(lr=LEARNING_RATE)
    for key in names:
        optimizer[key] = mi.Float(np.full(count, START, dtype=np.float32))
    tail = []
    scale = job.scale or 1.0

    def show(wavelength: int) -> None:
        """Put the reflectances at one wavelength into the scene."""
        for key, values in zip(keys[unknown:], job.known, strict=True):
            parameters[key] = mi.Float(float(values[wavelength]))
        row = mi.Float(job.basis[wavelength].astype(np.float32))
        for key in names:
            parameters[key] = dr.sum(optimizer[key] * row)
        parameters.update()

    for step in range(job.steps):
        optimizer.set_learning_rate(LEARNING_RATE * cosine_rate(step / job.steps))
        draws = [2 * ((job.seed * 100003 + step) * WAVELENGTHS + index) % 2**32
                 for index in range(len(job.basis))]
        signal = np.zeros(job.measured.shape)
        for wavelength, draw in enumerate(draws):
            with dr.suspend_grad():
                show(wavelength)
                plane = np.array(mi.render(scene, spp=job.spp, seed=draw))[:, :, :1]
            signal += plane * job.response[:, wavelength] * scale
        slope = 2 * job.weight * (signal - job.measured) * scale
        # The adjoint rendering reads the scene as it stands: every wavelength must be put back
        # before its own.
        for wavelength, draw in enumerate(draws):
            show(wavelength)
            plane = mi.render(scene, parameters, spp=job.spp, seed=draw, seed_grad=draw
                              + 1)[:, :, 0]
            weight = mi.TensorXf((slope @ job.response[:, wavelength]).astype(np.float32))
            dr.backward(dr.sum(plane * weight, axis=None))
        optimizer.step()
        for key in names:
            optimizer[key] = dr.clip(dr.detach(optimizer[key]), 0.0, 1.0)
        if step >= min((1 - TAIL) * job.steps, job.steps - 1):
            tail.append(np.array([np.array(optimizer[key]) for key in names], dtype=np.float64))
    return np.asarray(np.mean(tail, axis=0))
