# Needs Python 3.11 or newer and make; everything else goes into .venv.
SHELL    := bash
SCENARIO ?= scenarios/pso_mhpf.yaml
ARGS     ?=
PYTHON   ?=

# Tests of the suite that `make test` and `make coverage` run; TIER= runs all.
TIER     ?= not thorough

# Folders of tests that are targets of their own.
APART    := documentation campaign_cluster browser
SUITE    = -n 2 --dist worksteal -m "$(TIER)" $(APART:%=--ignore=tests/%)

# Numerical tests that `make processors` repeats in each of its settings.
NUMERICAL := kernels models trackers bounds offline base/test_metrics.py base/test_cell_grid.py \
             $(addprefix analysis/test_,statistics.py consistency.py summary.py comparison.py) \
             $(addprefix network/test_,batteries.py clocks.py consumption.py ledger.py local_schedules.py tsch_energy.py)
NO_NUMBERS := kernels/test_cache_folder.py kernels/test_compilation.py kernels/test_kernel_cache.py \
              models/test_compilation.py models/test_csvfile.py models/test_k7file.py

# What `make matrix` tries; `make lowest` takes the first that is installed.
PYTHONS  ?= 3.11 3.12 3.13 3.14

VENV     := .venv
PY       := $(VENV)/bin/python
READY    := $(VENV)/.ready
# The packages with which the documentation is built, notebooks are run and a release is checked, at their first use.
DOCS     := $(VENV)/.docs
# A clone that was moved or copied together with its .venv: the installation there points to the old place.
MOVED    := $(shell test -e $(READY) && ! grep -qxF "$(CURDIR)" $(READY) && echo moved)

