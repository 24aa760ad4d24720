# make demo   sets up, builds and runs the main job (the paper's three steps) into ./demo
# make test   sets up, builds and runs every test
#
# Needs a Rust toolchain, Python >= 3.10 and make. Programs that only some tests need
# are listed in apt.txt; a missing one is one named line in the summary.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
CARGO  ?= cargo

.PHONY: demo test setup build test-rust test-python wheel bench-diagnose bench-blind clean

demo: build
	$(BIN)/ecm identify examples/neck.toml --out demo
	@echo "Open demo/report.html in a browser."

test: test-rust test-python

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'
	$(BIN)/python -m pip install --quiet --group dev
	$(BIN)/python -m pip install --quiet $$($(BIN)/python tests/requirements.py mesh cad data report learn cluster robot)
	touch $@

# One profile for wheel and tests: the solver's dependencies are compiled once.
build: setup
	$(BIN)/maturin develop --release --quiet

test-rust:
	$(CARGO) fmt --all --check
	$(CARGO) clippy --release --workspace --all-targets --quiet -- -D warnings
	$(CARGO) build --release --quiet -p ecm-doe
	$(CARGO) test --release --workspace --exclude ecm-py --quiet

test-python: build
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest ecm._native
	$(BIN)/pytest

wheel: setup
	$(BIN)/maturin build --release --out dist

# Eight effects and nothing hidden, ten seeds each (long).
bench-diagnose: build
	$(BIN)/python benches/diagnose.py --out out/bench-diagnose

# The blind benchmark: what is missing is run, so it may be stopped (long; SETS=20 runs fewer).
bench-blind: build
	$(BIN)/python benches/blind.py --out out/bench-blind $(if $(SETS),--sets $(SETS)) \
	  $(if $(EVERY),--simple-every $(EVERY))

clean:
	rm -rf target $(VENV) dist demo out
