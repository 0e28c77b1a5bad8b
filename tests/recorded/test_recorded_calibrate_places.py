"""Recorded: the beam of a lamp on a wall, the light beyond a chart, and a camera's profile."""
import dataclasses

import numpy as np
import pytest
from geometry_views import TRUE
from uneven_charts import UNEVEN, camera, positions, sizes, surfaces

from spectrabox.calibrate import camera_profile, light_field
from spectrabox.calibrate.beam import beam_fit
from spectrabox.calibrate.beam.wall import WallCells, WallTable, read_wall, wall_cells
from spectrabox.calibrate.light_field import PicturePoints, light_elsewhere
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import ChartWhite, LinearImage, PhotoKind

LAMP = beam_fit._Lamp(np.array([610.0, 480.0, 770.0]), np.array([80.0, 50.0]))
AIM = np.array([650.0, 440.0])
# no pixel's centre lies on an edge or between two readings
CORNERS = [[24.31, 18.17], [130.23, 12.41], [141.13, 92.27], [17.37, 99.19]]
SIZE_MM = (1300.0, 900.0)


def said(call, *arguments, **more):
    try:
        return call(*arguments, **more)
    except (CheckError, InputError) as error:
        return f"{type(error).__name__}: {error}"


# ---- a wall in a photo ---------------------------------------------------------------------------

def stated(**changes):
    return {"corners_px": CORNERS, "size_mm": list(SIZE_MM), "lamp_at_mm": LAMP.at.tolist(),
            "lamp_size_mm": LAMP.size.tolist()} | changes


def photo(step=1.0, height=108, width=150):
    rng, (y, x) = np.random.default_rng(4), np.mgrid[0:height, 0:width]
    signal = np.stack([0.2 + x / 300, 0.5 - y / 400, 0.1 + (x + 2 * y) / 900], axis=-1)
    signal = signal + 0.01 * rng.standard_normal(signal.shape)
    variance = rng.uniform(1e-4, 3e-4, signal.shape)
    return LinearImage(signal.astype(np.float32), variance.astype(np.float32),
                       rng.uniform(size=signal.shape) > 0.996, step, None, None, None,
                       PhotoKind.RAW, "camera", "wall.dng", "")


def test_readings_of_a_wall(recorded):
    table = WallTable.model_validate(stated())
    larger = stated(corners_px=[[2 * x + 0.5, 2 * y + 0.5] for x, y in CORNERS])
    lens = dataclasses.replace(TRUE, width=150, height=108, matrix=np.array(
        [[150.0, 0, 72], [0, 152, 55], [0, 0, 1]]))
    plain = wall_cells(photo(), table)
    binned = wall_cells(photo(2.0), WallTable.model_validate(larger))
    recorded({"plain": plain, "binned": binned, "lens": wall_cells(photo(), table, lens)})
    np.testing.assert_allclose(binned.places_mm, plain.places_mm, rtol=1e-9)
    assert np.all(plain.places_mm.max(axis=0) < SIZE_MM) and plain.places_mm.min() > 0


def test_photos_of_a_wall_that_cannot_be_read_are_refused(recorded):
    table = {}
    for x, y in ((-0.49, 18.0), (-0.51, 18.0), (24.0, -0.51)):
        changed = stated(corners_px=[[x, y], *CORNERS[1:]])
        table[f"corner {x} {y}"] = said(lambda wall: len(wall_cells(photo(), wall).signal),
                                        WallTable.model_validate(changed))
    for x, y in ((149.49, 92.0), (149.51, 92.0), (141.0, 107.49), (141.0, 107.51)):
        changed = stated(corners_px=[*CORNERS[:2], [x, y], CORNERS[3]])
        table[f"corner {x} {y}"] = said(lambda wall: len(wall_cells(photo(), wall).signal),
                                        WallTable.model_validate(changed))
    wall = WallTable.model_validate(stated(corners_px=[[19.6, 19.7], [119.6, 19.7], [119.6, 79.7],
                                                    [19.6, 79.7]]))
    for count in (119, 120, 121):       # of 6000 pixels, 2 % are allowed
        marked = np.zeros((108, 150, 3), bool)
        rows, columns = np.unravel_index(np.arange(count), (40, 80))
        marked[30 + rows, 30 + columns, 1] = True
        table[f"{count} saturated"] = said(lambda shown: len(wall_cells(shown, wall).signal),
                                           dataclasses.replace(photo(), saturated=marked))
    for across in (13, 14, 15, 16):
        small = stated(corners_px=[[19.6, 19.7], [19.6 + across, 19.7], [19.6 + across, 33.7],
                                    [19.6, 33.7]])
        table[f"{across} wide"] = said(lambda wall: len(wall_cells(dataclasses.replace(
            photo(), saturated=marked & False), wall).signal), WallTable.model_validate(small))
    recorded(table)


