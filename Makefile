# `make demo` and `make test` need only Python >= 3.11, make and git: the rest is set up on the way.
SHELL := /bin/bash
VENV := .venv
PYTHON_IN := $(VENV)/bin/python
RUN := $(VENV)/.run
DEV := $(VENV)/.dev
BENCH := $(VENV)/.bench
SETUP := pyproject.toml constraints.txt scripts/bootstrap.sh scripts/system_packages.sh scripts/system_libraries.py

DEMO_PROJECT ?= examples/neck/project.yaml
DEMO_OUT ?= runs/demo-$(shell date +%Y%m%d-%H%M%S)
# Options for pytest, such as PYTEST_ARGS="-k cable -x"; and on how many processes it runs, 0 for none of its own.
PYTEST_ARGS ?=
TEST_WORKERS ?= $(shell getconf _NPROCESSORS_ONLN)
PYTEST = $(PYTHON_IN) -m pytest -n $(TEST_WORKERS) --dist worksteal
SLOW_LIMIT ?= 40m

# The tests start hundreds of programs: the bytecode of the first serves the others.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test test-slow test-long bench coverage docs links format clean constraints wheels
.PHONY: lint lint-ruff lint-format lint-types lint-layers lint-licences lint-vulnerabilities

help:
	@echo "make demo       set up, calibrate the neck on real bench data, print the result, write the report"
	@echo "make test       set up, run the tests (all but the slow and the long ones)"
	@echo "make test-slow  run the slow tests, for $(SLOW_LIMIT) at most"
	@echo "make test-long  run the tests that do at length what others do in part: an hour"
	@echo "make bench      run the benchmarks, write benchmarks/RESULTS.md"
	@echo "make mesh-table compute docs/mesh-table.md anew: ten minutes and 4 GB"
	@echo "make table-one  compute docs/table-one.md anew: six minutes"
	@echo "make coverage   measure the coverage of 95 % intervals, write docs/uncertainty.md: ten minutes"
	@echo "make docs       build the site into docs/_build"
	@echo "make links      look up every address on the site"
	@echo "make lint       ruff, pyright, layers, licences, known vulnerabilities"
	@echo "make wheels     build sdist and wheel into dist, try them in environments of their own: an hour"
	@echo "make constraints  install the newest versions that pyproject.toml allows, write constraints.txt"
	@echo "make format     let ruff format and mend what it can"
	@echo "make clean      remove the environment and the caches (runs are kept)"

$(RUN): $(SETUP)
	@scripts/bootstrap.sh run
	@touch $@

$(DEV): $(SETUP)
	@scripts/bootstrap.sh dev
	@touch $(RUN) $@

$(BENCH): $(SETUP)
	@scripts/bootstrap.sh bench
	@touch $(RUN) $(DEV) $@

demo: OUT := $(DEMO_OUT)
demo: $(RUN)
	$(VENV)/bin/softcal calibrate $(DEMO_PROJECT) --set neck.poissons_ratio=0.45 --out $(OUT)/nu-0.45 --no-report
	$(VENV)/bin/softcal report $(OUT)/nu-0.45
	$(VENV)/bin/softcal calibrate $(DEMO_PROJECT) --out $(OUT)/nu-free --no-report
	$(VENV)/bin/softcal report $(OUT)/nu-free

test: $(DEV)
	$(PYTEST) $(PYTEST_ARGS)

# pytest's exit code 5: no test is marked slow, which is no failure.
test-slow: $(DEV)
	timeout --signal=INT --kill-after=60 $(SLOW_LIMIT) $(PYTEST) -m "slow and not long" $(PYTEST_ARGS) || [ $$? -eq 5 ]

test-long: $(DEV)
	$(PYTEST) -m long $(PYTEST_ARGS)

bench: $(BENCH)
	$(PYTHON_IN) -m benchmarks.run

coverage: $(RUN)
	$(PYTHON_IN) -m benchmarks.coverage

# Warnings are errors: a link to nothing, a page in no table of contents, a docstring that cannot be read.
docs: $(DEV)
	$(PYTHON_IN) -m sphinx -W --keep-going -q -j auto docs docs/_build

# The scripts of the gallery are not run for it. Needs the network.
links: $(DEV)
	$(PYTHON_IN) -m sphinx -b linkcheck -D plot_gallery=0 -q -j auto docs docs/_build/links

mesh-table: $(RUN)
	$(PYTHON_IN) -m benchmarks.mesh_table

table-one: $(RUN)
	$(PYTHON_IN) -m benchmarks.table_one

# Parts of their own, so that `make --keep-going lint` tells all at once.
lint: lint-ruff lint-format lint-types lint-layers lint-licences lint-vulnerabilities

lint-ruff: $(DEV)
	$(VENV)/bin/ruff check

lint-format: $(DEV)
	$(VENV)/bin/ruff format --check

lint-types: $(DEV)
	$(VENV)/bin/pyright

lint-layers: $(DEV)
	$(VENV)/bin/lint-imports

lint-licences: $(DEV)
	$(PYTHON_IN) scripts/check_licences.py

# Skips itself, and says so, where the database does not answer.
lint-vulnerabilities: $(DEV)
	$(PYTHON_IN) -m scripts.check_vulnerabilities

# What to do with the file is to run all tests, and to commit it.
constraints:
	@scripts/bootstrap.sh newest
	$(PYTHON_IN) -m scripts.write_constraints
	@touch $(RUN) $(DEV)

wheels: $(DEV)
	$(PYTHON_IN) -m hatchling build -d dist
	$(PYTHON_IN) -m scripts.sizes --clean

format: $(DEV)
	$(VENV)/bin/ruff format
	$(VENV)/bin/ruff check --fix

clean:
	rm -rf $(VENV) build dist docs/_build docs/reference docs/gallery .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find src tests scripts benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
