# Everything runs in a virtual environment that the first call makes; PYTHON names the Python to make it with.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin

.PHONY: demo test fast browser board samples site wheel lowest bench evidence format types clean

demo: .venv/.demo  ## record a balancing robot on the twin, study its logs, name the report
	@echo "1 of 2: record 48 s around a square and 48 s along a figure of eight on the physics-engine twin, side by side"
	@$(BIN)/ballbot record nominal --reference figure_eight --duration 48 --seed 2 --out demo/figure_eight --quiet & \
	  $(BIN)/ballbot record nominal --reference square --duration 48 --seed 1 --out demo/square && wait $$!
	@echo "2 of 2: identify the friction, validate the model, choose a controller on 100 simulated robots"
	@$(BIN)/ballbot study alten demo/square/log.csv demo/figure_eight/log.csv --out demo

test: .venv/.test  ## all tests, the fast ones first
	$(BIN)/python -m pytest -m "not sample and not board and not browser" -n auto --dist loadfile

fast: .venv/.test  ## the fast tests alone
	$(BIN)/python -m pytest -m "not slow and not sample and not board and not browser" -n auto --dist loadfile

browser: .venv/.test  ## pages in headless Chromium; skips without Chromium, with the reason
	$(BIN)/python -m pytest -m browser -rs

board: .venv/.test  ## the firmware under cppcheck and sanitizers; skips what is not installed, with the reason
	$(BIN)/python -m pytest -m board -rs

samples: .venv/.test  ## a sample of each campaign and of the goldens; pages and examples made anew; engines that one test alone compiles; every array walked under bounds checks
	$(BIN)/python -m pytest -m sample -n auto --dist loadfile

site: .venv/.docs  ## the documentation, its commands run, into build/site; warnings are errors
	$(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --quiet docs build/site
	@echo "build/site/index.html"

wheel: .venv/bin/python  ## wheel and source archive checked by twine, the wheel installed alone into an empty environment, and commands tried there
	$(BIN)/python -m tests.release wheel

lowest: .venv/bin/python  ## commands and some tests with the lowest versions of what Ballbot depends on
	$(BIN)/python -m tests.release lowest

bench: .venv/.bench  ## timings against peers, into docs/generated/benchmarks.md
	$(BIN)/python -m benchmarks.run

evidence: .venv/.test  ## long campaigns, into docs/generated/evidence.md
	$(BIN)/python -m campaigns.evidence

format: .venv/.dev  ## put the code into its form
	$(BIN)/ruff check --fix src tests examples benchmarks campaigns docs/conf.py docs/extensions
	$(BIN)/ruff format src tests examples benchmarks campaigns docs/conf.py docs/extensions

types: .venv/.dev  ## style and types, nothing changed
	$(BIN)/ruff check src tests examples benchmarks campaigns docs/conf.py docs/extensions
	$(BIN)/ruff format --check src tests examples benchmarks campaigns docs/conf.py docs/extensions
	$(BIN)/pyright

clean:
	rm -rf .venv demo build dist

.venv/bin/python:
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip

.venv/.demo: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable ".[twin]"
	touch $@

.venv/.test: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable ".[test]"
	touch $@

.venv/.bench: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable ".[test,peers]"
	touch $@

.venv/.docs: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable ".[docs]"
	touch $@

.venv/.dev: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@
