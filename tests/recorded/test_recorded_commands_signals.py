"""Commands on signals and spectra without a session: answers, files and refusals.

Draws go along eigenvectors, whose signs hang on the last bits of a matrix: on another machine they
are other draws of the same distribution. What is made of draws is therefore compared within their
chance, everything else exactly.
"""
import numpy as np
import pytest
from said_by_commands import content_of, said
from sampling_cameras import surface

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.sampling.prior.mixture import GRID

CAMERA = ("--sensitivity", "Nikon 5100 (NPL)", "--light", "LED-B3")
SIGNAL = ("--signal", "0.21,0.33,0.14")
IN_ITS_UNIT = ("--signal", "21,59.4,9.8", "--white", "100,180,70", "--noise", "0.2,0.5,0.15")
MORE = """
[[reading]]
nm = 655
reflectance = 0.31
error = 0.004
[[photo]]
light = "A"
signal = [0.24, 0.31, 0.12]
noise = [0.002, 0.003, 0.0025]
[[same]]
signal = [0.215, 0.33, 0.141]
"""
CASES = {
    "defaults": SIGNAL,
    "noise, white and level": (*IN_ITS_UNIT, "--level", "0.8", "--samples", "1500", "--seed", "3",
                               "--light-error", "0.013", "--sensitivity-error", "0.021"),
    "a family": (*SIGNAL, "--family", "textile", "--family", "earth", "--samples", "1000"),
    "readings and photos": (*SIGNAL, "--reading", "452:0.13:0.006", "--reading",
                            "610/12:0.36:0.01", "--photo", "D65=0.2,0.32,0.15:0.003,0.004,0.002",
                            "--same", "0.212,0.332,0.142:0.002,0.003,0.004", "--seed", "2",
                            "--samples", "1200", "--noise", "0.002,0.003,0.0015"),
    "a file of measurements": (*SIGNAL, "--more", "DIR/more.toml", "--samples", "1000", "--noise",
                               "0.002,0.003,0.0015"),
    "a truth": (*SIGNAL, "--truth", "DIR/truth.csv", "--column", "second", "--delta-light", "A",
                "--delta-light", "FL2", "--samples", "1000"),
    "unlike any spectrum": ("--signal", "0.95,0.05,0.9", "--samples", "1000"),
    "uniform": (*SIGNAL, "--method", "uniform", "--coefficients", "8", "--samples", "1100",
                "--seed", "5", "--noise", "0.004,0.003,0.005"),
    "as published": (*SIGNAL, "--method", "paper", "--coefficients", "7", "--samples", "1000",
                     "--seed", "6", "--refine", "11"),
    "as published, ranked": (*SIGNAL, "--method", "paper", "--coefficients", "7", "--samples",
                             "4000", "--keep", "1000", "--reading", "500:0.2:0.01"),
    "uniform, then finer": (*SIGNAL, "--method", "uniform", "--coefficients", "7", "--samples",
                            "1000", "--refine", "15", "--noise", "0.004,0.003,0.005"),
    "as published, from outside": (*SIGNAL, "--method", "paper", "--coefficients", "7", "--start",
                                   "unbounded", "--samples", "1000"),
    "many signals": ("--signals", "DIR/signals.csv", "--noise", "0.002,0.003,0.0015",
                     "--light-error", "0.02", "--level", "0.9")}


@pytest.fixture
def folder(tmp_path):
    """Two truths, three signals, further measurements."""
    truths = "".join(f"{nm:g},{0.2 + 0.3 * surface(nm, 1):.6f},{surface(nm, 3):.6f}\n"
                     for nm in GRID.nm)
    (tmp_path / "truth.csv").write_text(f"# quantity: reflectance\nnm,first,second\n{truths}",
                                        encoding="utf-8")
    (tmp_path / "signals.csv").write_text("R,G,B\n0.2,0.3,0.15\n0.52,0.5,0.41\n", encoding="utf-8")
    (tmp_path / "more.toml").write_text(MORE, encoding="utf-8")
    return tmp_path


# mean and band of a thousand draws: a tenth of the spread's share of the mean, and room
CHANCE = 0.06
OF_DRAWS = ("mean", "standard_deviation", "lower", "upper", "judged")


def parted(facts):
    """What is exact, and what is made of draws."""
    return ({name: value for name, value in facts.items() if name not in OF_DRAWS},
            {name: facts[name] for name in OF_DRAWS if name in facts})