def test_files_that_say_where_a_wall_is(recorded, tmp_path):
    def read(**changes):
        rows = [f"{key} = {value}" for key, value in stated(**changes).items()]
        (tmp_path / "wall.toml").write_text("\n".join(rows), encoding="utf-8")
        found = said(read_wall, tmp_path / "wall.toml")
        return found if isinstance(found, str) else found.model_dump()

    at = LAMP.at.tolist()
    lengths = {f"{name} of {len(value)}": {name: value} for name, longest in (
        ("size_mm", [1300.0, 900.0, 10.0]), ("lamp_at_mm", [*at, 5.0]),
        ("lamp_size_mm", [80.0, 50.0, 10.0]), ("lamp_look_at_mm", [650.0, 440.0, 0.0]),
        ("corners_px", [*CORNERS, [10.0, 50.0]])) for value in (longest, longest[:-2])}
    lengths |= {f"corner of {count}": {"corners_px": [[24.31, 18.17, 0.0][:count], *CORNERS[1:]]}
                for count in (1, 3)}
    recorded({name: read(**changes) for name, changes in {
        "plain": {}, "all": {"lamp_look_at_mm": [650.0, 440.0], "lamp_error_mm": 4.5},
        "near": {"lamp_at_mm": [*at[:2], 79.0]}, "as near": {"lamp_at_mm": [*at[:2], 80.0]},
        "far enough": {"lamp_at_mm": [*at[:2], 81.0]}, "mirrored": {"corners_px": CORNERS[::-1]},
        "crossed": {"corners_px": [CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]]},
        "three corners": {"corners_px": CORNERS[:3]}, "error": {"lamp_error_mm": -0.1},
        "no error": {"lamp_error_mm": 0}, "large error": {"lamp_error_mm": 1001},
        "small": {"size_mm": [0.09, 900]}, "smallest": {"size_mm": [0.1, 900]},
        "unknown": {"lamps": 3}, **lengths}.items()})


# ---- the beam of a lamp --------------------------------------------------------------------------

