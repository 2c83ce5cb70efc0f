# Two commands do all of their own set-up in .venv:
#
#   make demo [PHOTO=path]   shake a photo, deblur it blindly, leave pictures in out/demo
#   make test                lint, types, tests
#
# PYTHON=python3.12 chooses the interpreter that .venv is made from (3.11 or newer).

PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
STAMP := $(VENV)/.installed
CODE := deshake scripts tests

# Two to four files of tests at a time, so that what the tests of a file share is made once; each
# of them uses one thread for its linear algebra. Files marked as long begin first.
WORKERS ?= $(shell n=$$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2); \
	if [ "$$n" -lt 2 ]; then n=2; fi; if [ "$$n" -gt 4 ]; then n=4; fi; echo $$n)

PYTEST = OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) -m pytest -n $(WORKERS) \
	--dist loadfile --no-loadscope-reorder

# Python compiles a module when it is first imported, and keeps it, whatever the environment says.
export PYTHONDONTWRITEBYTECODE :=

export PHOTO

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test lint types coverage pytest format man clean

help:
	@sed -n '3,6s/^# *//p' Makefile
	@echo "also: make lint, types, coverage, pytest, format, man, clean"

setup: $(STAMP)

$(STAMP): pyproject.toml
	@command -v "$(PYTHON)" >/dev/null 2>&1 || { \
		echo "error: $(PYTHON): no such program" >&2; \
		echo "hint: name a Python >= 3.11, as in: make test PYTHON=python3.12" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "error: deshake needs Python >= 3.11, and this is `"$(PYTHON)" --version 2>&1`" >&2; \
		echo "hint: name a newer one, as in: make test PYTHON=python3.12" >&2; exit 1; }
	@"$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "error: $(PYTHON) cannot make virtual environments" >&2; \
		echo "hint: install its venv module (Debian, Ubuntu: apt install python3-venv)" >&2; exit 1; }
	"$(PYTHON)" -m venv $(VENV)
	$(PY) -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[dev]'
	@touch $@

demo: $(STAMP)
	$(PY) scripts/demo.py --output out/demo $${PHOTO:+"$$PHOTO"}

# The types are checked beside the tests: they take one core for long.
test: lint
	@$(MAKE) --no-print-directory -j 2 types coverage

lint: $(STAMP)
	$(PY) -m ruff check $(CODE)
	$(PY) -m ruff format --check $(CODE)

types: $(STAMP)
	$(PY) -m mypy

# All tests, and the share of the package's lines that they run: too few is an error.
coverage: $(STAMP)
	@rm -f .coverage .coverage.*
	$(PYTEST) -p tests.support.line_probes
	$(PY) -m coverage combine --quiet
	$(PY) -m coverage report

# Some tests, as in: make pytest ARGS="-k kernel"
pytest: $(STAMP)
	$(PYTEST) $(ARGS)

format: $(STAMP)
	$(PY) -m ruff check --fix $(CODE)
	$(PY) -m ruff format $(CODE)

man: $(STAMP)
	$(PY) scripts/make_man_pages.py

clean:
	rm -rf $(VENV) out dist .coverage .coverage.* .mypy_cache .pytest_cache .ruff_cache
	find $(CODE) -name __pycache__ -type d -prune -exec rm -rf {} +