@pytest.mark.parametrize("case", CASES)
def test_sample(case, folder, recorded):
    found = said(folder, "sample", *CAMERA, *CASES[case], "--json")
    assert found["exit code"] == (5 if case == "as published, from outside" else 0), found
    if case == "many signals":
        recorded(found, rtol=1e-5)          # no draws; sums of exponentials
        return
    exact, of_draws = parted(found["answer"])
    if case not in ("defaults", "uniform"):
        exact.pop("next_measurement_nm", None)      # where two wavelengths are nearly alike
    recorded([exact, found["told"]], rtol=1e-2 if case == "a file of measurements" else 1e-4)
    recorded(of_draws, rtol=CHANCE, case="of draws")


@pytest.mark.parametrize("case", ["defaults", "noise, white and level", "many signals"])
def test_sample_in_words_and_its_draws(case, folder, recorded):
    words = said(folder, "sample", *CAMERA, *CASES[case], "--out", "DIR/draws.npz")
    if case == "many signals":
        recorded(said(folder, "sample", *CAMERA, *CASES[case])["answer"][:-1], rtol=1e-5)
    recorded([line for line in words["answer"] if not line[0].isdigit() and "draws" not in line],
             case="words")
    draws = content_of(folder / "draws.npz")
    recorded({name: [values.shape, values.mean(axis=-2)] for name, values in draws.items()
              if values.ndim > 1}, rtol=CHANCE, case="draws")
    recorded(draws["wavelengths_nm"], case="nm")


PLAN = {
    "defaults": ("--signal", "0.2,0.3,0.15"),
    "all options": ("--signal", "20,54,10.5", "--white", "100,180,70", "--noise", "0.3,0.4,0.2",
                    "--second-light", "A", "--second-camera", "cie_2_1931", "--steps", "2",
                    "--reading-minutes", "1.5", "--photo-minutes", "0.7", "--spot-minutes", "40",
                    "--seed", "4", "--lamps", "A,FL11", "--reading", "500:0.2:0.01")}


@pytest.mark.parametrize("case", PLAN)
@pytest.mark.parametrize("form", [("--json",), ()], ids=["json", "text"])
def test_plan(case, form, folder, recorded):
    recorded(said(folder, "plan", *CAMERA, *PLAN[case], *form),
             rtol=0.02 if case == "defaults" else 1e-5)     # of draws, where nothing is measured


def test_uplift(folder, recorded):
    """Every pixel of a small picture, in each form, with options off their defaults."""
    response = relative_response("Nikon 5100 (NPL)", "LED-B3", GRID)
    shade = np.linspace(0.4, 1.2, 5)[:, None, None]
    signals = np.array([response @ surface(GRID.nm, seed) for seed in range(7)])
    write_exr(folder / "p.exr", (signals * shade * [100, 180, 70]).astype(np.float32),
              ["R", "G", "B"])
    options = ("--white", "100,180,70", "--noise", "0.02", "--side", "5")
    found = said(folder, "uplift", "DIR/p.exr", "-o", "DIR/a", *CAMERA, *options, "--json")
    # tables are single floats, and a file holds halves
    recorded(found, case="answer", rtol=1e-3)
    recorded([content_of(path, [folder]) for path in sorted((folder / "a").glob("*.exr"))],
             case="files", rtol=1e-3)
    found = said(folder, "uplift", "DIR/p.exr", "-o", "DIR/b", *CAMERA, *options, "--to", "envi",
                 "--step", "20", "--full", "--family", "paint", "-q")
    recorded(found, case="ENVI", rtol=1e-3)
    for path in sorted((folder / "b").glob("*.hdr")):
        recorded(content_of(path, [folder]), case=path.name)
        values = np.fromfile(path.with_suffix(".img"), "<f4")
        recorded(values, case=f"{path.stem} values", rtol=1e-4)


