# The only list of commands a developer must know; `make` prints it.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
STAMP_RUN = $(VENV)/.installed-run
STAMP_TEST = $(VENV)/.installed-test

.DEFAULT_GOAL := help
.PHONY: help demo test lint fmt types bench accuracy accuracy-check samples docs clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):[^#]*## /\1\t/' | expand -t 18

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(STAMP_RUN): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[plot]'
	@touch $@

$(STAMP_TEST): pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[plot,fast,test]'
	@touch $@ $(STAMP_RUN)

demo: $(STAMP_RUN)  ## install into .venv, measure sample_meshes/, leave meshes and pictures in build/
	@mkdir -p build
	$(BIN)/ddgcli --version

lint: $(STAMP_TEST)  ## ruff (lint and format) and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

fmt: $(STAMP_TEST)  ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

test: $(STAMP_TEST) lint  ## install what tests need and run lint and the suite
	$(BIN)/python -m pytest -n 2 -m 'not slow'

clean:  ## remove build/ and caches
	rm -rf build .pytest_cache .mypy_cache .ruff_cache
