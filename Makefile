# Two commands for a fresh machine: `make plan` and `make test`. Each sets everything up.
PYTHON ?= python3
VENV := .venv
# set by CI: nothing is installed whose hash is not in constraints-hashes.txt
HASHES ?=
BIN := $(VENV)/bin

.PHONY: docs results gallery screens dist test-wheel plan test test-long test-all test-random test-lowest test-newest test-clients lint floors bench sweep paper-preset decay paper ipc auto-jaxplan audit hashes licences hardening load clean

plan: $(VENV)/.installed
	$(BIN)/mdpo-plan hvac10

# with LONG_PART=1/20 also the second twentieth of what `make test-long` runs
test: $(VENV)/.installed lint
	$(BIN)/pytest -n 2 --dist worksteal --durations=30 \
	  -m "not slow and not wheel$(if $(LONG_PART),, and not long)"

# what takes seconds and is seen in part by `make test`
test-long: $(VENV)/.installed
	$(BIN)/pytest -n 2 --dist worksteal -m "long and not slow" --durations=10

test-all: $(VENV)/.installed lint
	$(BIN)/pytest -n 2 --dist worksteal -m "not wheel" --durations=30

# one process, so that a test that needs what another one did is seen
test-random: $(VENV)/.installed
	$(BIN)/pytest -p randomly -m "not slow and not wheel"

# a smoke set on the oldest versions that pyproject.toml allows
SMOKE := tests/noise tests/policy tests/planner/programs tests/planner/exact/test_exact.py \
  tests/cli/test_plan_run.py
test-lowest: .venv-lowest/.installed
	.venv-lowest/bin/pytest -m "not slow" --durations=30 $(SMOKE)

# all of `make test` on the newest versions that pyproject.toml allows, as pip takes them today
test-newest:
	$(PYTHON) -m venv .venv-newest
	.venv-newest/bin/python -m pip install --quiet --disable-pip-version-check --upgrade \
	  --upgrade-strategy eager --editable '.[dev,tuning,slurm]'
	.venv-newest/bin/pytest -n 2 --dist worksteal -m "not slow and not wheel and not long"

# the wheel in an empty environment of each Python that is declared and found on this machine; with
# NEWEST=1 of the newest of them
PYTHONS ?= 3.11 3.12 3.13
NEWEST ?=
test-wheel: $(VENV)/.installed-dist
	WHEEL_PYTHONS="$$(tools/pythons.sh $(if $(NEWEST),--newest) $(PYTHONS))" $(BIN)/pytest -m wheel tests/packaging

# the docs as a site to be read from its files: site/index.html
docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# the page of results from results/, the pictures of the gallery, and what the commands show
results:
	python3 tools/write_results.py

gallery: $(VENV)/.installed
	$(BIN)/python tools/draw_gallery.py

screens: $(VENV)/.installed-docs
	$(BIN)/python tools/capture_screens.py

# source distribution and wheel, in dist/
dist: $(VENV)/.installed-dist
	rm -rf dist
	$(BIN)/python -m build
	$(BIN)/python -m twine check --strict dist/*

# clients that others wrote, for JaxPlan and for gymnasium, whose pins differ from ours
test-clients: .venv-clients/.installed
	.venv-clients/bin/pytest tests/examples/test_scikit_decide.py tests/examples/test_ppo.py

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# 24 problems, 15 s each on one core, two side by side: fails if a return fell below its floor
floors: $(VENV)/.installed
	$(BIN)/python benchmarks/floors.py

# speed against JaxPlan's own loop, in turn
bench: $(VENV)/.installed
	rm -rf runs/speed
	$(BIN)/python -m benchmarks speed --out runs/speed

# the measurements behind the preset's noise and the README's table
sweep: $(VENV)/.installed
	$(BIN)/python -m benchmarks noise-sweep --alphas 0.25 0.5 1 2 4 8 --sigma-maxes 10
	$(BIN)/python -m benchmarks noise-sweep --settings hvac10 hvac20 --alphas 4 8 --sigma-maxes 9 11
	$(BIN)/python -m benchmarks noise-sweep --settings powergen7 powergen11 --alphas 2 4 --sigma-maxes 9 11
	$(BIN)/python -m benchmarks noise-sweep --settings reservoir15 reservoir30 --alphas 0.25 0.5 --sigma-maxes 9 11
	$(BIN)/python -m benchmarks noise-sweep --settings reservoir15 --alphas 0.125 --sigma-maxes 10

paper-preset: $(VENV)/.installed
	$(BIN)/python -m benchmarks paper-preset

# the same with other decays of RMSProp
decay: $(VENV)/.installed
	$(BIN)/python -m benchmarks noise-sweep --decay 0.9 --out results/decay_0.9/noise_sweep
	$(BIN)/python -m benchmarks noise-sweep --decay 0.9 --out results/decay_0.9/noise_sweep \
	  --settings hvac10 hvac20 --alphas 8 --sigma-maxes 10 11 12 15 20
	$(BIN)/python -m benchmarks noise-sweep --decay 0.9 --out results/decay_0.9/noise_sweep \
	  --settings hvac20 --alphas 16 32 --sigma-maxes 11
	$(BIN)/python -m benchmarks noise-sweep --decay 0.9 --out results/decay_0.9/noise_sweep \
	  --settings reservoir15 reservoir30 --alphas 0.125 0.2 0.25 --sigma-maxes 11
	for decay in 0.8 0.95; do $(BIN)/python -m benchmarks noise-sweep --decay $$decay --settings hvac10 hvac20 \
	  --alphas 8 --sigma-maxes 11 --out results/decay_$$decay/noise_sweep; done
	$(BIN)/python -m benchmarks paper-preset --decay 0.9 --noises none --out results/decay_0.9/paper_preset

# the 2023 competition's forty instances, a minute on one core to prepare for each
ipc: $(VENV)/.installed
	taskset --cpu-list 0 $(BIN)/mdpo-ipc run --plan-seconds 60 --memory-gb 12 --lenient --out runs/ipc2023

# the default preset against JaxPlan's defaults on the competition's instances of the paper's domains
auto-jaxplan: $(VENV)/.installed
	taskset --cpu-list 0 $(BIN)/python -m benchmarks auto --seconds 120 --seeds 1 \
	  --planners auto jaxplan-slp jaxplan-drp --out runs/auto_jaxplan \
	  --problems $(foreach d,HVAC PowerGen Reservoir,$(foreach i,1 2 3 4 5,$(d)_ippc2023:$(i)))

# the paper's table and figures, and the evidence for what docs/paper.md says
paper: $(VENV)/.installed-paper
	$(BIN)/python -m benchmarks paper
	$(BIN)/python -m benchmarks theorem
	$(BIN)/python -m benchmarks paper-sensitivity

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "mdpo-rddl needs Python 3.11 or later; try: make PYTHON=python3.12"; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "Python lacks venv; on Debian and Ubuntu: apt install python3-venv"; exit 2; }
	$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	$(if $(HASHES),$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
	  --require-hashes --requirement constraints-hashes.txt)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
	  $(if $(HASHES),--no-deps) --editable '.[dev,tuning,slurm]'
	$(if $(HASHES),$(BIN)/python -m pip check --disable-pip-version-check)
	touch $@

.venv-lowest/.installed: pyproject.toml tools/lowest.py
	$(PYTHON) -m venv --clear .venv-lowest
	$(PYTHON) tools/lowest.py > .venv-lowest/lowest.txt
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check \
	  --requirement .venv-lowest/lowest.txt
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

# what builds distributions and the docs
$(VENV)/.installed-dist $(VENV)/.installed-docs: $(VENV)/.installed-%: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[dev,tuning,slurm,$*]'
	touch $@

# scikit-decide's extras bring torch and more, of which its JaxPlan solver needs nothing
.venv-clients/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv --clear .venv-clients
	grep -v '^gymnasium==\|^numpy==' constraints.txt > .venv-clients/constraints.txt
	.venv-clients/bin/python -m pip install --quiet --disable-pip-version-check \
	  --constraint .venv-clients/constraints.txt --editable '.[dev]' \
	  scikit-decide==1.1.1 'gymnasium<1.2' 'numpy<2.4' gurobipy==13.0.3 \
	  stable-baselines3==2.9.2 torch==2.13.0
	.venv-clients/bin/python -m pip install --quiet --disable-pip-version-check --no-deps \
	  pyRDDLGym-rl==0.2 pyRDDLGym-gurobi==0.2
	touch $@

# PPO's packages
$(VENV)/.installed-paper: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[dev,tuning,slurm,paper]'
	# the same files as tensorflow-probability's, which JaxPlan brings; PPO needs the newer ones
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --force-reinstall --no-deps tfp-nightly
	touch $@

# known vulnerabilities of the pinned versions; asks the service that pip-audit knows, and fails
# where that does not answer
audit: .venv-audit/.installed
	.venv-audit/bin/pip-audit --strict --no-deps --disable-pip --requirement constraints.txt

.venv-audit/.installed: Makefile
	$(PYTHON) -m venv --clear .venv-audit
	.venv-audit/bin/python -m pip install --quiet --disable-pip-version-check 'pip-audit==2.10.1'
	touch $@

# the pinned versions with the hashes of all their files
hashes: .venv-hashes/.installed
	.venv-hashes/bin/uv pip compile --quiet --no-annotate --no-header --generate-hashes \
	  --python-version 3.11.7 --constraint constraints.txt \
	  $(foreach extra,dev tuning slurm docs dist,--extra $(extra)) \
	  --output-file constraints-hashes.txt pyproject.toml

.venv-hashes/.installed: Makefile
	$(PYTHON) -m venv --clear .venv-hashes
	.venv-hashes/bin/python -m pip install --quiet --disable-pip-version-check 'uv==0.13.9'
	touch $@

# what the packages say of their licences
licences: $(VENV)/.installed
	$(BIN)/python tools/licences.py

# changed inputs by the hundred thousand, and a hundred kills; half an hour
hardening: $(VENV)/.installed
	$(BIN)/python tools/fuzz.py --inputs 100000
	$(BIN)/python tools/kill_runs.py --kills 100

# eight planners side by side on two cores with one cache; half an hour
load: $(VENV)/.installed
	$(BIN)/python tools/load_test.py --out results/load

clean:
	rm -rf $(VENV) .venv-lowest .venv-newest .venv-clients .venv-audit .venv-hashes build dist site *.egg-info .pytest_cache .ruff_cache .mypy_cache
