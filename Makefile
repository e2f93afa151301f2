# Two commands for a fresh machine: `make plan` and `make test`. Each sets everything up.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: plan test lint sweep paper-preset clean

plan: $(VENV)/.installed
	$(BIN)/mdpo-plan domains/hvac.rddl instances/hvac10.rddl

test: $(VENV)/.installed lint
	$(BIN)/pytest -n 2 --dist loadfile

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# the measurements behind the preset's noise and the README's table
sweep: $(VENV)/.installed
	$(BIN)/mdpo-bench noise-sweep --alphas 0.25 0.5 1 2 4 8 --sigma-maxes 10
	$(BIN)/mdpo-bench noise-sweep --settings hvac10 hvac20 --alphas 4 8 --sigma-maxes 9 11
	$(BIN)/mdpo-bench noise-sweep --settings powergen7 powergen11 --alphas 2 4 --sigma-maxes 9 11
	$(BIN)/mdpo-bench noise-sweep --settings reservoir15 reservoir30 --alphas 0.25 0.5 --sigma-maxes 9 11
	$(BIN)/mdpo-bench noise-sweep --settings reservoir15 --alphas 0.125 --sigma-maxes 10

paper-preset: $(VENV)/.installed
	$(BIN)/mdpo-bench paper-preset

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "mdpo-rddl needs Python 3.11 or later; try: make PYTHON=python3.12"; exit 2; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) build *.egg-info .pytest_cache .ruff_cache .mypy_cache
