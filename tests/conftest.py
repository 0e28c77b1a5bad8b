"""A small synthetic session, written once and run once; every test gets its own copy."""
import collections
import os
import shutil
import signal
import sys

import hypothesis
import pytest

# How long an example takes to draw says what else the machine does.
hypothesis.settings.register_profile("untimed", hypothesis.settings.default, deadline=None,
                                     suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("untimed")

# A worker has a core of its own: threads of small algebra would wait for those of other workers.
# Set before NumPy is imported; commands that tests start inherit it.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# Run in the background, a shell has the tests ignore Ctrl-C and Ctrl-\, and all that they start
# would too; under nohup they ignore that the terminal is gone.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
for ignored in (signal.SIGHUP, signal.SIGQUIT):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        signal.signal(ignored, signal.SIG_DFL)


# Files that take longest, longest first: one that begins last runs on with nothing beside it.
LONGEST = ("test_docs.py", "test_whole_sessions.py", "test_notebooks.py", "test_flat_photos.py",
           "test_page_tasks.py", "test_batch.py", "test_page_browser.py", "test_scene_estimate.py",
           "test_strangers_folder.py", "test_moved_lamp.py", "test_page_axe.py",
           "test_public_names.py", "test_batch_cluster.py", "test_flat_picture.py",
           "test_trade_charts.py", "test_sampling_prior.py", "test_extras.py",
           "test_scene_picture.py", "test_rehearsal.py", "test_flat_session.py",
           "test_chart_generation.py", "test_session_transport_sampling.py",
           "test_doors_of_photos.py", "test_page_live.py", "test_start_up.py")


def pytest_collection_modifyitems(items):
    """The order in which workers take files, where they keep it (``--no-loadscope-reorder``)."""
    rank = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.name, len(LONGEST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """One more than there are cores: while a test waits for an instrument or a browser, another
    calculates.
    """
    return None if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ else (os.cpu_count() or 1) + 1


def pytest_unconfigure(config):
    """The last line of a run: what was not tried, and why."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    skipped = [] if reporter is None else reporter.stats.get("skipped", [])
    reasons = collections.Counter(str(each.longrepr[2]).removeprefix("Skipped: ")
                                  for each in skipped)
    if reasons:
        reporter.write_line(f"not tried, {len(skipped)} tests: " + "; ".join(
            f"{reason} ({count})" for reason, count in reasons.most_common()))


def pytest_addoption(parser):
    parser.addoption("--record", action="store_true",
                     help="write the tables in tests/whole_sessions/ again")


@pytest.fixture(autouse=True)
def _figures_closed():
    """Figures that a test leaves open are closed: Matplotlib warns of the 21st in a process."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture(scope="session")
def browser():
    """The distribution's Chromium, driven by Playwright, or a skip with the reason.

    Playwright works once at a time in a process.
    """
    playwright = pytest.importorskip("playwright.sync_api",
                                     reason="Playwright drives the page: pip install playwright")
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser",
                                                 "google-chrome"))), None)
    if found is None:
        pytest.skip("no Chromium on this machine to open the page in: apt install chromium")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=found,
                                          args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def mitsuba():
    """Mitsuba, started on the processor."""
    from spectrabox.reconstruct.rendering.renderer import start_mitsuba
    return start_mitsuba("cpu")


def small_demo(folder, *, card):
    """The demo's session, as small as tests can have it, with a grey card in its box or without."""
    from spectrabox.fixtures.demos.demo_session import write_demo_session
    write_demo_session(folder, 1, size=(208, 312), spp=4, card=card)
    text = (folder / "session.toml").read_text(encoding="utf-8")
    text = text.replace("width = 96", "width = 40\nsteps = 80").replace("draws = 4000",
                                                                        "draws = 1000")
    (folder / "session.toml").write_text(text, encoding="utf-8")
    if not card:
        (folder / "spectra" / "card.csv").write_text(       # which the template of a box asks for
            "nm,reflectance\n400,0.45\n700,0.47\n", encoding="utf-8")
    return folder


