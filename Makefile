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
.PHONY: help demo pipeline test suite test-all lint fmt bench accuracy accuracy-check samples kernels lowest fuzz mutants bench-page \
  docs man dist hardcases hardcases-peers clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):[^#]*## /\1\t/' | expand -t 18

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; give it as make PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(STAMP_RUN): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[plot]'
	@touch $@

# pip would compile modules on one core, those of tests too; what does not compile here does so at its import
$(STAMP_TEST): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[plot,fast,test]'
	@$(BIN)/python -m compileall -qq -j 0 -x '/tests?/' $(VENV)/lib || true
	@touch $@ $(STAMP_RUN)

$(STAMP_DOCS): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[plot,docs]'
	@touch $@ $(STAMP_RUN)

demo: $(STAMP_RUN)  ## install into .venv, measure sample_meshes/, leave meshes and pictures in build/
	$(MAKE) --no-print-directory pipeline
	$(DDGCLI) info $(MESHES)/ball.vtu -o $(BUILD)/ball.info.vtu
	@echo; echo "Annotated meshes (.vtu, for ParaView or PyVista) and pictures are in $(BUILD)/:"; ls $(BUILD)

# -- batch: only meshes newer than their results are processed; works with -j --
EXTENSIONS = 3dxml 3mf avs bdf cgns csv ctm dae dat dato dxf e ele ex2 exo f3grid fem glb gltf h5 h5m hdf \
  hmf inp mdpa med mesh meshb msh nas node npz obj off ply post step stl stp su2 tec txt ugrid \
  vol vtk vtkhdf vtp vtu wkt xaml xdmf xmf xml xyz zae zip
empty :=
FILES := $(shell ls $(MESHES))
SOURCES := $(shell ls $(MESHES) | grep -iE '^[[:alnum:]_.,+@-]+\.($(subst $(empty) $(empty),|,$(strip $(EXTENSIONS))))$$')
SKIPPED := $(filter-out $(SOURCES),$(FILES))
# two files that differ in the extension alone keep it in the names of their results
stem = $(if $(word 2,$(filter $(basename $1),$(basename $(SOURCES)))),$1,$(basename $1))
RESULTS = $(foreach f,$(SOURCES),$(BUILD)/$(call stem,$f).curvature.vtu)

ifeq ($(SOURCES),)
pipeline:
	$(info no mesh in $(MESHES)/ (skipped: $(or $(SKIPPED),nothing)); name a folder: make pipeline MESHES=folder)
	@exit 2
endif
pipeline: $(RESULTS)  ## MESHES=folder: every mesh to BUILD/NAME.curvature.vtu and .png (try make -j2)
	$(if $(SKIPPED),$(info skipped in $(MESHES)/ (no mesh format, or a name that make cannot hold): $(SKIPPED)))

define curvature_rule
$(BUILD)/$(call stem,$1).curvature.vtu: $(MESHES)/$1
	@mkdir -p $$(@D)
	$$(DDGCLI) curvature $$< $$(CURVATURE_OPTIONS) -o $$@ --plot $$(basename $$@).png
endef
$(foreach f,$(SOURCES),$(eval $(call curvature_rule,$f)))

samples: $(STAMP_RUN)  ## write sample_meshes/ anew (the same bytes)
	$(BIN)/python sample_meshes/make.py

lint: $(STAMP_TEST)  ## ruff (lint and format) and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

fmt: $(STAMP_TEST)  ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

test: $(STAMP_TEST)  ## install what tests need; run lint, the accuracy check and the suite
	$(MAKE) --no-print-directory -j2 lint suite

# in `make test` beside lint, whose mypy keeps one core busy for longer than the accuracy check the other;
# to rewrite assertions takes 11 s in each process: only what fails runs again with the values in its message
suite: accuracy-check
	unset MAKEFLAGS MFLAGS; $(BIN)/python -m pytest -n 2 -m 'not slow' --assert=plain || \
	  { $(BIN)/python -m pytest --last-failed --last-failed-no-failures none -m 'not slow'; exit 1; }

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

LOWEST = $(shell sed -nE '/^dependencies/,/^\]/s/^ *"([a-z0-9]+)>=(.*)",/\1==\2/p' pyproject.toml)
lowest: pyproject.toml  ## the tests of exact values, commands and the library with the oldest dependencies allowed
	$(PYTHON) -m venv $(VENV)-lowest
	$(VENV)-lowest/bin/python -m pip install --quiet --disable-pip-version-check -e '.[plot,test]'
	$(VENV)-lowest/bin/python -m pip install --quiet --disable-pip-version-check $(LOWEST)
	$(VENV)-lowest/bin/python -m pytest -n 2 -m 'not slow' tests/library tests/cli tests/io tests/exact

docs: $(STAMP_DOCS)  ## build the site into build/site (warnings are errors); make missing pictures
	$(BIN)/python docs/make_pictures.py --missing
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

dist: $(STAMP_RUN)  ## wheel and sdist into dist/, checked and installed in a clean environment
	rm -rf dist build/dist
	$(BIN)/python -m pip install --quiet --disable-pip-version-check build twine
	$(BIN)/python -m build --outdir dist .
	$(BIN)/python -m twine check --strict dist/*
	$(PYTHON) -m venv build/dist/env
	build/dist/env/bin/pip install --quiet --disable-pip-version-check dist/*.whl
	cd build/dist && env/bin/ddgcli --version && env/bin/ddgcli examples samples && \
	  env/bin/ddgcli curvature samples/sample_meshes/torus.ply -o torus.vtu
	build/dist/env/bin/pip uninstall --quiet --yes ddgcli
	build/dist/env/bin/pip install --quiet --disable-pip-version-check dist/*.tar.gz
	cd build/dist && env/bin/ddgcli --version && env/bin/ddgcli examples again

man: $(STAMP_RUN)  ## manual pages of all commands into build/man
	$(BIN)/python docs/make_man.py build/man

mutants: $(STAMP_TEST)  ## thirty deliberate one-line faults in a copy; each must fail its test; NAME=... for some
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.mutants $(NAME)

HARDCASES = nice $(BIN)/python -m benchmarks.hardcases
hardcases: $(STAMP_TEST)  ## every command on the hard cases: docs/hard-cases.md; ONLY=FAMILY, MISSING=1 (an hour)
	$(HARDCASES).run $(if $(ONLY),--only "$(ONLY)") $(if $(MISSING),--missing)

hardcases-peers: $(STAMP_TEST)  ## the peers on the same meshes; ONLY=FAMILY, MISSING=1
	$(HARDCASES).peers $(if $(ONLY),--only "$(ONLY)") $(if $(MISSING),--missing)

SECONDS ?= 60

fuzz: $(STAMP_TEST)  ## mutated inputs, random scenes and calls cause only our own errors; FORMAT=ply SECONDS=3600 STORE=1
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.fuzz --seconds $(SECONDS) $(if $(FORMAT),--format "$(FORMAT)") \
	  $(if $(STORE),--store)
	$(if $(STORE),$(HARDCASES).run --page)

bench-page: $(STAMP_TEST)  ## write docs/benchmarks/NAME.md from a bench; NAME=trace
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pymeshlab mujoco
	$(BIN)/python -m benchmarks.pages $(NAME)

BENCH_NAMES = $(patsubst benchmarks/peers/%.py,%,$(wildcard benchmarks/peers/[a-z]*.py))
BENCHES = $(filter $(or $(NAME),%),$(BENCH_NAMES))

bench: $(STAMP_TEST)  ## time and memory beside peers, in one run; NAME=geodesic for one bench
	@test -n "$(BENCHES)" || { echo "no bench is called $(NAME); there are: $(BENCH_NAMES)"; exit 2; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pymeshlab mujoco
	@for bench in $(BENCHES); do OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.peers.$$bench || exit 1; done
