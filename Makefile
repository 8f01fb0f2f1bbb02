# Two commands for a newcomer: `make demo` and `make test`. Each sets up all that it needs.
PYTHON ?= python3
# Where public recordings are looked for before they are fetched (empty: fetch on demand).
export FIELDGYM_DATA ?= $(wildcard $(CURDIR)/../shared/data)
# One thread a process: two processes on two cores beat two processes that fight for them.
# Each process keeps to its own half of the tests (worksteal), so that what one compiles or prepares is made once.
export OMP_NUM_THREADS ?= 1

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# What each target needs is installed once: for the demo no torch, for the tests everything.
DEMO := $(VENV)/.demo
TORCH := $(VENV)/.torch
READY := $(VENV)/.ready
# A CPU build of torch; PyPI's for Linux brings 5 GB of CUDA libraries, and is taken where this does not answer.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu

.PHONY: demo test nightly check mutants bench exam rivals papers ecosystem leaderboard docs build lock audit clean help

help:  ## this list
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

demo: $(DEMO)  ## diagnose a recording, compare agents, end in results/demo/report.html
	$(BIN)/fieldgym demo

test: $(READY)  ## the test suite
	$(BIN)/pytest -n 2 --dist worksteal

nightly: $(READY)  ## every test and every deliberate error, in parts that resume; unchanged parts are left out
	$(BIN)/python tests/nightly.py $(ONLY:%=--only %)

check: $(READY)  ## style, types, layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

mutants: $(READY)  ## put errors into copies of the project and see the tests notice each (make nightly does, too)
	$(BIN)/python tests/mutants/run.py --publish

bench: $(READY)  ## what users wait for, as ratios; fails where one is 1.5 times the accepted
	$(BIN)/python benchmarks/run.py

exam: $(READY)  ## the exam on its three sets, a sample of each (SET, CASES, BY); goes on where it was stopped
	for set in $(or $(SET),develop report field field-report); do \
		$(BIN)/fieldgym exam --set $$set --by $(or $(BY),diagnosis) --cases $(or $(CASES),300) || exit 1; done

rivals: $(READY)  ## thirty lines on the same cases
	$(MAKE) exam BY=forward

papers: $(READY)  ## every claim of the sources decided (ONLY a task): results/ledger/ledger.html
	$(BIN)/fieldgym reproduce --all $(ONLY)

ecosystem: $(READY)  ## train by every library of docs/your_library.md, in environments of their own (asks the network)
	$(PIP) install uv
	$(BIN)/python tests/ecosystem.py --publish

leaderboard: $(READY)  ## docs/leaderboard.md and the README's table: every agent on every task
	$(BIN)/fieldgym evaluate benchmark --set episodes=null
	$(BIN)/fieldgym evaluate heel_strike/benchmark --set 'agents=[regime_filter, ppo, pathwise]' \
		--set baseline=regime_filter --set episodes=200 --set first_seed=91_000_000 --out results/benchmark/fresh
	$(BIN)/python docs/leaderboard.py results/benchmark

docs: $(READY)  ## the docs site, in site/
	$(PIP) install --constraint constraints.txt --editable '.[docs]'
	$(BIN)/python docs/pictures.py
	$(BIN)/mkdocs build --strict

build: $(READY)  ## wheel and source distribution, in dist/
	$(BIN)/python -m build

lock: $(READY)  ## requirements.lock: every dependency with its hashes, on every platform (asks the network)
	$(PIP) install uv
	$(BIN)/uv pip compile pyproject.toml --all-extras --constraint constraints.txt --universal \
		--python-version 3.11.5 --upgrade --generate-hashes --no-annotate --quiet \
		--custom-compile-command 'make lock' --output-file requirements.lock

audit: $(READY)  ## known weaknesses of the pinned dependencies (asks the network)
	$(PIP) install pip-audit
	$(BIN)/pip-audit --strict --no-deps --disable-pip --requirement constraints.txt

clean:  ## remove compiled kernels, what was built, and the virtual environment
	-$(BIN)/python -c 'import shutil; from fieldmodels.compiled import cache_folder as f; shutil.rmtree(f() or "", True)'
	rm -rf $(VENV) dist build site

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "fieldgym needs Python 3.11 or newer; name one: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(DEMO): pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install --constraint constraints.txt --editable '.[agents]'
	@touch $@

$(TORCH): constraints.txt | $(BIN)/python
	@pin=$$(grep '^torch==' constraints.txt); \
	if $(BIN)/python -c 'import sys, urllib.request as web; web.urlopen(sys.argv[1], timeout=5).read()' \
		$(TORCH_INDEX)/torch/ 2>/dev/null && $(PIP) install --no-deps --index-url $(TORCH_INDEX) $$pin; \
	then echo "$$pin: the CPU build of $(TORCH_INDEX)"; \
	else echo "$$pin: as pip finds it, since $(TORCH_INDEX) does not answer (PyPI's for Linux takes 5 GB)"; \
		$(PIP) install --no-deps $$pin; fi
	@$(BIN)/python -c 'from importlib.metadata import version; print("installed: torch", version("torch"))'
	@touch $@

$(READY): pyproject.toml $(TORCH)
	$(PIP) install --constraint constraints.txt --editable '.[dev]'
	@touch $@
