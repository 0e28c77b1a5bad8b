"""Several photos of the same materials as one answer, the bands of all of them stacked."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.records import JointReconstruction, Reconstruction, RegionTransport
from spectrabox.radiometry.response import white_signal
from spectrabox.reconstruct.fit.identifiability import band_signals
from spectrabox.reconstruct.fit.transport_fit import TransportFit
from spectrabox.reconstruct.view import View, unknown_materials

SAME = 1e-9             # relative: responses closer than this are the same
# of white: error given to every stacked signal, so that bands which repeat others stay regular
REDUNDANT = 1e-4


def joint_record(views: Sequence[View], records: Sequence[Reconstruction],
                 fit: TransportFit | None,
                 regions: Sequence[RegionTransport | None]) -> JointReconstruction:
    """The views' records with their bands stacked.

    Parameters
    ----------
    views, records : V each
    fit : TransportFit or None
        None from an engine that takes a single view: its signals are taken as they are.
    regions : of each view
        Left out where a view has none.
    """
    responses = [view.response / white_signal(view.response)[:, None] for view in views]
    distinct = [number for number, response in enumerate(responses)
                if not any(_same(response, other) for other in responses[:number])]
    materials = tuple(dict.fromkeys(name for record in records for name in record.materials))
    shown = {name: (record, index) for record in reversed(records)
             for index, name in enumerate(record.materials)}
    first_shown = [shown[name] for name in materials]
    spectra = np.array([record.spectra[index] for record, index in first_shown])
    known = tuple(record.known[index] for record, index in first_shown)
    response = np.vstack([responses[number] for number in distinct])
    view_of_band = np.repeat(distinct, [len(views[number].bands) for number in distinct])
    signal = spectra @ response.T
    covariance = np.zeros((len(materials), len(response), len(response)))
    if fit is None:
        signal, covariance = np.array(records[0].signal), np.array(records[0].signal_covariance)
    else:
        unknown = [materials.index(material.name) for material in unknown_materials(views)]
        operator = response @ views[0].basis(fit.coefficients.shape[1])
        signal[unknown], covariance[unknown] = band_signals(fit, operator, len(unknown))
    model = np.zeros_like(covariance)
    for number in distinct:
        bands = np.flatnonzero(view_of_band == number)
        same = [record for record, other in zip(records, responses, strict=True)
                 if _same(other, responses[number])]
        for index, name in enumerate(materials):
            parts = [record.model_covariance[record.materials.index(name)] for record in same
                     if name in record.materials]
            # the mean, not divided by their number: the errors of one model are correlated
            if parts:
                model[index][np.ix_(bands, bands)] = np.mean(parts, axis=0)
    if len(views) > 1:
        covariance = covariance + REDUNDANT**2 * np.eye(len(response))
    return JointReconstruction(
        tuple(records), tuple(view.name for view in views), materials, known, views[0].grid,
        spectra, tuple(f"{views[number].name}: {band}" for number in distinct
                       for band in views[number].bands),
        view_of_band, response, signal, covariance, model,
        tuple(region for region in regions if region is not None))


def _same(response: np.ndarray, other: np.ndarray) -> bool:
    """Whether two responses (K, P) are the same within round-off."""
    return response.shape == other.shape and bool(
        np.abs(response - other).max() <= SAME * np.abs(other).max())
