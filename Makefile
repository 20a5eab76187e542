# Two commands do all the set-up on a fresh machine with Python >= 3.11: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS := 1
# What the installed package is compiled from: it is built again where one of these changed.
CORE := $(wildcard wbc/native/source/*) wbc/native/sources.py setup.py build_backend.py pyproject.toml

.PHONY: demo view test test-slow docs fuzz soak mutation sanitize lint lowest bench dist clean

demo: $(VENV)/demo.stamp
	$(BIN)/wbc run problems/astronaut_expand.yaml --output result.json --plot result.png

# The same, moving, in a web browser: open the address that is printed; Ctrl-C ends it.
view: $(VENV)/view.stamp
	$(BIN)/wbc view problems/astronaut_expand.yaml

# COVER=1: with branch coverage of wbc/, of which LEAST % are wanted of all tests.
LEAST ?= 97
COVERAGE = --cov=wbc --cov-branch --cov-report=term:skip-covered --cov-fail-under=$(LEAST)
# Neighbours share what is made for a file once: each process takes half of them, then what is left.
PYTEST = -m pytest -n auto --dist worksteal
test: SELECT = not slow
test: $(VENV)/dev.stamp
	$(BIN)/python $(PYTEST) -m "$(SELECT)" $(MORE) $(if $(COVER),$(COVERAGE))

# Those that take more than 1.5 s each: whole runs, searches, robots, campaigns.
test-slow: $(VENV)/dev.stamp
	$(BIN)/python $(PYTEST) -m slow --durations=30 --durations-min=10

# The documentation site, into build/site; a warning is an error.
docs: $(VENV)/dev.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build -q --strict -f docs/site/mkdocs.yml

# All seeded fuzz tests with about FUZZ inputs (an hour and more), half of them robot files.
FUZZ ?= 100000
fuzz: $(VENV)/dev.stamp
	WBC_FUZZ=$$(($(FUZZ) / 6)) $(BIN)/python -m pytest -n auto tests/robot/formats/test_fuzz.py
	WBC_FUZZ=$$(($(FUZZ) / 2)) $(BIN)/python -m pytest -n auto tests/motion/test_hostile_files.py
	WBC_FUZZ=$$(($(FUZZ) / 10)) $(BIN)/python -m pytest -n auto tests/human/test_hostile.py
	WBC_FUZZ=$$(($(FUZZ) / 20)) $(BIN)/python -m pytest -n auto tests/problem/test_fuzz_problems.py
	WBC_FUZZ=$$(($(FUZZ) / 10)) $(BIN)/python -m pytest -n auto tests/benchmarks/test_soak.py

# A million closed-loop ticks with faults injected; goes on where it was stopped or killed.
TICKS ?= 1000000
soak: $(VENV)/dev.stamp
	$(BIN)/python benchmarks/soak.py --ticks $(TICKS)

# FAULTS small faults, chosen at random from all places in the rooms named in the file, put in one by
# one: which do the tests not notice? A second or two each; goes on where it was stopped.
FAULTS ?= 300
SEED ?= 1
mutation: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.mutation --faults $(FAULTS) --seed $(SEED)

# The tests of the core and of what is nearest to it, with a core that notices what C leaves undefined
# (addresses, integers, null pointers): a copy of what is committed, in build/sanitized.
SANITIZE := -fsanitize=address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer
sanitize: $(VENV)/dev.stamp
	rm -rf build/sanitized && mkdir -p build/sanitized
	git archive HEAD | tar -x -C build/sanitized
	cd build/sanitized && CFLAGS="$(SANITIZE) -g -O1" LDFLAGS="$(SANITIZE)" \
		$(CURDIR)/$(BIN)/python setup.py -q build_ext --inplace
	cd build/sanitized && PYTHONPATH=. ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1 \
		LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libubsan.so)" \
		$(CURDIR)/$(BIN)/python -m pytest -s -q -p no:xdist -m "not slow" \
		tests/native tests/qp tests/tasks tests/constraints tests/controllers tests/estimation tests/gait tests/loops

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror wbc/*/source/*.[ch] wbc/*/source/*/*.[ch]
	$(BIN)/mypy
	$(BIN)/python tests/typing/check.py
	$(BIN)/codespell README.md CHANGELOG.md docs examples wbc benchmarks problems Makefile .ci

# The tests with the lowest versions that pyproject.toml allows, in an environment of their own;
# `make lowest SELECT="not slow"`: the quick ones; TESTS="tests/qp": those of a room.
SELECT ?= slow or not slow
TESTS ?= tests
lowest: build/lowest/stamp
	build/lowest/bin/python $(PYTEST) -m '$(SELECT)' $(TESTS)

build/lowest/stamp: $(CORE)
	$(PYTHON) -m venv build/lowest
	build/lowest/bin/pip install -qq uv
	UV_SYSTEM_CERTS=1 build/lowest/bin/uv pip install -q --python build/lowest/bin/python --resolution lowest-direct \
		--editable '.[robots,plot,sim,view,mcap,batch,cluster,bench]' 'pytest>=8.2' 'pytest-xdist>=3.6.1'
	touch $@

# Solvers, the loop beside its neighbours, campaigns and ticks, each into its section of the page of results.
# Neighbours get environments of their own first (TSID is compiled, which takes twelve minutes);
# those that cannot be made are left out, by name. The error 3 in the end: ticks are slower than in
# the run before.
RESULTS := benchmarks/RESULTS.md
bench: $(VENV)/dev.stamp
	$(BIN)/wbc bench --ticks 100 --output $(RESULTS)
	-PYTHON=$(CURDIR)/$(BIN)/python bash benchmarks/peers/environments.sh
	$(BIN)/python benchmarks/peers/run.py --output $(RESULTS)
	$(BIN)/python benchmarks/campaign.py --only scaling --output $(RESULTS)
	$(BIN)/python benchmarks/tick.py --output $(RESULTS) --history build/ticks.jsonl

# sdist and a wheel for any Linux (of Python's stable ABI: one for all versions), into dist/, and the
# wheel tried with each of PYTHONS that is here, in a clean environment without a compiler.
PYTHONS ?= python3.11 python3.12 python3.13
dist: $(VENV)/dev.stamp
	rm -rf dist build/dist
	$(BIN)/python -m build --outdir build/dist .
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/auditwheel repair --wheel-dir dist build/dist/*.whl
	cp build/dist/*.tar.gz dist
	mkdir -p build/empty
	@set -e; for python in $(PYTHONS); do \
		if ! $$python -c "" 2>/dev/null; then echo "== LEFT OUT: no $$python here"; continue; fi; \
		$$python -m venv --clear build/dist-$$python; \
		build/dist-$$python/bin/pip install -q dist/*.whl; \
		(cd build/empty && env -u CC PATH="$$PWD" ../dist-$$python/bin/wbc doctor && \
			../dist-$$python/bin/wbc init - | ../dist-$$python/bin/wbc run - -q); \
	done

clean:
	rm -rf $(VENV) build dist *.egg-info result.json result.png

# `make test` after `make demo` only adds what is missing.
$(VENV)/demo.stamp: $(CORE) | $(VENV)/bin/python
	$(BIN)/pip install -qq --editable '.[plot]'
	touch $@

$(VENV)/view.stamp: $(CORE) | $(VENV)/bin/python
	$(BIN)/pip install -qq --editable '.[plot,view]'
	touch $@

$(VENV)/dev.stamp: $(CORE) | $(VENV)/bin/python
	$(BIN)/pip install -qq --editable '.[dev]'
	touch $@

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "wbc needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; try: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -qq --upgrade pip
