# Two commands need nothing but Python 3.11 and make: `make demo` and `make test`.
# Another Python has an environment of its own: `make test PYTHON=python3.13` makes .venv-3.13.
PYTHON ?= python3.11
VENV ?= .venv$(patsubst -3.11,,$(patsubst python%,-%,$(notdir $(PYTHON))))
BIN := $(VENV)/bin
PARALLEL := -n 2 --dist worksteal
# Python keeps what it compiles, also in containers that say otherwise: each of the many processes starts seconds sooner.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test quick-test lint bench prove docs reports lock clean
.DELETE_ON_ERROR:

demo: $(VENV)/.ready  ## run the quick study, print its table, write its picture
	$(BIN)/cooploc run quick --jobs 2

test: lint  ## everything CI checks
	$(BIN)/pytest $(PARALLEL)

quick-test: lint  ## every room in about a minute: all but the tests marked slow
	$(BIN)/pytest $(PARALLEL) -m "not slow"

lint: $(VENV)/.ready  ## style, types, and what may import what
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --num-workers 2
	$(BIN)/lint-imports --no-cache

bench: $(VENV)/.ready  ## what speed was aimed at and what is reached, beside a reference; five minutes; keeps its report
	$(BIN)/python reports/make_all.py --only "speed,speed-notes in speed.md"

prove: $(VENV)/.ready  ## how often intervals and verdicts are right, by simulation; keeps its report
	$(BIN)/python reports/make_all.py --only rates,stopping

$(VENV)/.ready: requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

docs: .venv-docs/.ready  ## the documentation site, in build/docs; needs no network once its environment is there
	.venv-docs/bin/python -m sphinx -q -W --keep-going -j auto docs build/docs
	@echo build/docs/index.html

.venv-docs/.ready: docs/requirements.lock pyproject.toml
	$(PYTHON) -m venv .venv-docs
	.venv-docs/bin/python -m pip install --quiet --disable-pip-version-check --no-compile --require-hashes -r docs/requirements.lock
	.venv-docs/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

reports: $(VENV)/.ready  ## every study and page of reports/ again, two hours; goes on where it was ended
	$(BIN)/python reports/make_all.py --data $(or $(COOPLOC_DATA),../shared/data)

lock:  ## pin what is new and keep the other pins, or pin everything again: make lock UPGRADE=--upgrade (needs uv)
	uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --no-emit-find-links --no-header $(UPGRADE) --output-file requirements.lock
	uv pip compile pyproject.toml --extra docs --universal --python-version 3.11 --generate-hashes -c requirements.lock \
	  --no-emit-index-url --no-emit-find-links --no-header $(UPGRADE) --output-file docs/requirements.lock

clean:
	rm -rf $(VENV) .venv-docs build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache
