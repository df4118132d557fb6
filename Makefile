# Everything from a fresh clone: `make demo` to see it, `make test` to check it.
# Needs Python 3.11 or newer, pip and a compiler; everything else is installed into .venv by pip.

PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p" && break; done)
VENV := .venv
BIN := $(VENV)/bin
BUILD := build
PIP := -m pip install --disable-pip-version-check --quiet

# Where bytecode is not kept, every process that a test starts would compile the package again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test lint format bench bench-map soak longest fuzz wheel-check lowest hooks clean

help:
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

# --- environments; the stamps say with what they were made -------------------------------------

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer was not found; set PYTHON=/path/to/python"; exit 1; }
	"$(PYTHON)" -m venv $(VENV)

# The doctor compiles the kernels, so that the first run does not have to.
$(VENV)/installed: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python $(PIP) --constraint constraints.txt --editable .
	$(BIN)/pseudolidar doctor
	@touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(BIN)/python $(PIP) --constraint constraints.txt --editable ".[dev]"
	@touch $@

# --- what to do ----------------------------------------------------------------------------------

demo: $(VENV)/installed ## install, convert the synthetic drive to out/demo, show it in a browser
	$(BIN)/pseudolidar demo
	@if [ -t 1 ]; then $(BIN)/pseudolidar view out/demo/street.mcap; fi

# The viewer is tested in a real browser; where none can be had these tests say so and are skipped.
$(VENV)/browser: | $(VENV)/installed-dev
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null \
		|| { apt-get update -qq && apt-get install -y -qq chromium; } >/dev/null 2>&1 \
		|| echo "no Chromium: tests of the viewer in a browser are skipped"
	@touch $@

lint: $(VENV)/installed-dev ## style, types, imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	MYPY_NUM_WORKERS=2 $(BIN)/mypy
	$(BIN)/lint-imports

# Files of tests are dealt out to so many processes, in the order that tests/conftest.py gives them:
# what takes long first. One more than the cores of a small machine: tests wait for children, disks
# and timeouts, too.
PROCESSES ?= 3
test: lint $(VENV)/browser ## lint, then all tests
	$(BIN)/python -m pytest --numprocesses $(PROCESSES) --dist loadfile --no-loadscope-reorder

format: $(VENV)/installed-dev ## format the code and mend what can be mended
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/installed-dev ## print benchmark ratios
	$(BIN)/python -m tests.benchmarks.matchers
	$(BIN)/python -m tests.benchmarks.conversion
	$(BIN)/python -m tests.benchmarks.tracks 5

# What the map wants of the real data, and of rendered worlds. All of them run; one that is not as
# wanted names its row and ends with 1. `block` renders for 11 minutes, and goes round six times.
MAP_DATA ?= $(or $(PSEUDOLIDAR_DATA),../shared/data)
bench-map: $(VENV)/installed-dev ## judge the benchmarks of the map (an hour)
	@missed=; for one in "odometry" "integrity $(MAP_DATA)" "loops $(MAP_DATA)" crisp meshes block; do \
		echo "--- $$one"; $(BIN)/python -m tests.benchmarks.$$one || missed="$$missed $${one%% *}"; done; \
	test -z "$$missed" || { echo "not as wanted:$$missed"; exit 1; }

soak: $(VENV)/browser ## long tests
	$(BIN)/python -m pytest -m "slow and not longest"

longest: $(VENV)/browser ## the viewer with five clients for half an hour
	$(BIN)/python -m pytest -m longest

# A number of inputs for each reader: make fuzz INPUTS=100000
INPUTS ?= 10000
fuzz: $(VENV)/installed-dev ## read damaged files of every format, in processes with bounded memory
	for format in pcd ply npz bin labels poses trajectory rig-yaml rig-xml rig-json rig-body camera-info kalibr \
		euroc kitti-calib kitti-raw kitti-mounted kitti-bare projections k-txt middlebury camera \
		trials journal settings; do \
		$(BIN)/python -m tests.fuzzing $$format $(INPUTS) || exit 1; done
	$(BIN)/python -m tests.fuzzing mcap 2000

# A wheel from the sdist, installed with everything fresh, used outside the checkout.
wheel-check: $(VENV)/installed-dev ## build the wheel, install it afresh elsewhere, convert there
	rm -rf $(BUILD)/wheel-check && mkdir -p $(BUILD)/wheel-check/elsewhere
	$(BIN)/python -m build --outdir $(BUILD)/wheel-check .
	"$(PYTHON)" -m venv $(BUILD)/wheel-check/venv
	$(BUILD)/wheel-check/venv/bin/python $(PIP) --constraint constraints.txt $(BUILD)/wheel-check/*.whl
	cd $(BUILD)/wheel-check/elsewhere && ../venv/bin/pseudolidar doctor \
		&& ../venv/bin/pseudolidar convert synthetic:street out --frames 0:3 --to pcd,mcap \
		&& ls out/*.mcap out/pcd/*.pcd

# Everything at its lower bound, in a venv of its own; the kernels' cache too is its own.
lowest: | $(BIN)/python ## run the tests with the lower bounds of all dependencies
	mkdir -p $(BUILD)
	$(BIN)/python .ci/lowest.py > $(BUILD)/lowest.txt
	test -d $(BUILD)/lowest || "$(PYTHON)" -m venv $(BUILD)/lowest
	$(BUILD)/lowest/bin/python $(PIP) --constraint $(BUILD)/lowest.txt --editable ".[test]"
	NUMBA_CACHE_DIR=$(CURDIR)/$(BUILD)/lowest/kernels $(BUILD)/lowest/bin/python -m pytest

hooks: $(VENV)/installed-dev ## check every commit
	$(BIN)/pre-commit install

clean: ## remove what was built, keep .venv and out
	rm -rf $(BUILD) dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