@pytest.fixture
def libraries(tmp_path):
    """Two folders of smooth reflectances."""
    for name, first, count in (("mine", 1, 13), ("others", 60, 11)):
        (tmp_path / name).mkdir()
        nm = np.arange(400, 701, 5)
        rows = [",".join(f"{value:.5f}" for value in surface(nm, first + at))
                for at in range(count)]
        (tmp_path / name / "curves.csv").write_text("\n".join([",".join(map(str, nm)), *rows]),
                                                    encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("options", [(), (*CAMERA, "--noise", "0.013", "--family", "paint",
                                          "--delta-light", "A", "--out", "DIR/page.md")],
                         ids=["defaults", "all options"])
def test_certify(options, libraries, recorded):
    recorded(said(libraries, "certify", "DIR/mine", *options, "--json"), rtol=1e-5, case="answer")
    if options:
        recorded(content_of(libraries / "page.md", [libraries]), rtol=1e-5, case="page")
    else:
        recorded(said(libraries, "certify", "DIR/mine", "DIR/others")["answer"], rtol=1e-5,
                 case="text")


def write_cube(folder):
    """A picture (6, 5, 31) of five surfaces, one a column, each row a little brighter."""
    nm = np.arange(400, 701, 10.0)
    columns = np.array([surface(nm, seed) for seed in range(5)])
    np.save(folder / "cube.npy", columns[None] * (1 + 0.02 * np.arange(6))[:, None, None])
    rows = "".join(f"{each:g},{columns[1][at]:.6f},{columns[3][at] * 0.98:.6f}\n"
                   for at, each in enumerate(nm))
    (folder / "truth.csv").write_text(f"# quantity: reflectance\nnm,a,b\n{rows}",
                                      encoding="utf-8")
    (folder / "regions.toml").write_text(
        '[regions.a]\nrectangle = [1, 0, 2, 4]\n[regions.b]\npoint = [3, 2]\n', encoding="utf-8")


JUDGE = {"points alone": ("--point", "2,3", "--point", "mine=4,1"),
         "regions and truths": ("--regions", "DIR/regions.toml", "--truth", "DIR/truth.csv",
                                "--samples", "1000", "--seed", "2", "--delta-light", "FL2",
                                "--out", "DIR/out.csv", "--full-scale", "1.1", *CAMERA,
                                "--noise", "0.004,0.005,0.003", "--coefficients", "9")}


@pytest.mark.parametrize("case", JUDGE)
def test_judge(case, tmp_path, recorded):
    write_cube(tmp_path)
    words = ("judge", "DIR/cube.npy", "--wavelengths", "400:700:10", *JUDGE[case])
    recorded(said(tmp_path, *words, "--json"), rtol=1e-5, case="answer")
    recorded(said(tmp_path, *words), rtol=1e-5, case="text")
    if "--out" in words:
        recorded(content_of(tmp_path / "out.csv", [tmp_path]), case="table")
        recorded(content_of(tmp_path / "out.csv-metadata.json", [tmp_path]), case="about it")


REFUSED = [
    ("sample", *CAMERA), ("sample", *CAMERA, *SIGNAL, "--signals", "x.csv"),
    ("sample", *CAMERA, "--signal", "1,2"), ("sample", *CAMERA, *SIGNAL, "--white", "1,1"),
    ("sample", *CAMERA, *SIGNAL, "--out", "DIR/x.csv"),
    *(("sample", *CAMERA, *SIGNAL, "--level", level) for level in ("0", "0.01", "0.99", "1")),
    *(("sample", *CAMERA, *SIGNAL, "--samples", count) for count in ("0", "999", "5000001")),
    *(("sample", *CAMERA, *SIGNAL, "--light-error", each) for each in ("-0.01", "0.51")),
    *(("sample", *CAMERA, *SIGNAL, "--sensitivity-error", each) for each in ("-0.01", "0.51")),
    ("sample", *CAMERA, *SIGNAL, "--keep", "5"), ("sample", *CAMERA, *SIGNAL, "--refine", "20"),
    ("sample", *CAMERA, "--signals", "DIR/signals.csv", "--same", "0.2,0.3,0.1"),
    ("sample", *CAMERA, *SIGNAL, "--photo", "D65"), ("sample", *CAMERA, *SIGNAL, "--twice", "1,2"),
    ("sample", *CAMERA, *SIGNAL, "--truth", "DIR/truth.csv", "--column", "third"),
    ("plan",), ("plan", "DIR", *CAMERA), ("plan", *CAMERA),
    ("plan", *CAMERA, *SIGNAL, "--reading-minutes", "0"),
    ("plan", *CAMERA, *SIGNAL, "--photo-minutes", "-1"), ("plan", *CAMERA, *SIGNAL, "--lamps", ","),
    ("uplift", "DIR/none.exr", "-o", "DIR/x", *CAMERA),
    ("uplift", "DIR/none.exr", "-o", "DIR/x.exr", *CAMERA),
    ("uplift", "DIR/none.exr", "-o", "DIR/x", *CAMERA, "--workers", "0"),
    ("certify", "DIR", "--noise", "0.5"), ("certify", "DIR", "--noise", "-0.01"),
    ("certify", "DIR/none"), ("certify", "DIR", "--out", "DIR/x.txt"),
    ("judge", "DIR/none.npy", "--point", "1,1"), ("judge", "DIR/truth.csv", "--out", "x.txt"),
    ("prior", "train", "DIR", "--out", "x.csv"), ("prior", "train", "jam=DIR", "--out", "x.npz")]


def test_what_is_refused_and_how(folder, recorded):
    found = {}
    for number, words in enumerate(REFUSED):
        answer = said(folder, *words)
        found[f"{number} {' '.join(map(str, words))}"] = [answer["exit code"], answer["told"]]
        assert answer["exit code"] != 0 or "--level" in words or "--samples" in words, words
    recorded(found)