def cells(seed=6, count=(48, 34), dark=False):
    """Readings of a beam that is not round, not white and not centred."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid((np.arange(count[0]) + 0.5) / count[0] * SIZE_MM[0],
                       (np.arange(count[1]) + 0.5) / count[1] * SIZE_MM[1])
    places = np.column_stack([x.ravel(), y.ravel()])
    ray = np.column_stack([places, np.zeros(len(places))]) - LAMP.at
    far = np.linalg.norm(ray, axis=1)
    angle, _ = LAMP.angles(places, AIM)
    ahead = np.cos(np.radians(angle)) * LAMP.at[2] / far**3
    tint = [np.exp(-((angle / width) ** 2) / 2) for width in (24, 26, 21)]
    level = np.stack(tint, axis=-1) * (ahead * (1 + places[:, 0] / 9000))[:, None]
    level *= np.array([0.9, 0.7, 0.4]) / level.max()
    signal = level * (1 + 0.01 * rng.standard_normal(level.shape)) - 0.9 * dark
    return WallCells(places, signal, (0.01 * level) ** 2 + 1e-7)


@pytest.mark.parametrize("more", [{}, {"lamp_look_at_mm": [655.0, 433.0], "lamp_error_mm": 7.0}])
def test_the_profile_of_a_beam(recorded, more):
    table = WallTable.model_validate(stated(**more))
    found = beam_fit.fit_beam(cells(), table)
    recorded(found, rtol=1e-4)      # where a search stops
    np.testing.assert_allclose(found.axis_mm, AIM, atol=25)
    # about as the mean of the bands
    assert found.radiance[20] == pytest.approx(np.exp(-((20 / 24) ** 2) / 2), rel=0.05)


def test_a_wall_without_a_beam_is_refused(recorded):
    table = WallTable.model_validate(stated())
    aside = WallTable.model_validate(stated(lamp_at_mm=[3000.0, 480.0, 770.0]))
    recorded({"dark": said(beam_fit.fit_beam, cells(dark=True), table),
              "aside": said(beam_fit.fit_beam, cells(), aside)}, rtol=1e-3)


def test_parts_of_a_beam_fit(recorded):
    rng = np.random.default_rng(16)
    places = rng.uniform(0, SIZE_MM, (60, 2))
    table = {"normal": LAMP.normal(AIM),
             "between": LAMP.angle_between(AIM, AIM + np.array([40, -90])),
             "sides": LAMP.sides(AIM), "angles": LAMP.angles(places, AIM)}
    upwards = beam_fit._Lamp(np.array([600.0, 20.0, 30.0]), LAMP.size)
    table["upright"] = [upwards.sides(np.array([600.0, y])) for y in (200.0, 230.0, 260.0)]
    knots = np.r_[0, 0, 0, np.linspace(0, 50, 9), 50, 50, 50]
    table["splines"] = beam_fit._splines(np.linspace(-3, 55, 7), knots)
    for quadrature in (1, 3):
        table[f"irradiance {quadrature}"] = LAMP.irradiance(places, AIM, knots, quadrature)
    reading = np.exp(-((LAMP.angles(places, AIM)[0] / 25) ** 2)) * rng.uniform(0.95, 1.05, 60)
    deviation = rng.uniform(0.01, 0.03, 60)
    fit = beam_fit._Fit.of(places, reading, deviation, LAMP, AIM, 50.0, 8.0)
    group = rng.integers(0, 7, 60)
    angles = np.array([0.0, 4, 13, 31, 50])
    table |= {"fit": fit, "predicted": fit.predicted, "residuals": fit.residuals, "bic": fit.bic,
              "profile": fit.profile(angles), "without": fit.without(group == 2).coefficients,
              "jackknife": beam_fit._jackknife(fit, group, angles),
              "default": beam_fit._Fit.of(places, reading, deviation, LAMP, AIM, 50.0, 8.0,
                                          1).coefficients,
              "dark": dataclasses.replace(fit, coefficients=-fit.coefficients).profile(angles)}
    recorded(table)
    left = [fit.without(group == one).profile(angles) for one in range(7)]
    np.testing.assert_allclose(table["jackknife"], 6 * np.var(left, axis=0), rtol=1e-9)


def test_how_far_a_beam_is_seen_all_around(recorded):
    table = {}
    for sectors in (3, 4, 12):
        angle = np.repeat(np.arange(0.5, 40.0), 12)
        sector = np.tile(np.arange(12), 40)
        kept = (angle < 21) | (sector < sectors)
        for width in (2.0, 3.7):
            table[f"{sectors} {width}"] = beam_fit._seen_all_around(angle[kept], sector[kept],
                                                                    width)
    for top in (5.9, 6.1):
        table[f"to {top}"] = said(beam_fit._seen_all_around, np.repeat([1.0, 3, top], 12),
                                  np.tile(np.arange(12), 3), 2.2)
    recorded(table)


# ---- the light beyond a chart --------------------------------------------------------------------

def chart_white(seed=17):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((11, 11)) * np.r_[np.full(3, 0.01), np.full(5, 0.02),
                                                 np.full(3, 0.002)][:, None]
    return ChartWhite(np.array([0.7, 0.9, 0.5]), 0.03 * rng.standard_normal(5),
                      np.array([0.004, -0.002, 0.006]), root @ root.T / 3)


def places_of(count, seed, away=0.0):
    rng = np.random.default_rng(seed)
    return PicturePoints(positions(count, seed) * [1.0, 0.8] + away,
                         rng.uniform(-0.3, 0.4, (count, 2)) + 0.2 * away)


@pytest.mark.parametrize("flat, seed", [(False, None), (True, None), (False, 3), (True, 3)])
def test_the_light_beyond_a_chart(recorded, flat, seed):
    patches, there = places_of(14, 1), [places_of(1, 2, 0.5), places_of(6, 3, 1.3)]
    more = {} if seed is None else {"seed": seed}
    found = light_elsewhere(chart_white(), patches, there, flat, **more)
    recorded({"found": found, "errors": sizes(found.covariance)}, rtol=1e-5)
    assert found.distances.sum() == pytest.approx(1)


def test_arrangements_of_lamps(recorded):
    patches, there = places_of(9, 4), [places_of(5, 5, 0.7)]
    table = {f"{distance} {flat}": light_field._of_distance(
        distance, patches, there, flat, np.random.default_rng(1))
        for distance in (1.5, 12.0) for flat in (False, True)}
    table["even"] = light_field._nearly_even(patches, there, np.random.default_rng(2))
    table["likelihood"] = light_field._likelihood(chart_white())
    flatter = chart_white().covariance.copy()
    flatter[3:8, 3:8] += 0.1 * np.eye(5)        # more than the field's own prior: nothing is said
    table["nothing said"] = light_field._likelihood(dataclasses.replace(chart_white(),
                                                                        covariance=flatter))
    recorded(table, rtol=1e-5)


# ---- profiles of a camera ------------------------------------------------------------------------

def test_numbers_of_illuminants(recorded):
    recorded({"EXIF": camera_profile.ILLUMINANTS, "D50": camera_profile.D50})


@pytest.mark.parametrize("light", camera_profile.ILLUMINANTS)
def test_matrices_of_a_profile(recorded, light):
    for name, grid in (("uneven", UNEVEN), ("10 nm", visible_grid(10))):
        aim = camera_profile.target(light, grid, surfaces(15, grid), (
            surfaces(9, grid, 8), surfaces(7, grid, 11)))
        made = camera_profile.matrices(camera(grid), aim)
        recorded({"target": aim, "made": made, "mixed": camera_profile.matrices(
            np.array([[0.9, 0.2, 0], [0.1, 1.0, 0.1], [0, 0.3, 0.7]]) @ camera(grid), aim)},
            case=name)
        # white goes to D50
        np.testing.assert_allclose(made.forward @ np.ones(3), camera_profile.D50, rtol=1e-9)
