"""Photos of a colour chart by anybody, as a user judges them: verdict, light, patches left out.

For every photo in a folder what ``find_chart`` says of it and what ``fit_camera`` makes of it with
nothing known of camera and light: the kind of light with its probability, the error of each patch's
reflectance by a fit without it, how much of it the 95 % bands hold and should hold, and the patches
of which less than 85 % is held, with the likely reason.

    python -m benchmarks.bench_real_charts --data FOLDER
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import spectrabox as sb


def row(path: Path) -> tuple[str, tuple[float, float, float] | None]:
    """What is printed of one photo, and the means over its patches."""
    try:
        photo = sb.open_photo(path)
        chart = sb.find_chart(photo)
        camera = sb.fit_camera(photo, light="unknown")
    except sb.SpectraboxError as error:
        return f"{path.name:28s} refused: {error}", None
    light, check = camera.calibration.light_posterior, camera.chart_check
    kind = "not known" if light is None else (
        f"{light.kinds[int(np.argmax(light.probabilities))]} {light.probabilities.max():.0%}")
    rmse, inside, expected = check.means
    lines = [f"{path.name:28s} {chart.verdict:8s} {kind:16s} rmse {rmse:.3f}, {inside:.3f} inside, "
             f"{expected:.3f} expected"]
    lines += [f"    {reason}" for reason in chart.reasons]
    lines += [f"    {note}" for note in check.notes]
    lines += [f"    {name} ({check.inside[check.names.index(name)]:.2f}): {reason}"
              for name, reason in check.poor.items()]
    return "\n".join(lines), check.means


def main() -> None:
    """Print all photos, and the means over those that are fitted."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True,
                        help="folder of raw photos of charts, or one that holds raw_charts")
    data = parser.parse_args().data
    folder = data / "raw_charts" if (data / "raw_charts").is_dir() else data
    photos = [path for path in sorted(folder.iterdir())
              if path.is_file() and path.suffix not in (".md", ".txt")] if folder.is_dir() else []
    if not photos:
        parser.error(f"{folder} holds no photos; give a folder of raw photos of colour charts")
    rows = [row(path) for path in photos]
    print("\n".join(text for text, _ in rows))
    means = np.array([each for _, each in rows if each is not None])
    if len(means):
        rmse, inside, expected = means.mean(axis=0)
        print(f"mean of {len(means)}: rmse {rmse:.4f}, {inside:.3f} inside, "
              f"{expected:.3f} expected")


if __name__ == "__main__":
    main()
