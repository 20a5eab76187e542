# Two commands do all the set-up on a fresh machine with Python >= 3.11: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS := 1

.PHONY: demo test lint lowest bench clean

demo: $(VENV)/demo.stamp
	$(BIN)/wbc run problems/astronaut_expand.yaml --output result.json --plot result.png

test: $(VENV)/dev.stamp
	$(BIN)/python -m pytest -n auto

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The tests with the lowest versions that pyproject.toml allows, in an environment of their own.
lowest:
	$(PYTHON) -m venv build/lowest
	build/lowest/bin/pip install -qq uv
	build/lowest/bin/uv pip install -q --python build/lowest/bin/python --resolution lowest-direct \
		--editable '.[robots,plot,bench]' 'pytest>=8.2' 'pytest-xdist>=3.6.1'
	build/lowest/bin/python -m pytest -n auto

bench: $(VENV)/dev.stamp
	$(BIN)/python benchmarks/tick.py
	$(BIN)/python benchmarks/solvers.py

clean:
	rm -rf $(VENV) build dist *.egg-info result.json result.png

# `make test` after `make demo` only adds what is missing.
$(VENV)/demo.stamp: pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install -qq --editable '.[plot]'
	touch $@

$(VENV)/dev.stamp: pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install -qq --editable '.[dev]'
	touch $@

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "wbc needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; try: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -qq --upgrade pip
