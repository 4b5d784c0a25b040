# On a fresh machine `make demo` and `make test` do all the set-up they need.
PYTHON ?= python3
BIN := .venv/bin
DEMO := demo
WORKERS ?= 2

.DEFAULT_GOAL := help
.PHONY: help demo test check bench docs build format clean

help:  ## list what can be made
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 10

.venv/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all,test]'
	@touch $@

demo: export PATH := $(CURDIR)/$(BIN):$(PATH)
demo: export SSIL_STORE := $(DEMO)/datasets
demo: .venv/.installed  ## score the racetrack demonstrations, ask LCoR, write the report
	@rm -rf $(DEMO) && mkdir $(DEMO) && cp -R datasets $(DEMO)/datasets
	ssil-data datasets
	ssil-data score racetrack
	ssil-data score racetrack --estimator windowvae --preset paper
	ssil-data show racetrack
	ssil-data lcor racetrack --run ensemble --episode 200
	ssil-data report racetrack -o $(DEMO)/report.html
	@echo "Open $(DEMO)/report.html in a browser; the scored store is $(DEMO)/datasets."

# one thread each, or the workers' linear algebra fights for the processors
test: export OMP_NUM_THREADS := 1
test: .venv/.installed  ## run the tests, on WORKERS processes
	$(BIN)/pytest -n $(WORKERS) --dist worksteal

check: .venv/.installed  ## format, lint, types, import contracts
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports

bench: .venv/.installed  ## run the benchmarks
	@for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python $$script || exit 1; done

docs: .venv/.installed  ## build the manual into site/, for reading without a network
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "Open site/index.html in a browser."

build: .venv/.installed  ## build the wheel and the source archive into dist/
	$(BIN)/python -m build

format: .venv/.installed  ## format and sort imports
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:  ## remove what was made, but not the datasets
	rm -rf .venv $(DEMO) site dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