def _run(folder):
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.pipeline import run_stages
    run_stages(read_session(folder), device="cpu", only=None, force=False, progress=lambda *_: None)
    return folder


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """A function that gives this worker's copy of a session: the first worker that asks makes it,
    ``make(folder)``, and the others wait for it.
    """
    from spectrabox.session.store.locks import held_lock
    own = tmp_path_factory.getbasetemp()
    every = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "made-once"

    def copy_of(name, make):
        folder, whole = every / name, every / f"{name}.whole"
        with held_lock(every / f"{name}.lock"):
            if not whole.exists():
                shutil.rmtree(folder, ignore_errors=True)
                make(folder)
                whole.touch()
        return shutil.copytree(folder, tmp_path_factory.mktemp("copy") / name)
    every.mkdir(exist_ok=True)
    return copy_of


@pytest.fixture(scope="session")
def _captured(made_once):
    return made_once("captured", lambda folder: small_demo(folder / "box", card=False)) / "box"


@pytest.fixture(scope="session")
def finished_demo(made_once):
    """The demo's session as its command writes it, with the results of every stage; not to be
    changed.
    """
    return made_once("demo", lambda folder: _run(small_demo(folder / "box", card=True))) / "box"


@pytest.fixture(scope="session")
def _finished(_captured, made_once):
    return made_once("finished", lambda folder: _run(
        shutil.copytree(_captured, folder / "box"))) / "box"


@pytest.fixture(scope="session")
def _finished_flat(made_once):
    from flat_example import write_flat

    from tests.session_runs import call

    def make(folder):
        assert call("run", write_flat(folder / "s")).exit_code == 0
    return made_once("flat", make) / "s"


@pytest.fixture(scope="session")
def _finished_painting(made_once):
    from tests.session_runs import call

    def make(folder):
        folder.mkdir()
        assert call("demo", folder / "painting", "--flat").exit_code == 0
    return made_once("painting", make) / "painting"


@pytest.fixture
def light_as_stated(monkeypatch):
    """Calibrations that look for no other lamp which would explain the chart better: two thirds of
    their time, for tests of something else.
    """
    from spectrabox.calibrate import chart_calibration
    monkeypatch.setattr(chart_calibration, "evidence_on_lights", lambda *_: ())


@pytest.fixture
def no_advice(monkeypatch):
    """Results without advice on what to do next: a third of the time of a session with its report,
    for tests of something else.
    """
    from spectrabox.measure.advice import advice, advise
    monkeypatch.setattr(advise, "advice_on_capture", lambda *_: advice.Advised())


@pytest.fixture(scope="session")
def _calibrated_flat(_finished_flat, tmp_path_factory):
    """Where a run has got to when the camera is calibrated: its later results are taken away."""
    folder = shutil.copytree(_finished_flat, tmp_path_factory.mktemp("calibrated") / "s")
    for path in (*folder.iterdir(), *(folder / "results").iterdir()):
        if path.name not in ("photos", "spectra", "session.toml", "results", "chart", "photo",
                             "calibrate"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return folder


@pytest.fixture
def calibrated_flat(_calibrated_flat, tmp_path):
    """A session of flat samples whose chart has been found and camera calibrated."""
    return shutil.copytree(_calibrated_flat, tmp_path / "s")


@pytest.fixture
def finished_flat(_finished_flat, tmp_path):
    """A session of flat samples with the results of every stage and its report."""
    return shutil.copytree(_finished_flat, tmp_path / "flat" / "s")


@pytest.fixture(scope="module")
def finished_painting(_finished_painting, tmp_path_factory):
    """The flat demo as its command leaves it, one copy for a file of tests."""
    return shutil.copytree(_finished_painting, tmp_path_factory.mktemp("demo") / "painting")


@pytest.fixture
def captured(_captured, tmp_path):
    """A session with photos, spectra and scenes that nobody has run."""
    return shutil.copytree(_captured, tmp_path / "captured" / "box")


@pytest.fixture
def finished(_finished, tmp_path):
    """The same with the results of every stage."""
    return shutil.copytree(_finished, tmp_path / "finished" / "box")
