"""Whole sessions for records: photos that any machine makes alike, and everything a run leaves."""
import json
import re
from collections import Counter
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from spectrabox.fixtures.box_render import renderer
from spectrabox.fixtures.demo_scenes import box_scene, regular_spectrum
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages
from spectrabox.session.run_outputs import outputs_of_run

BLACK, WHITE = (598, 602, 604, 599), 15871      # DN of the RGGB tile, and of a full pixel
ELECTRONS, READ_NOISE_DN = 60000.0, 2.5
HOT = (slice(5, None, 97), slice(8, None, 89))  # pixels that gather a dark signal of their own
NUMBER = re.compile(r"(?<![\w.#])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
# what changes from run to run, with the machine or with the version
PASSING = {"provenance", "made_from", "sha256", "bytes", "seconds", "report", "spectra", "versions",
           "finished", "command", "machine", "system", "code", "llvm", "plots", "tableSchema",
           "swatches", "pictures"}
CHANCE = {"next_measurement_nm"}        # of draws, between wavelengths that are nearly alike
# small differences of large numbers: linearised where a search stopped, and inverted
DIFFERENCES = re.compile(r"held_out|relative_covariance|chi_square|left.out")


def silent(*_):
    """No progress is shown."""


def shoot(path, signal, exposure_s, rng, *, hot_dn_per_s=0.0, f_number=8.0, iso=100):
    """Write the DNG of a signal (H, W, 3), with hot pixels; of None, of a lens with its cap on.

    Noise is drawn apart from the signal, so that a rounding of the signal moves no other pixel.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = signal.shape[:2]
    counts, noise = np.empty((height, width)), rng.standard_normal((2, height, width))
    for position, band in enumerate((0, 1, 1, 2)):
        tile = (slice(position // 2, None, 2), slice(position % 2, None, 2))
        level = np.maximum(signal[(*tile, band)], 0).astype(float)
        shot = np.sqrt(level / ELECTRONS) * noise[0][tile]
        counts[tile] = BLACK[position] + (WHITE - BLACK[position]) * (level + shot)
    counts[HOT] += hot_dn_per_s * float(exposure_s)
    counts = np.clip(np.rint(counts + READ_NOISE_DN * noise[1]), 0, WHITE).astype(np.uint16)
    write_dng(path, counts, pattern="RGGB", black=BLACK, white=WHITE,
              exposure_s=Fraction(exposure_s), f_number=f_number, iso=iso, make="Spectrabox",
              model="Synthetic 5100", serial="WHOLE-1")


def write_table(path, columns, quantity, source, nm=NM):
    """A spectral file of some columns."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(table_text(nm, columns, quantity=quantity, source=source), encoding="utf-8")


def rendered_box(reflectances, light, sensitivities, size, *, changed=(), extra="", seed=1):
    """Integrals (H, W, K) of radiance x sensitivity of the demo's box, from its scene by hand.

    Parameters
    ----------
    changed : sequence of (old, new)
        In the text of the scene.
    extra : str
        XML to stand in it besides.
    """
    spectra = {name: regular_spectrum("reflectance", NM, values)
               for name, values in reflectances.items()}
    spectra["light"] = regular_spectrum("radiance", NM, light)
    bands = "".join(regular_spectrum(f"band_{band}", NM, curve)
                    for band, curve in enumerate(sensitivities))
    film = (f'<film type="specfilm"><integer name="width" value="{size[1]}"/><integer name="height"'
            f' value="{size[0]}"/><rfilter type="box"/>{bands}</film>'
            '<sampler type="multijitter"><integer name="sample_count" value="16"/></sampler>')
    text = box_scene(size, spectra, film, 10).replace("</scene>", extra + "</scene>")
    for old, new in changed:
        assert old in text, old
        text = text.replace(old, new)
    mi = renderer()
    return np.array(mi.render(mi.load_string(text), spp=16, seed=seed), dtype=float)


def run_whole(folder, **options):
    """Run a session and write its outputs, as the commands do."""
    config = read_session(folder)
    chosen = {"device": "cpu", "only": None, "force": False, "progress": silent} | options
    finished = run_stages(config, **chosen)
    return finished, outputs_of_run(config, finished, ["spectrabox", "run"], "cpu", silent)


def stage_results(stage):
    """All records of a stored stage, and the pictures beside them."""
    with np.load(stage.folder / "arrays.npz", allow_pickle=False) as arrays:
        kept = {name: arrays[name] for name in sorted(arrays.files)}
    pictures = {path.relative_to(stage.folder).as_posix(): pixels(path)
                for path in sorted(stage.folder.rglob("*")) if path.suffix in (".png", ".exr")}
    return {"records": _without_arrays(stage.facts["records"]), "arrays": _once(kept)}, pictures


def _once(arrays):
    """Grids, and the camera that views have in common, under the first of their names, later ones
    naming that.
    """
    first, made = {}, {}
    for name, array in arrays.items():
        shared = ".grid." in name or name.startswith("calibration ")
        shown = first.setdefault((array.shape, array.tobytes()), name) if shared else name
        made[name] = array if shown == name else f"as {shown}"
    return made


def _without_arrays(node):
    """Records without the names of their arrays, which stand beside."""
    if isinstance(node, dict):
        return {name: _without_arrays(value) for name, value in node.items()
                if name not in PASSING | CHANCE
                and not (isinstance(value, dict) and set(value) == {"array"})}
    return [_without_arrays(value) for value in node] if isinstance(node, list) else node


def output_files(folder):
    """Everything that a run wrote beside its results but the page: numbers, and pictures."""
    facts = json.loads((folder / "results" / "report" / "facts.json").read_text(encoding="utf-8"))
    numbers, pictures = {}, {}
    for name in sorted(facts["outputs"]):
        path = folder / name
        if path.suffix in (".png", ".exr"):
            pictures[name] = pixels(path)
        elif path.suffix == ".json":
            numbers[name] = _settled(json.loads(path.read_text(encoding="utf-8")))
        elif path.suffix != ".html":
            numbers[name] = text_and_numbers(path.read_text(encoding="utf-8"))
    return numbers, pictures


def pixels(path):
    """A picture (H, W, C) and the names of its channels."""
    file = oiio.ImageInput.open(str(path))
    made = {"channels": ", ".join(file.spec().channelnames),
            "pixels": np.asarray(file.read_image("float"))}
    file.close()
    return made


def by_path(node, path="", found=None):
    """Numbers and texts of nested lists and dictionaries by the keys that lead there, lists as one;
    without what changes from run to run, with the machine or with the version.
    """
    found = {} if found is None else found
    if isinstance(node, dict):
        found[f"{path}:keys"] = ", ".join(str(name) for name in node if name not in PASSING)
        for name, value in node.items():
            if name not in PASSING:
                by_path(value, f"{path}.{name}", found)
    elif isinstance(node, list | tuple):
        for value in node:
            by_path(value, f"{path}[]", found)
    elif isinstance(node, str) or node is None:
        found.setdefault(f"{path}:words", []).append(str(node))
    else:
        found.setdefault(path, []).append(float(node))
    return found


def compact(node):
    """The same with series of numbers as arrays and each text once."""
    made = {}
    for path, value in by_path(node).items():
        if path.endswith(":words"):
            made[path] = [*dict.fromkeys(value)]
        else:
            made[path] = np.array(value) if isinstance(value, list) else value
    return made


def _settled(node):
    """The same without what hangs on chance."""
    return {path: value for path, value in compact(node).items()
            if path.rpartition(".")[2] not in CHANCE}


def text_and_numbers(text):
    """The numbers of a text in order, and each of its lines without them, counted."""
    kept = [line for line in text.splitlines() if "Date" not in line and "spectrabox 0" not in line]
    lines = Counter(re.sub(r"#(, ?#)+", "#...", NUMBER.sub("#", line)) for line in kept)
    return {"lines": [f"{count} x {line}" for line, count in lines.items()],
            "numbers": np.array([float(number) for line in kept
                                 for number in NUMBER.findall(line)])}


def hold_whole(recorded, finished, outputs, folder, rtol, *, report=False):
    """Hold every stage, file, fact and sentence of a run to its record; with ``report`` also the
    numbers of its report, which are those of the stages once more.
    """
    seen, every = {}, {}
    for name, stage in finished.stored.items():
        every[name], seen[name] = stage_results(stage)
    every["files"], seen["beside"] = output_files(Path(folder))
    if not report:
        del every["files"]["report.json"]
    every["said"] = {"facts": _settled(outputs.facts),
                     "text": without_paths(outputs.text, folder)}
    rough = {}
    for name, results in every.items():
        recorded(_without_differences(results, rough.setdefault(name, {})), rtol, case=name)
    recorded(rough, 2e-2, case="differences")
    # one step of 255 in a few pixels
    recorded(seen, 2e-3, case="pictures")


def _without_differences(node, rough, path=""):
    """Dictionaries without what ``DIFFERENCES`` names, which is put into ``rough``."""
    made = {}
    for name, value in node.items():
        if DIFFERENCES.search(name):
            rough[f"{path} {name}".strip()] = value
        else:
            made[name] = _without_differences(value, rough, f"{path} {name}") \
                if isinstance(value, dict) else value
    return made


def without_paths(text, folder):
    """A text that names no folder of this machine, and in its table no next measurement."""
    return re.sub(r"\d+ nm (?=│)", "", text.replace(str(folder), "FOLDER"))
