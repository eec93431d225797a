# All commands of a developer; `make` prints the list.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
STAMP_RUN = $(VENV)/.installed-run
STAMP_TEST = $(VENV)/.installed-test
STAMP_DOCS = $(VENV)/.installed-docs

# batch: every mesh of the folder MESHES becomes BUILD/NAME.curvature.vtu and .png
MESHES ?= sample_meshes
BUILD ?= build
DDGCLI ?= $(BIN)/ddgcli
CURVATURE_OPTIONS ?=

.DEFAULT_GOAL := help
.PHONY: help demo pipeline test test-all lint fmt bench accuracy accuracy-check samples kernels fuzz mutants bench-page \
  docs hardcases hardcases-peers clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):[^#]*## /\1\t/' | expand -t 18

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; give it as make PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(STAMP_RUN): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[plot]'
	@touch $@

$(STAMP_TEST): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[plot,fast,test]'
	@touch $@ $(STAMP_RUN)

$(STAMP_DOCS): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[plot,docs]'
	@touch $@ $(STAMP_RUN)

demo: $(STAMP_RUN)  ## install into .venv, measure sample_meshes/, leave meshes and pictures in build/
	$(MAKE) --no-print-directory pipeline
	$(DDGCLI) info $(MESHES)/ball.vtu -o $(BUILD)/ball.info.vtu
	@echo; echo "Annotated meshes (.vtu, for ParaView or PyVista) and pictures are in $(BUILD)/:"; ls $(BUILD)

# -- batch: only meshes newer than their results are processed; works with -j --
EXTENSIONS = ply obj off stl csv
SOURCES = $(foreach e,$(EXTENSIONS),$(wildcard $(MESHES)/*.$(e)))
RESULTS = $(patsubst $(MESHES)/%,$(BUILD)/%.curvature.vtu,$(basename $(SOURCES)))

ifeq ($(RESULTS),)
pipeline:
	@echo "no mesh in $(MESHES)/ (looked for: $(EXTENSIONS)); name a folder: make pipeline MESHES=folder"; exit 2
endif
pipeline: $(RESULTS)  ## MESHES=folder: every mesh to BUILD/NAME.curvature.vtu and .png (try make -j2)

define curvature_rule
$(BUILD)/%.curvature.vtu $(BUILD)/%.curvature.png: $(MESHES)/%.$(1)
	@mkdir -p $$(@D)
	$$(DDGCLI) curvature $$< $$(CURVATURE_OPTIONS) -o $(BUILD)/$$*.curvature.vtu --plot $(BUILD)/$$*.curvature.png
endef
$(foreach e,$(EXTENSIONS),$(eval $(call curvature_rule,$(e))))

samples: $(STAMP_RUN)  ## write sample_meshes/ anew (the same bytes)
	$(BIN)/python sample_meshes/make.py

lint: $(STAMP_TEST)  ## ruff (lint and format) and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

fmt: $(STAMP_TEST)  ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

test: $(STAMP_TEST) lint accuracy-check  ## install what tests need; run lint, the accuracy check and the suite
	$(BIN)/python -m pytest -n 2 -m 'not slow'

test-all: $(STAMP_TEST) lint  ## the slow tests too
	$(BIN)/python -m pytest -n 2

clean:  ## remove build/ and caches
	rm -rf build .pytest_cache .mypy_cache .ruff_cache

accuracy: $(STAMP_TEST)  ## the atlas: docs/accuracy/, error against seconds on known truths (a quarter of an hour)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pymeshlab
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.atlas $(NAME)

accuracy-check: $(STAMP_TEST)  ## rerun the atlas's small meshes; fails if an error or a rate is worse
	$(BIN)/python -m benchmarks.atlas --check

kernels: $(STAMP_TEST)  ## results under OpenBLAS's Haswell, Sandybridge, SkylakeX kernels and without AVX agree
	$(BIN)/python -m benchmarks.kernels

docs: $(STAMP_DOCS)  ## build the site into build/site (warnings are errors); make missing pictures
	$(BIN)/python docs/make_pictures.py --missing
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

mutants: $(STAMP_TEST)  ## thirty deliberate one-line faults in a copy; each must fail its test; NAME=... for some
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.mutants $(NAME)

HARDCASES = nice $(BIN)/python -m benchmarks.hardcases
hardcases: $(STAMP_TEST)  ## every command on the hard cases: docs/hard-cases.md; ONLY=FAMILY, MISSING=1 (an hour)
	$(HARDCASES).run $(if $(ONLY),--only "$(ONLY)") $(if $(MISSING),--missing)

hardcases-peers: $(STAMP_TEST)  ## the peers on the same meshes; ONLY=FAMILY, MISSING=1
	$(HARDCASES).peers $(if $(ONLY),--only "$(ONLY)") $(if $(MISSING),--missing)

SECONDS ?= 60

fuzz: $(STAMP_TEST)  ## mutated inputs cause only our own errors; FORMAT=ply SECONDS=3600
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.fuzz --seconds $(SECONDS) $(if $(FORMAT),--format $(FORMAT))

bench-page: $(STAMP_TEST)  ## write docs/benchmarks/NAME.md from a bench; NAME=trace
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pymeshlab mujoco
	$(BIN)/python -m benchmarks.pages $(NAME)

BENCH_NAMES = $(patsubst benchmarks/peers/%.py,%,$(wildcard benchmarks/peers/[a-z]*.py))
BENCHES = $(filter $(or $(NAME),%),$(BENCH_NAMES))

bench: $(STAMP_TEST)  ## time and memory beside peers, in one run; NAME=geodesic for one bench
	@test -n "$(BENCHES)" || { echo "no bench is called $(NAME); there are: $(BENCH_NAMES)"; exit 2; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pymeshlab mujoco
	@for bench in $(BENCHES); do OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.peers.$$bench || exit 1; done
