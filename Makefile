# make demo   sets up, builds and runs the main job (the paper's three steps) into ./demo
# make test   sets up, builds and runs every test
# make docs   sets up, builds and writes the documentation as a site into ./site (Python >= 3.11)
#
# Needs a Rust toolchain, Python >= 3.10 and make. Programs that only some tests need
# are listed in apt.txt; a missing one is one named line in the summary.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
CARGO  ?= cargo

STEP   := scripts/step
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check

# Processes that share the tests: one a core, at most four.
WORKERS ?= $(shell n=$$(nproc 2>/dev/null || echo 2); echo $$((n < 4 ? n : 4)))

# The oldest compiler that the crates promise.
OLDEST_RUST = $(shell sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)

.PHONY: demo test docs setup build build-demo test-rust rust-beside test-python python-checks wheel release-check oldest-rust deny semver bench-blind chain clean

demo: build-demo
	@$(BIN)/ecm identify examples/neck.toml --out demo
	@echo "Open demo/report.html in a browser, or go round the loop in one: $(BIN)/ecm app --demo"

# The tests of the crates run beside those of Python: some of them use one core alone.
test: build
	@$(MAKE) --no-print-directory -j2 rust-beside python-checks

rust-beside:
	@BESIDE=1 $(STEP) "Tests of the crates" $(MAKE) --no-print-directory test-rust

docs: build
	@$(STEP) "Pages of the crates by rustdoc" env RUSTDOCFLAGS="-D warnings" $(CARGO) doc --release \
	  --quiet --no-deps -p ecm-se3 -p ecm-poly -p ecm-fem -p ecm-doe
	@$(STEP) "Site of the documentation" env PYTHONPATH=scripts $(BIN)/python -m docsite target/doc
	@$(STEP) "Demo of the page" $(BIN)/python docs/demo_page.py site/demo.html
	@echo "Open site/index.html in a browser."

setup: $(VENV)/.ready

$(VENV)/bin/python:
	@$(STEP) "Python environment in $(VENV)" $(PYTHON) -m venv $(VENV)

# What the demo and the build use, and no more.
$(VENV)/.demo: pyproject.toml | $(VENV)/bin/python
	@$(STEP) "Python packages for the demo" \
	  sh -c "$(PIP) 'pip>=25.1' && $(PIP) --group build --group demo"
	@touch $@

$(VENV)/.ready: pyproject.toml | $(VENV)/bin/python
	@$(BIN)/python scripts/requirements.py mesh cad data logs report app learn cluster robot measure epics camera >$(VENV)/requirements.txt
	@$(STEP) "Python packages for the tests" \
	  sh -c "$(PIP) 'pip>=25.1' && $(PIP) --group dev -r $(VENV)/requirements.txt"
	@touch $@

# One profile for wheel and tests: the solver's dependencies are compiled once.
BUILD := $(STEP) "Rust core (a first build takes minutes)" $(BIN)/maturin develop --release

build: setup
	@$(BUILD)

# Told no group, maturin installs all that the tests need.
build-demo: $(VENV)/.demo
	@$(BUILD) --group demo

# What maturin tells pyo3: told otherwise, clippy and the next build would each compile it anew.
PYO3 = $(addprefix PYO3_BUILD_EXTENSION_MODULE=1 PYO3_CONFIG_FILE=, \
  $(lastword $(sort $(wildcard $(abspath $(or $(CARGO_TARGET_DIR),target))/maturin/pyo3-config-*.txt))))

# The whole workspace at once, `ecm-py` among it, of which nothing is built for the tests: so all
# dependencies have the features that they have in the wheel, and are compiled once.
test-rust:
	$(CARGO) fmt --all --check
	$(PYO3) $(CARGO) clippy --release --workspace --all-targets --quiet -- -D warnings
	$(CARGO) test --release --workspace --quiet

test-python: build
	@$(MAKE) --no-print-directory python-checks

python-checks:
	@$(BIN)/python scripts/size.py
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest ecm._native
	$(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

wheel: setup
	$(BIN)/maturin build --release --out dist

# Everything of a release that one Linux machine can try: wheels for Linux and Windows, installed and
# used, the source archive, the crates (long; CHECKS="versions linux" runs these only).
release-check: setup
	@$(STEP) "Python packages for a release" sh -c "$(PIP) --group release"
	PATH="$(CURDIR)/$(BIN):$$PATH" PYTHONPATH=scripts $(BIN)/python -m release.check $(CHECKS)

# The oldest compiler that Cargo.toml promises (needs rustup).
oldest-rust:
	rustup toolchain install --profile minimal $(OLDEST_RUST)
	$(CARGO) +$(OLDEST_RUST) check --locked --workspace

# Licences, sources and security advisories of the dependencies (needs cargo-deny and the network).
deny:
	$(CARGO) deny check

# Changes of the crates' public interface since BASE (needs cargo-semver-checks and the network).
semver:
	$(CARGO) semver-checks --baseline-rev $(or $(BASE),origin/main) -p ecm-se3 -p ecm-poly -p ecm-fem -p ecm-doe

# Every table with every base, from check to export (long; make test takes a sample).
chain: build
	$(BIN)/pytest -n $(WORKERS) tests/chain --whole

# The blind benchmark: what is missing is run, so it may be stopped (long; SETS=20 runs fewer).
bench-blind: build
	$(BIN)/python benches/blind.py --out out/bench-blind $(if $(SETS),--sets $(SETS)) \
	  $(if $(EVERY),--every $(EVERY))

clean:
	rm -rf target $(VENV) dist demo out site
