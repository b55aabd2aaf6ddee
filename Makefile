# imocap: the manual.
#
#   make all ACTION=yoga   from nothing to the motion and its report (installs first, when needed)
#   make all ACTION=all    every action below actions/, several at once
#   make test              the tests but the long ones, minutes
#   make test-all          every test, the numbers of whole runs too (CI)
#   make test-pythons      make test on every Python of PYTHONS (3.12 3.13) that is here; gigabytes on Linux
#   make test-readers      our files in Blender, ufbx, OpenUSD, ezc3d, OpenSim and Rerun: 1.5 GB, in .venv-readers
#   make check             lint, format, types, import order, tests
#   make bench             fast parts beside named alternatives, one core: minutes; table in artifacts/benchmark/speed
#   make measure           every benchmark of docs/measurements.md on this commit, hours; goes on where it ended
#                          (MEASURE="trials penn --jobs 2"; MEASURE=--list says what is done)
#   make dist              wheel and source distribution in build/dist
#   make fuzz              damage files of every format for five minutes (SECONDS=300); record in build/fuzz
#   make chaos             kill, starve and disturb runs of a small action; the same results after
#   make audit             known vulnerabilities of the pinned packages (asks the package index; its tools in .venv-audit)
#   make sbom              what is installed in .venv, as a CycloneDX SBOM in build/sbom.json
#   make gallery           viewers of actions that have been run, small enough for a phone, in build/gallery
#   make docs              the documentation as a site in build/site (its tools in .venv-docs), with the gallery
#   make baseline          accept today's numbers as those that tests/regression holds
#   make clean             remove what was built (.venv, .venv-*, caches); actions/ and artifacts/ stay
#
# Packages are installed with the hashes of locked.txt; make HASHES= trusts an index that has other files instead.
# ACTION is a name below actions/ (or a built-in one: yoga, taichi), or a path to a folder with an action.yaml.

ACTION ?= yoga
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
FIT    := import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))
EXTRA  := import sys, tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"][sys.argv[1]], sep="\n")
PYTHON ?= $(shell for p in python3 python3.11 python3.12 python3.13 python3.14 python; do \
            $$p -c '$(FIT)' >/dev/null 2>&1 && { echo $$p; break; }; done)
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS)
HASHES ?= --require-hashes
# One thread a test worker: two workers with two threads each fight over two cores. Compiled files are
# kept, whatever the environment says: tests start hundreds of processes.
# A file of tests stays on one worker (they share one run of the pipeline), the long ones first
# (tests/conftest.py); reordered by number of tests, they would come last, on one worker alone.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

.DEFAULT_GOAL := help
.PHONY: help setup all test test-all test-pythons test-readers bench check baseline lint format clean docs gallery dist measure fuzz chaos audit sbom

help:
	@sed -n 's/^#   \{0,1\}//p' Makefile

# Packages are compiled after they are installed: pip does it on one core, compileall on all. Some have templates
# named .py, which do not compile.
setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt locked.txt
	@test -n "$(PYTHON)" || { echo "imocap needs Python 3.11 or newer with venv and pip;" \
	  "found: $$(python3 --version 2>&1). Install one, or name it: make $(MAKECMDGOALS) PYTHON=/path/to/python3.11"; exit 1; }
	@test -x $(BIN)/python || { echo "imocap: making $(VENV) with $$($(PYTHON) --version)"; $(PYTHON) -m venv $(VENV); }
	@echo "imocap: installing (once; minutes on a fresh machine)"
	@test -z "$(HASHES)" || $(PIP) --no-compile $(HASHES) --no-deps -r locked.txt
	@$(PIP) --no-compile -c constraints.txt $(if $(HASHES),--no-build-isolation) -e '.[dev]'
	@$(BIN)/python -m compileall -q -j 0 $(VENV) >/dev/null || true
	@$(BIN)/python -m tools.compile_loops || echo "imocap: not all loops are compiled; the first run does it"
	@touch $@

