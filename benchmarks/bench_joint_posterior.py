"""What interreflection tells: joint posterior of three materials of a box against each material's
own signal.

A unit cube whose six walls are cut into patches; form factors between patches from their centres
with exact reciprocity, light falling on the floor and the walls. Two opposite walls have materials
of their own, the rest shares one. Light transport up to six reflections. Truths are measured
reflectances that the prior was not trained on: chart patches and test colours, or with --data
artists' paints.
"""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import LightTransport, SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.sampling.prior.draws import sample_prior
from spectrabox.sampling.prior.libraries import read_library, without_near_duplicates
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior
from spectrabox.sampling.prior.training import balanced, enriched, fit_mixture
from spectrabox.sampling.scene.labels import find_modes
from spectrabox.sampling.scene.posterior import information_bits, joint_problem
from spectrabox.sampling.scene.sampling import sample_joint

BOUNCES, CUTS = 6, 8
PIXELS = 64 * 64     # of the photo; each patch is the mean of its share of them
ALONE = 1e-3        # relative error of each material's own signal
PAINTS, OTHERS = ("kremer_pigments", "ntu_watercolour"), ("cassava", "rawtoaces190",
                                                          "usgs_minerals")


def box_transport(cuts: int = CUTS, bounces: int = BOUNCES) -> LightTransport:
    """Transport (6 cuts^2 patches, 84 products) of the cube: wall x=0 is material 0, x=1 is 1, the
    others are 2.
    """
    place, normal, wall = _patches(cuts)
    toward = place[None] - place[:, None]
    distance = np.linalg.norm(toward, axis=2) + np.eye(len(place))
    leaving = np.maximum(np.einsum("pqi,pi->pq", toward, normal), 0) / distance
    arriving = np.maximum(np.einsum("pqi,qi->pq", -toward, normal), 0) / distance
    form = leaving * arriving / (np.pi * distance**2) / cuts**2
    form /= np.maximum(form.sum(axis=1, keepdims=True), 1e-12)   # a closed box: every ray arrives
    lamp = np.array([0.5, 0.5, 0.9])
    to_lamp = lamp - place
    direct = np.maximum(np.einsum("pi,pi->p", to_lamp, normal), 0) / np.linalg.norm(to_lamp,
                                                                                    axis=1)**3
    direct /= direct.mean()
    materials = np.where(wall == 0, 0, np.where(wall == 1, 1, 2))
    arrived = {(0, 0, 0): direct}
    left: dict[tuple[int, ...], np.ndarray] = {}
    for _ in range(bounces):
        radiance: dict[tuple[int, ...], np.ndarray] = {}
        for exponents, light in arrived.items():
            for m in range(3):
                key = tuple(int(n + (m == k)) for k, n in enumerate(exponents))
                radiance[key] = radiance.get(key, np.zeros(len(place))) + np.where(materials == m,
                                                                                   light, 0)
        for key, value in radiance.items():
            left[key] = left.get(key, np.zeros(len(place))) + value
        arrived = {key: form @ value for key, value in radiance.items()}
    keys = sorted(left, key=lambda key: (sum(key), key))
    return LightTransport(("left", "right", "white"), np.array(keys),
                          np.array([left[key] for key in keys]).T)


