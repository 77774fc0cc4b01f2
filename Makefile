# Everything is installed into the checkout: .venv and frontend/node_modules.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CHROMIUM ?= /usr/bin/chromium
FRONTEND_SOURCES := $(shell find frontend/src frontend/index.html frontend/vite.config.ts -type f 2>/dev/null)

.PHONY: demo setup test check bench chromium clean

demo: setup
	$(BIN)/pilotage demo

setup: .stamps/python frontend/dist/index.html

.stamps/python: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@mkdir -p .stamps && touch $@

.stamps/node: frontend/package.json frontend/package-lock.json
	cd frontend && npm ci --no-audit --no-fund
	@mkdir -p .stamps && touch $@

frontend/dist/index.html: .stamps/node $(FRONTEND_SOURCES)
	cd frontend && npm run build
	@touch $@

chromium:
	@sh tests/e2e/install_chromium.sh $(CHROMIUM)

# Tests without a clock of their own share the two cores; those that run a station in real time follow, one at a time.
TIMELESS := tests/estimator tests/geodata tests/guidance tests/benchmarks tests/simulator \
	tests/backend/replay tests/backend/photos tests/backend/evidence

test: setup chromium
	cd frontend && npm test
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile $(TIMELESS)
	$(BIN)/python -m pytest $(addprefix --ignore=,$(TIMELESS))

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	cd frontend && npm run check

bench: setup
	$(BIN)/pilotage bench

clean:
	rm -rf $(VENV) .stamps frontend/node_modules frontend/dist