all: $(STAMP)
	@$(BIN)/imocap $(if $(filter all,$(ACTION)),run-all --all,run '$(ACTION)')

test: $(STAMP)
	@$(PYTEST) -m 'not long'

test-all: $(STAMP)
	@$(PYTEST)

PYTHONS ?= 3.12 3.13
INSTALL_SECONDS ?= 900
test-pythons:
	@test -n "$(PYTHON)" || { echo "imocap needs Python 3.11 or newer with venv and pip"; exit 1; }
	@$(PYTHON) tools/other_pythons.py --install-seconds $(INSTALL_SECONDS) $(PYTHONS)

test-readers: $(STAMP)
	@OMP_NUM_THREADS=1 $(BIN)/python tools/readers.py --install-seconds $(INSTALL_SECONDS) $(READERS)

lint: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/python -m tools.check_names
	@$(BIN)/lint-imports
	@$(BIN)/mypy --num-workers auto

check: lint test

# Alternatives in C and C++ (Apache-2.0) come into a folder of their own; without them their rows are missing.
BENCHED := dtaidistance==2.5.1 pyceres==2.6
bench: $(STAMP)
	@for each in $(BENCHED); do test -d build/bench/$${each%%=*} || $(PIP) --no-deps --target build/bench $$each || echo "imocap: $$each cannot be installed here"; done
	@PYTHONPATH=build/bench $(BIN)/imocap benchmark speed

MEASURE ?=
measure: $(STAMP)
	@$(BIN)/python -m benchmarks.measure $(MEASURE)

dist: $(STAMP)
	@rm -rf build/dist
	@$(BIN)/hatchling build -d build/dist >/dev/null
	@echo "imocap: $$(ls build/dist/*)"

SECONDS ?= 300
fuzz: $(STAMP)
	@OMP_NUM_THREADS=1 $(BIN)/python -m tools.fuzz.run --seconds $(SECONDS)

KILLS ?= 100
chaos: $(STAMP)
	@OMP_NUM_THREADS=1 $(BIN)/python -m tools.chaos.run --kills $(KILLS)

audit: .venv-audit/.installed
	@.venv-audit/bin/python tools/audit.py .venv-audit/bin/pip-audit

sbom: .venv-audit/.installed $(STAMP)
	@mkdir -p build
	@.venv-audit/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible -o build/sbom.json $(VENV)
	@echo "imocap: build/sbom.json"

# Real and captured actions come from the benchmarks' runs: imocap benchmark real, imocap benchmark trials.
BENCHMARKED := artifacts/benchmark
GALLERY := yoga taichi $(BENCHMARKED)/real/balance_beam $(BENCHMARKED)/trials-fine_tuned-4v/cmu_soccer_kick_s10
gallery:
	@for each in $(GALLERY); do name=$${each##*/}; \
	  $(BIN)/imocap --root $$(dirname $$each) view $$name --small --out build/gallery/$$name.html >/dev/null 2>&1 || \
	  test -f build/gallery/$$name.html || echo "imocap: $$each has no current result; the gallery shows a picture instead"; done

docs: .venv-docs/.installed gallery
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --strict --quiet
	@echo "imocap: the site is build/site/index.html"

.venv-audit/.installed .venv-docs/.installed: .venv-%/.installed: pyproject.toml
	@test -n "$(PYTHON)" || { echo "imocap needs Python 3.11 or newer with venv and pip"; exit 1; }
	@test -x .venv-$*/bin/python || $(PYTHON) -m venv .venv-$*
	@$(PYTHON) -c '$(EXTRA)' $* | .venv-$*/bin/python -m pip install --quiet --disable-pip-version-check -r /dev/stdin
	@touch $@

baseline: $(STAMP)
	@$(BIN)/python -m tools.rebase_baseline

format: $(STAMP)
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) .venv-detect .venv-blender .venv-readers .venv-docs .venv-audit .venv-3.* build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
