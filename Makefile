# make race   run the shipped policy over 100 m and through the protocol; needs Python and nothing else
# make test   every check and test, on the CPU
# make lint   style and types only
# make docs   the documentation site in build/site
# make package-test   wheel and sdist, installed into an empty environment and used
# make venv   the environment of `make test`, without running it
# Settings: PYTHON (interpreter that makes the environment), RACE_ARGS (passed on), WORKERS (pytest processes).

PYTHON ?= python3
# The shipped policy's top command [m/s]; without it the race searches for one first.
RACE_ARGS ?= sprint --top-speed 13
# One more than two cores: some tests wait for other processes.
WORKERS ?= 3

VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
REQUIREMENTS := pyproject.toml constraints.txt

# Tests start hundreds of Python processes: compiled modules are kept, whatever the environment says.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: race test tests lint style types docs package-test venv clean
.DEFAULT_GOAL := test

race: $(VENV)/.race-installed
	@$(BIN)/sprintlab race $(RACE_ARGS)

# The type checker keeps one core busy for a minute: beside the tests, not before them. All that fails is told.
test: style
	@$(MAKE) --no-print-directory --keep-going -j2 types tests

tests: $(VENV)/.dev-installed
	@$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

lint: style types

style: $(VENV)/.dev-installed
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/lint-imports

types: $(VENV)/.dev-installed
	@$(BIN)/pyright --pythonpath $(BIN)/python

docs: $(VENV)/.docs-installed
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "documentation: build/site/index.html"

package-test: $(VENV)/.dev-installed
	@$(BIN)/python tools/package_test.py

venv: $(VENV)/.dev-installed

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13) and "sprintlab needs Python 3.10 to 3.13; set PYTHON")'
	@$(PYTHON) -m venv $(VENV)

# A stamp is written only after its install succeeded, so an interrupted one is taken up again.
$(VENV)/.race-installed: $(REQUIREMENTS) | $(BIN)/python
	@echo "installing the base packages into $(VENV)"
	@$(INSTALL) -e '.[video]'
	@touch $@

$(VENV)/.docs-installed: $(REQUIREMENTS) | $(BIN)/python
	@echo "installing the base and documentation packages into $(VENV)"
	@$(INSTALL) -e '.[docs]'
	@touch $@

# pip compiles on one core, which takes a minute. Some packages bring templates that no Python can compile.
$(VENV)/.dev-installed: $(REQUIREMENTS) | $(BIN)/python
	@echo "installing the base, training and test packages into $(VENV)"
	@$(INSTALL) --no-compile -e '.[dev,video]'
	@$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true
	@touch $@ $(VENV)/.race-installed $(VENV)/.docs-installed

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
