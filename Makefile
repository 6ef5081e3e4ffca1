# Two commands are enough: `make demo` and `make test`. Each sets up what it needs in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# OpenCV and BLAS would start a thread a core for arrays of a few kilobytes; one is faster, and leaves the other core to the cell.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
# Every worker of the tests and every daemon they start would compile all of it anew: half of what a start takes.
export PYTHONDONTWRITEBYTECODE :=
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# What mypy found out is the user's, not the checkout's: a fresh clone would read numpy's types anew for two minutes.
export MYPY_CACHE_DIR := $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/facetd/mypy

.PHONY: all help setup demo deb docs test test-short test-long check rig arm64 debian13 bench bench-faults bench-soak clean

all: setup help

help:
	@echo "make demo         the simulated cell: teach, train, pick every part, fill a kit, write the report"
	@echo "make test         unit, property and simulated-cell tests, after lint, types and import rules"
	@echo "make test-long    10,000 random steps against the motion monitor, whole first days, a hall of cells, more cases: minutes"
	@echo "make docs         the references in docs/, made from the code"
	@echo "make deb          Debian packages for this release of Debian, amd64 and arm64, in build/"
	@echo "make rig          the daemon under real systemd with real V4L2 devices and a serial line, in a guest"
	@echo "make arm64        the package for arm64, emulated: names and poses as on this machine, then the demo"
	@echo "make debian13     the demo and the tests in a root of Debian 13, with Python 3.13"
	@echo "make bench        accuracy, time and memory, measured (FACETD_SCENES=FOLDER: on more rendered scenes)"
	@echo "make bench-faults faults at every moment of a pick, kill -9, random travels, operators, first days and years, mutations: tables (a night)"
	@echo "make bench-soak   2,000 accelerated cycles: memory and file handles over time (hours)"

setup: $(VENV)/.runtime
	@echo "== ready. To try it: . $(VENV)/bin/activate, then"
	@echo "   facetd --sim              in one window: a cell in simulation"
	@echo "   facetctl console          in another: help, teach cube, train, enable, pick cube"
	@echo "   README.md leads on; make deb builds the package for a cell's own computer"

# One of the program's extras, such as extra-export. PIP_ARGS: an index, or a folder of wheels (--no-index --find-links DIR).
extra-%: $(VENV)/.runtime
	@$(BIN)/pip install -q $(PIP_ARGS) -e '.[$*]'
	@echo "== the extra $* is there now"

$(VENV)/.runtime: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "facetd needs Python 3.11 or newer; $(PYTHON) is older. Set PYTHON=..."; exit 2; }
	@echo "== setting up $(VENV) (once; a minute or two)"
	@$(PYTHON) -m venv $(VENV) || { echo "cannot make a virtual environment: apt-get install python3-venv"; exit 2; }
	@$(BIN)/pip install -q -e .
	@deploy/systemd-extra.sh $(BIN)/pip
	@touch $@

$(VENV)/.dev: $(VENV)/.runtime
	@echo "== installing the test tools (once; a minute or two)"
	@$(BIN)/pip install -q -e '.[dev,metrics,modbus,dashboard,drawings,export,fleet,plots]'
	@tests/browser.sh
	@tests/linuxcnc.sh
	@touch $@

demo: $(VENV)/.runtime
	$(BIN)/facetctl demo $(DEMO)
	@echo "== to go on by hand: make setup tells how"

check: $(VENV)/.dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# The checks use one core, the tests all of them: together they end sooner. 5 says that a choice of TESTS has none of a kind.
test: $(VENV)/.dev
	@$(MAKE) --no-print-directory -j 2 check test-short

# In a fresh clone the tests are compiled once, before each of pytest's workers would compile all of them.
test-short: $(VENV)/.dev
	@[ -d tests/__pycache__ ] || $(BIN)/pytest --collect-only -qq $(TESTS) >/dev/null || true
	$(BIN)/pytest -n 4 --dist worksteal --durations=20 -m "not long" $(TESTS) || [ $$? = 5 ]

test-long: $(VENV)/.dev
	$(BIN)/pytest -n 4 --dist worksteal --durations=20 -m long $(TESTS) || [ $$? = 5 ]

docs: $(VENV)/.dev
	$(BIN)/python -m tests.manuals

# ARCH=amd64: for one architecture only.
deb:
	LINTIAN=yes debian/build.sh $(ARCH)

rig: $(VENV)/.dev
	$(BIN)/python tests/rig/run.py $(JOBS)

arm64: $(VENV)/.dev
	$(BIN)/python tests/arm64/run.py $(JOBS)

debian13:
	tests/debian13.sh $(TESTS)

bench: $(VENV)/.dev
	$(BIN)/python -m tests.bench

bench-faults: $(VENV)/.dev
	$(BIN)/python -m tests.bench.long.faults
	$(BIN)/python -m tests.bench.long.kill
	$(BIN)/python -m tests.bench.long.travels 100000
	$(BIN)/python -m tests.bench.long.one_camera
	$(BIN)/python -m tests.bench.long.around
	$(BIN)/python -m tests.bench.long.surprises 1000000
	$(BIN)/python -m tests.bench.long.hostile 1000000
	$(BIN)/python -m tests.bench.long.years
	$(BIN)/python -m tests.bench.long.firstdays 10
	$(BIN)/python -m tests.bench.long.mutations
	$(BIN)/python -m tests.bench.long.mutations --rooms store events frontends review

bench-soak: $(VENV)/.dev
	$(BIN)/python -m tests.bench.long.soak

clean:
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