# Each shipped sweep becomes a campaign in results/NAME, with a table once it is complete, and a figure.
SWEEP      ?= scenarios/sweeps/particles.yaml
TRACKERS   ?= pso_mhpf,ipf,ppf
REPLICATES ?=
PAPERS     ?=
PAGES      := jiang2013 liu2012 wei2022 ruan2020 li2012 frontier
SWEEPS     := $(patsubst scenarios/sweeps/%.yaml,%,$(wildcard scenarios/sweeps/*.yaml))
TABLES     := $(SWEEPS:%=results/%/table.csv)
FIGURES    := $(SWEEPS:%=results/figures/%.png)
CHOSEN      = $(if $(REPLICATES),--replicates $(REPLICATES)) $(ARGS)

# Without cached bytecode each of the hundreds of processes that the tests start would compile every module anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help run test thorough verify docs documentation cluster browser fuzz wheel matrix lowest processors peers check interpreted coverage format lint types imports bench sweep compare reproduce figures readme lock clean moved asked
.DELETE_ON_ERROR:

help:  ## list the targets
	@echo "make TARGET [SCENARIO=scenarios/pso_mhpf.yaml] [REPLICATES=30] [ARGS='further arguments'] [PYTHON=python3.12]"
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/\1|\2/p' $(firstword $(MAKEFILE_LIST)) | while IFS='|' read -r name what; do \
	    printf '  %-13s%s\n' "$$name" "$$what"; done

run: $(READY)  ## run a scenario: summary, result file and HTML page; SCENARIO=..., ARGS='--replicates 30'
	@$(PY) -m wsnsim run "$(SCENARIO)" --report $(ARGS)

test: $(READY)  ## run the fast tests; ARGS='-k handover'
	@$(PY) -m pytest $(SUITE) $(ARGS)

thorough: $(READY)  ## run expensive tests, more seeds and combinations, and random examples
	@WSNSIM_THOROUGH=1 $(PY) -m pytest -n 2 --dist worksteal -m "thorough or hypothesis" $(APART:%=--ignore=tests/%) $(ARGS)

verify: $(READY)  ## run every shipped scenario and compare it with tests/golden; ARGS=--record
	@$(PY) -m tests.golden $(ARGS)

docs: $(DOCS)  ## build the documentation, one folder for any web server: build/docs; every example executed, warnings are errors
	@NUMBA_CACHE_DIR="$$($(PY) -m tests.helpers.kernel_cache)" \
	    $(PY) -m sphinx -j 2 -W --keep-going -q -b html -d build/doctrees docs build/docs $(ARGS)
	@echo "build/docs/index.html"

documentation: $(DOCS)  ## test that the documents say what is so and that their examples run
	@$(PY) -m pytest -n 2 --dist worksteal tests/documentation $(ARGS)

cluster: $(READY)  ## test campaigns on Dask schedulers and workers that are processes
	@$(PY) -m pytest -n 2 --dist worksteal tests/campaign_cluster $(ARGS)

browser: $(DOCS)  ## test the documentation and the pages of results in a browser; skipped without one unless WSNSIM_BROWSER=required
	@$(PY) -m pytest -n 2 --dist loadfile tests/browser $(ARGS)

fuzz: $(READY)  ## try random files, plug-ins, commands and scenarios for an hour; ARGS='--hours 0.1 --seed 7'
	@$(PY) -m tests.fuzz.long $(ARGS)

wheel: $(DOCS)  ## check sdist and wheel, install the wheel with every Python of PYTHONS and run a scenario there
	@$(PY) -m tests.distribution.wheel $(PYTHONS) $(ARGS)

matrix: $(READY)  ## run the suite with every installed Python of PYTHONS='3.11 3.12 3.13 3.14' and the newest packages
	@$(PY) -m tests.distribution.versions newest $(PYTHONS) -- $(SUITE) $(ARGS)

lowest: $(READY)  ## run the suite with the lowest versions of the packages that pyproject.toml allows
	@$(PY) -m tests.distribution.versions lowest $(PYTHONS) -- $(SUITE) $(ARGS)

processors: $(READY)  ## run numerical tests with fewer instruction sets in NumPy, kernels for a generic processor, and both
	@$(PY) -m tests.distribution.processors -n 2 --dist worksteal -m "not thorough" $(NUMERICAL:%=tests/%) \
	    $(NO_NUMBERS:%=--ignore=tests/%) $(ARGS)

peers: $(READY)  ## compare filters with those of Stone Soup and FilterPy, in an environment of its own
	@$(PY) -m tests.distribution.versions peers $(PYTHONS) -- tests/trackers/test_peers.py tests/trackers/test_multi_target_peers.py tests/interop/test_stonesoup.py $(ARGS)

check: format lint types imports test thorough verify docs documentation cluster browser interpreted  ## check format, lint, types, import contracts, all tests

interpreted: $(READY)  ## run the kernels' tests without compilation, for debugging and coverage
	@NUMBA_DISABLE_JIT=1 $(PY) -m pytest -n 2 -W ignore::RuntimeWarning tests/kernels $(ARGS)

coverage: $(READY)  ## measure the lines and branches that the fast tests cover; TIER= for all tests
	@rm -f .coverage .coverage.*
	@$(PY) -m coverage run -m pytest $(SUITE) $(ARGS)
	@NUMBA_DISABLE_JIT=1 $(PY) -m coverage run -m pytest -n 2 -W ignore::RuntimeWarning tests/kernels \
	    --ignore=tests/kernels/test_cache_folder.py $(ARGS)  # a process that can write nothing, nor its coverage
	@$(PY) -m coverage combine --quiet
	@$(PY) -m coverage report --precision=2 --skip-covered --sort=miss | tail -n 60

format: $(READY)  ## check that the code is formatted
	@$(PY) -m ruff format --check .

lint: $(READY)  ## run the linter
	@$(PY) -m ruff check .

types: $(READY)  ## run the type checker
	@$(PY) -m mypy

imports: $(READY)  ## check the import contracts between layers
	@$(PY) -c 'from importlinter.cli import lint_imports_command as lint; lint()'

bench: $(READY)  ## run the benchmarks; also writes results/bench.json
	@$(PY) -m tests.bench --json results/bench.json $(ARGS)

sweep: $(READY)  ## run or resume a sweep; SWEEP=scenarios/sweeps/particles.yaml REPLICATES=100
	@$(PY) -m wsnsim sweep "$(SWEEP)" $(CHOSEN)

compare: $(READY)  ## compare trackers in one scenario; SCENARIO=... TRACKERS=pso_mhpf,ipf,ppf REPLICATES=100
	@$(PY) -m wsnsim compare "$(SCENARIO)" --trackers "$(TRACKERS)" $(CHOSEN)

reproduce: $(READY)  ## reproduce the papers' tables and figures; PAPERS='li2012 frontier'
	@$(PY) -m wsnsim reproduce $(PAPERS) $(ARGS)

figures: $(FIGURES) $(READY)  ## draw results/figures/*.png of every shipped sweep and paper; runs what is incomplete
	@mkdir -p results/figures
	@$(PY) -m wsnsim reproduce $(or $(PAPERS),$(PAGES)) --figures results/figures > results/figures/papers.txt
	@echo "figures, and their table papers.txt, are in results/figures"

# A sweep never repeats runs that are on disk: a stopped campaign is resumed. Changed scenarios or REPLICATES only start
# the check for missing runs.
$(TABLES): results/%/table.csv: scenarios/sweeps/%.yaml $(wildcard scenarios/*.yaml scenarios/bases/*.yaml) \
        $(if $(REPLICATES)$(ARGS),asked) | $(READY)
	@mkdir -p $(@D)
	@$(PY) -m wsnsim sweep $< $(CHOSEN) --csv $@.part
	@mv $@.part $@

$(FIGURES): results/figures/%.png: results/%/table.csv
	@mkdir -p $(@D)
	@$(PY) -m wsnsim plot results/$* --out $@

readme: $(READY)  ## regenerate the tables of results in README.md; two hours if the runs are missing; ARGS=commercial_radio
	@$(PY) -m tests.readme $(ARGS)

lock:  ## regenerate requirements.lock and requirements-docs.lock from pyproject.toml (needs uv)
	@command -v uv >/dev/null || { echo "make lock needs uv: pip install uv, or https://docs.astral.sh/uv/" >&2; exit 1; }
	uv pip compile --quiet --universal --generate-hashes --python-version 3.11 --extra dev --no-header --no-annotate \
	    -o requirements.lock pyproject.toml
	uv pip compile --quiet --universal --generate-hashes --python-version 3.11 --extra dev --extra docs --extra release \
	    --no-header --no-annotate -c requirements.lock -o requirements-docs.lock pyproject.toml

clean:  ## remove .venv, .venv-matrix and all caches; results stay
	rm -rf $(VENV) .venv-matrix build dist .mypy_cache .ruff_cache .import_linter_cache .hypothesis .pytest_cache
	find wsnsim tests -name __pycache__ -prune -exec rm -rf {} +

# Written last, so that an interrupted installation is repeated.
$(READY): pyproject.toml requirements.lock $(MOVED)
	@set -euo pipefail; \
	for python in $(PYTHON) python3.11 python3 python3.12 python3.13; do \
	    if "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then break; fi; python=; \
	done; \
	if [ -z "$$python" ]; then \
	    echo "wsnsim needs Python 3.11 or newer: none of $(PYTHON) python3.11 python3 is one (make PYTHON=/path/to/python)" >&2; \
	    exit 1; \
	fi; \
	if ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then \
	    echo "$$python cannot make a virtual environment; on Debian or Ubuntu: apt-get install python3-venv" >&2; \
	    exit 1; \
	fi; \
	$(PY) -c 'import pip' 2>/dev/null || { echo "making $(VENV) with $$("$$python" --version)"; \
	    "$$python" -m venv --clear $(VENV); }; \
	printf 'installing the packages of requirements.lock '; \
	$(PY) -m pip install --disable-pip-version-check --progress-bar off --require-hashes -r requirements.lock \
	    | while read -r word rest; do \
	        case "$$word" in Collecting) printf .;; Installing) printf ' unpacking';; esac; done; \
	echo; \
	$(PY) -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation -e .; \
	echo "$(CURDIR)" > $@

$(DOCS): $(READY) requirements-docs.lock
	@echo "installing the packages of requirements-docs.lock"
	@$(PY) -m pip install --disable-pip-version-check --quiet --require-hashes -r requirements-docs.lock
	@touch $@