def _patches(cuts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    at = (np.arange(cuts) + 0.5) / cuts
    place, normal, wall = [], [], []
    for axis in range(3):
        for side in (0, 1):
            for u in at:
                for v in at:
                    point = np.insert([u, v], axis, side)
                    inward = np.zeros(3)
                    inward[axis] = 1 - 2 * side
                    place.append(point)
                    normal.append(inward)
                    wall.append(2 * axis + side)
    return np.array(place), np.array(normal), np.array(wall)


def charts() -> np.ndarray:
    """Reflectances (n, 61) of chart patches and test colours, which the shipped prior was not
    trained on.
    """
    return np.concatenate([values for name, values in test_reflectances(GRID).items()
                           if name != "CES99"])


def artists_paints(data: Path) -> tuple[LogitMixture, np.ndarray]:
    """A prior learnt without artists' paints, and the paints (n, 61): Kremer pigments and NTU
    watercolours.
    """
    libraries = {name: read_library(data / "reflectance" / name) for name in (*PAINTS, *OTHERS)}
    different = {name: without_near_duplicates(one.reflectances) for name, one in libraries.items()}
    rng = np.random.default_rng(0)
    others = np.concatenate([balanced(different[name], rng) for name in OTHERS])
    prior = fit_mixture(enriched(others))
    return prior, np.concatenate([balanced(different[name], rng) for name in PAINTS])


def direct_only() -> LightTransport:
    """Each material seen alone under direct light."""
    return LightTransport(("left", "right", "white"), np.eye(3, dtype=int), np.eye(3))


def scene(transport: LightTransport, prior: LogitMixture, response: np.ndarray, truth: np.ndarray,
          noise: float,
          seed: int) -> dict[str, float]:
    """RMSE, width and coverage of the joint posterior and of each material alone (its signal known
    to 0.1 %).
    """
    rng = np.random.default_rng(seed)
    clean = transport.coefficients @ (np.exp(transport.exponents @ np.log(truth)) @ response.T)
    noise /= np.sqrt(PIXELS / len(clean))
    photo = clean * (1 + noise * rng.standard_normal(clean.shape))
    started = time.perf_counter()
    problem = joint_problem(transport, response, photo,
                            noise * np.maximum(clean, 1e-3 * clean.max()), prior)
    find_modes(problem)
    map_seconds = time.perf_counter() - started
    samples = sample_joint(problem, seed, refuse=False)
    seconds = time.perf_counter() - started
    alone, alone_bits = each_alone(prior, response, truth, rng)
    bits = information_bits(problem) - alone_bits
    return {**_judge(samples.spectra, truth, "joint"), **_judge(alone, truth, "alone"),
            "bits": float(bits.mean()), "map_s": map_seconds, "draws_s": seconds,
            "converged": float(samples.converged),
            "effective": samples.effective_samples, "tail": samples.tail,
            "unsolved": samples.unsolved}


def each_alone(prior: LogitMixture, response: np.ndarray, truth: np.ndarray,
               rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draws (T, 3, P) of each material from its own signal, known to 0.1 %, under the same prior;
    bits it tells.
    """
    own = truth @ response.T
    signal = own * (1 + ALONE * rng.standard_normal(own.shape))
    draws = [sample_prior(SpectralMeasurement(GRID, response, values, np.diag((ALONE * values)**2)),
                          4000, 1, prior=prior).spectra for values in signal]
    problem = joint_problem(direct_only(), response, signal, ALONE * own, prior)
    return np.array(draws).transpose(1, 0, 2), information_bits(problem)


def _judge(spectra: np.ndarray, truth: np.ndarray, name: str) -> dict[str, float]:
    lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
    return {f"{name}_rmse": float(np.sqrt(np.mean((spectra.mean(axis=0) - truth)**2,
                                                  axis=1)).mean()),
            f"{name}_coverage": float(np.mean((truth >= lower) & (truth <= upper))),
            f"{name}_width": float(np.mean(upper - lower))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.01, 0.05])
    parser.add_argument("--light", default="LED-B3")
    parser.add_argument("--data", type=Path, help="folder with reflectance/: truths are then "
                        "artists' paints, and the prior is learnt on the other libraries")
    parser.add_argument("--seed", type=int, default=0,
                        help="which scenes; 0 is what the documentation reports")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    transport = box_transport()
    fine = relative_response("Nikon 5100 (NPL)", arguments.light)
    response = fine @ interpolation_matrix(GRID.nm, np.arange(400, 701))
    prior, paints = (load_prior(),
                     charts()) if arguments.data is None else artists_paints(arguments.data)
    paints = np.clip(paints, 0.005, 0.995)
    table = []
    for noise in arguments.noise:
        rng = np.random.default_rng(arguments.seed)
        rows = [scene(transport, prior, response, paints[rng.choice(len(paints), 3, replace=False)],
                      noise,
                      1000 * arguments.seed + number) for number in range(arguments.scenes)]
        mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
        mean |= {"noise": noise, "map_s_max": max(row["map_s"] for row in rows),
                 "draws_s_max": max(row["draws_s"] for row in rows)}
        mean["coverage_error"] = float(np.std([row["joint_coverage"] for row in rows])
                                       / np.sqrt(len(rows)))
        mean["rmse_ratio"] = mean["joint_rmse"] / mean["alone_rmse"]
        mean["width_ratio"] = mean["joint_width"] / mean["alone_width"]
        table.append(mean)
    if arguments.json:
        print(json.dumps({"scenes": arguments.scenes, "rows": table}))
        return
    print(f"{'noise':>6} {'RMSE joint/alone':>18} {'ratio':>6} {'width joint/alone':>18} "
          f"{'ratio':>6} {'coverage':>20} {'bits':>5} {'MAP ms':>7} {'draws s (max)':>13}")
    for row in table:
        print(f"{row['noise']:6.2f} {row['joint_rmse']:9.4f}/{row['alone_rmse']:.4f} "
              f"{row['rmse_ratio']:8.2f} "
              f"{row['joint_width']:9.3f}/{row['alone_width']:.3f} {row['width_ratio']:9.2f} "
              f"{row['joint_coverage']:6.3f}+-{row['coverage_error']:.3f}/"
              f"{row['alone_coverage']:.3f} "
              f"{row['bits']:5.1f} {1e3 * row['map_s']:7.0f} {row['draws_s']:6.1f} ("
              f"{row['draws_s_max']:.1f})  "
              f"{row['converged'] * arguments.scenes:.0f} of {arguments.scenes} converged")


if __name__ == "__main__":
    main()
