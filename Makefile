# make demo   writes a synthetic capture session with known truth and runs it, as an operator would
# make test   runs the tests, and ends by saying what was not tried. As root, where there is no browser, it first installs
#             Debian's chromium on the whole system; BROWSER=0 leaves that out
# make bench  prints one table of times, whole commands first (BEFORE=FOLDER: beside another checkout); quarter of an hour
# make ledger measures whole captures and compares each row with the recorded one (DATA=FOLDER or SPECTRABOX_DATA: real ones too)
# make figures  prints every measured figure (DATA=FOLDER for those that need measured data); takes the better part of an hour
# make paper  prints the table of every figure of docs/results/paper.md and what data are missing; pictures go to build/paper
# make wheel-check  builds sdist and wheel, installs the wheel elsewhere and makes a report with it (PLATFORMS=1: resolves for others)
# All set up what they need in .venv first, demo what the program needs, the others what tests need too; a second call does no
# work twice. "make setup" does that alone; then ". .venv/bin/activate" puts spectrabox on the path of the shell.
PYTHON ?= python3
DEMO   ?= demo-session
VENV   := .venv
PY     := $(VENV)/bin/python
STAMP  := $(VENV)/.ready
TESTS  := $(VENV)/.ready-for-tests
# modules are compiled when they are first used: most never are, and take 120 MB
PIP    := $(PY) -m pip --disable-pip-version-check install --no-compile

export PYTHONDONTWRITEBYTECODE =    # or every command would compile every module anew
# the matrices are small: threads would only wait for each other
export OPENBLAS_NUM_THREADS = 1

.PHONY: setup demo test lint bench ledger figures paper wheel-check clean
.DELETE_ON_ERROR:

setup: $(STAMP)

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "spectrabox needs Python 3.11 or newer; name one with: make PYTHON=python3.12" >&2; exit 7; }
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 \
	  || { rm -rf $(VENV) && $(PYTHON) -m pip install -q --target .virtualenv --require-hashes --only-binary :all: \
	         -r requirements-virtualenv.lock >/dev/null \
	       && PYTHONPATH=.virtualenv $(PYTHON) -m virtualenv -q $(VENV); }; \
	  status=$$?; rm -rf .virtualenv; [ $$status = 0 ] \
	  || { rm -rf $(VENV); echo "cannot make a virtual environment: apt install python3-venv, then run make again" >&2; exit 7; }

$(STAMP): requirements.lock pyproject.toml reconstruct/rendering/llvm.py | $(VENV)/bin/python
	@echo "setting up $(VENV) from locked versions: about 250 MB to download, 0.9 GB on disk"
	@$(PIP) --require-hashes --only-binary :all: -r requirements.lock
	@$(PIP) -q --no-deps --no-build-isolation -e .
	@$(PY) -m spectrabox.reconstruct.rendering.llvm
	@touch $@

$(TESTS): requirements-test.lock $(STAMP)
	@echo "adding what tests, lint and benchmarks need: about 0.4 GB more on disk"
	@$(PIP) --require-hashes --only-binary :all: -r requirements-test.lock -r requirements.lock
	@touch $@

demo: $(STAMP)
	@$(VENV)/bin/spectrabox demo $(DEMO)

# The tests of page and report want a browser. Without one, or without a network to get it from, they are skipped.
test: $(TESTS)
	@[ "$(BROWSER)" = 0 ] || [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null \
	  || command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null \
	  || { echo "installing, with apt-get and for the whole system: chromium and the packages that it needs, about 400 MB,"; \
	       echo "for the tests of page and report; to leave it out: make test BROWSER=0"; \
	       apt="apt-get -qq -o Acquire::Retries=0 -o Acquire::http::Timeout=20 -o DPkg::Lock::Timeout=60"; \
	       { $$apt update; DEBIAN_FRONTEND=noninteractive $$apt install -y --no-install-recommends chromium; } >/dev/null; \
	     } || echo "chromium could not be installed, for the reasons above: the tests that need it will be skipped" >&2
	@$(PY) -m pytest -q -n auto --dist loadfile --no-loadscope-reorder

lint: $(TESTS)
	@$(PY) -m ruff check .
	@$(PY) -m mypy

bench: $(TESTS)
	@$(PY) -m benchmarks.bench_front_door $(if $(BEFORE),--before "$(BEFORE)")

ledger: $(TESTS)
	@$(PY) -m benchmarks.ledger $(if $(DATA),--data "$(DATA)")

figures: $(TESTS)
	@$(PY) -m benchmarks.table_ages
	@for script in benchmarks/bench_*.py; do echo "== $$script"; \
	  if ! grep -q '"--data"' $$script; then $(PY) -m benchmarks.$$(basename $$script .py) || exit 1; \
	  elif [ -n "$(DATA)" ]; then $(PY) -m benchmarks.$$(basename $$script .py) --data "$(DATA)" || exit 1; \
	  else echo "skipped: needs measured data, make figures DATA=FOLDER"; fi; done

paper: $(TESTS)
	@mkdir -p build/paper
	@for script in benchmarks/paper/figure_*.py; do echo "== $$script"; set -- --out build/paper/$$(basename $$script .py).png; \
	  if [ -n "$(DATA)" ] && grep -q '"--data"' $$script; then set -- "$$@" --data "$(DATA)"; fi; \
	  $(PY) $$script "$$@" || exit 1; done

wheel-check: $(STAMP)
	@$(PY) docs/check_wheel.py $(if $(PLATFORMS),--platforms)

clean:
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache
