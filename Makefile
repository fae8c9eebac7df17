# Everything runs in .venv, which these targets make themselves: nothing else needs to be installed
# but Python 3.11 or later, make, and a way to a package index.

PYTHON ?= python3
HYPOTHESIS_PROFILE ?= ci
MUTANTS ?= 1000000
SIZE ?= small
BENCH ?=
BIN := .venv/bin
READY := .venv/.ready

export HYPOTHESIS_PROFILE

.PHONY: demo test exact fuzz chaos bounds lint spec bench clean
.DEFAULT_GOAL := demo

demo: $(READY)
	mkdir -p demo
	$(BIN)/gstream build examples/skull.ply -o demo/skull.gsb --resolution 512 --up z --force \
		--report demo/report.json
	$(BIN)/gstream check demo/skull.gsb
	$(BIN)/gstream info demo/skull.gsb
	$(BIN)/gstream preview demo/skull.gsb -o demo/skull.png --force

test: $(READY)
	$(BIN)/python -m pytest -n 2 --dist worksteal

# The exact tests with their long part, of nightly size: tests/exact/README.md says what it holds.
exact: $(READY)
	$(BIN)/python -m pytest tests/exact -m "long or not long"

# Hostile files: the bombs, and a million damaged ones or as many as MUTANTS says.
fuzz: $(READY)
	MUTANTS=$(MUTANTS) $(BIN)/python -m pytest tests/fuzz -s -m "long or not long"

# Faults: a thousand random kills, every error at every operation; tests/faults/README.md.
chaos: $(READY)
	$(BIN)/python -m pytest tests/faults -s -m "long or not long"

# Index checks in every kernel; slow, as all kernels are compiled anew (tests/conftest.py says why).
bounds: $(READY)
	NUMBA_BOUNDSCHECK=1 $(BIN)/python -m pytest tests/unit

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict gstream cli tools
	$(BIN)/lint-imports

# What is written from the source: the table of rules, and what programs must answer of the vectors.
spec: $(READY)
	$(BIN)/python -m tests.conformance.rules_page
	$(BIN)/python -m tests.conformance.expected_answers

# The size ladder, in minutes; SIZE=large takes an hour. tests/bench/README.md says what BENCH may hold.
bench: $(READY)
	$(BIN)/python -m tests.bench --size $(SIZE) $(BENCH)

clean:
	rm -rf .venv build demo *.egg-info .pytest_cache .hypothesis .mypy_cache .ruff_cache
	rm -rf .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): requirements.lock pyproject.toml tests/ksy/package-lock.json
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or later is needed: make PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
		--no-build-isolation -e .
	cd tests && ../$(BIN)/python -m ksy.compiler install || \
		echo "No way to npm: the parsers of spec/*.ksy are not compiled anew, only compared by hash"
	touch $@
