# `make` lists the targets. Everything is installed into $(VENV), once, and again only after a change of
# pyproject.toml or constraints.txt.

PYTHON      ?= python3
VENV        ?= .venv
TORCH       ?= torch==2.13.0
DEMO_CONFIG ?= configs/demo.yaml
PYTEST_ARGS ?=

SHELL       := bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
MAKEFLAGS   += --no-builtin-rules --no-print-directory

RUN_EXTRAS   := agents,render
TEST_EXTRAS  := agents,contrib,onnx,render,window,docs,site,test
BENCH_EXTRAS := agents,render,explore,bench
DOCS_EXTRAS  := docs
SITE_EXTRAS  := site
PEERS_EXTRAS := peers
ALL_EXTRAS   := agents,contrib,onnx,render,window,explore,test,bench,docs,site,peers
DEFINITIONS  := pyproject.toml constraints.txt
IN_VENV      := $(VENV)/bin/python -m
RUN_STAMP    := $(VENV)/.installed-run
TEST_STAMP   := $(VENV)/.installed-test
BENCH_STAMP  := $(VENV)/.installed-bench
DOCS_STAMP   := $(VENV)/.installed-docs
SITE_STAMP   := $(VENV)/.installed-site
PEERS_STAMP  := $(VENV)/.installed-peers

# Of pip's output, one line for each package.
PROGRESS := sed -unE -e 's/^Collecting ([A-Za-z0-9._-]+).*/  \1/p' -e 's/^Processing .*\/([^-]+)-.*/  \1/p' \
	-e 's/^Installing collected packages.*/  installing .../p'

.DEFAULT_GOAL := help

.PHONY: help
help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

.PHONY: demo
demo: $(RUN_STAMP) ## Train the demonstration agent, then evaluate it: a table here and runs/demo/report.html
	$(IN_VENV) agents.train $(DEMO_CONFIG) --force
	$(IN_VENV) agents.evaluate runs/demo

.PHONY: test
test: lint ## Everything that must hold: linters, types, import contracts, tests
	OMP_NUM_THREADS=1 $(IN_VENV) pytest -n 2 $(PYTEST_ARGS)

.PHONY: bounds
bounds: $(TEST_STAMP) ## Try every door with bounds checks in compiled code, which is compiled for that first: many minutes
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/.bounds-cache OMP_NUM_THREADS=1 $(IN_VENV) tests.boundary

.PHONY: lint
lint: $(TEST_STAMP) ## The checks without the tests
	$(IN_VENV) ruff check .
	$(IN_VENV) ruff format --check .
	$(IN_VENV) mypy
	$(VENV)/bin/lint-imports --no-logo

.PHONY: format
format: $(TEST_STAMP) ## Format the code and mend what ruff can mend
	$(IN_VENV) ruff check --fix-only .
	$(IN_VENV) ruff format .

.PHONY: bench
bench: $(BENCH_STAMP) ## Measure the speed of environments and solvers, beside others
	$(IN_VENV) benchmarks environments
	$(IN_VENV) benchmarks kinematics

.PHONY: peers
peers: $(PEERS_STAMP) ## Measure a step beside other simulators and solvers, all installed: docs/compared_with.md
	$(IN_VENV) benchmarks peers --page docs/compared_with.md

.PHONY: figures
figures: $(DOCS_STAMP) ## Draw the paper's figures, write their numbers, and draw the pictures of the ideas
	$(IN_VENV) docs.figures
	$(IN_VENV) docs.ideas

.PHONY: pages
pages: $(DOCS_STAMP) ## Write a page for each environment from its docstrings: docs/environments
	$(IN_VENV) docs.environments

.PHONY: docs
docs: $(SITE_STAMP) ## Build the site, its tutorials run, from what is in docs: docs/_build/html/index.html
	$(IN_VENV) sphinx -W --keep-going docs docs/_build/html

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

# One pip command for each purpose, so that torch is chosen together with the rest, under the constraints.
define install
	@echo "Installing pcm_gym with $(1) into $(VENV)"
	@$(IN_VENV) pip install --disable-pip-version-check --constraint constraints.txt --editable ".[$(1)]" | $(PROGRESS)
	@touch $(2)
endef

$(RUN_STAMP): $(DEFINITIONS) | $(VENV)/bin/python
	$(call install,$(RUN_EXTRAS),$@)

$(TEST_STAMP): $(DEFINITIONS) | $(VENV)/bin/python
	$(call install,$(TEST_EXTRAS),$@ $(RUN_STAMP))

$(BENCH_STAMP): $(DEFINITIONS) | $(VENV)/bin/python
	$(call install,$(BENCH_EXTRAS),$@ $(RUN_STAMP))

$(DOCS_STAMP): $(DEFINITIONS) | $(VENV)/bin/python
	$(call install,$(DOCS_EXTRAS),$@)

$(SITE_STAMP): $(DEFINITIONS) | $(VENV)/bin/python
	$(call install,$(SITE_EXTRAS),$@)

$(PEERS_STAMP): $(DEFINITIONS) | $(VENV)/bin/python
	$(call install,$(PEERS_EXTRAS),$@)

define CONSTRAINTS_HEADER
# Exact versions of everything that `make` installs, all extras, Python 3.11 on Linux.
# Made by `make constraints`, from the ranges in pyproject.toml; do not edit by hand.
# Torch stays at the version named in the Makefile: another one is asked for with `make constraints TORCH=torch==X.Y.Z`.
endef
export CONSTRAINTS_HEADER

.PHONY: constraints
constraints: ## Choose the newest versions that fit and write them to constraints.txt
	rm -rf .venv-constraints
	$(PYTHON) -m venv .venv-constraints
	.venv-constraints/bin/python -m pip install --disable-pip-version-check "$(TORCH)" ".[$(ALL_EXTRAS)]" | $(PROGRESS)
	echo "$$CONSTRAINTS_HEADER" > .venv-constraints/pins
	.venv-constraints/bin/python -m pip freeze --all --disable-pip-version-check \
		| sed -E -e '/^(pip|wheel|pcm[_-]gym)[= ]/d' -e 's/\+.*$$//' >> .venv-constraints/pins
	mv .venv-constraints/pins constraints.txt
	rm -rf .venv-constraints

.PHONY: clean
clean: ## Remove the environment, builds and caches; the runs stay
	rm -rf $(VENV) .venv-constraints build dist .hypothesis .import_linter_cache .bounds-cache .mypy_cache .pytest_cache .ruff_cache docs/_build
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
