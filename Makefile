# Two commands need nothing but Python 3.11 and make: `make demo` and `make test`.
# Another Python has an environment of its own: `make test PYTHON=python3.13` makes .venv-3.13.
PYTHON ?= python3.11
VENV ?= .venv$(patsubst -3.11,,$(patsubst python%,-%,$(notdir $(PYTHON))))
BIN := $(VENV)/bin
PARALLEL := -n 2 --dist worksteal

.PHONY: demo test quick-test docs lint types floors units hooks looks bench prove accuse findings reliability alike \
  oddities truth peers reports lock clean
.DELETE_ON_ERROR:

demo: $(VENV)/.ready  ## run the quick study, print its table, write its picture
	$(BIN)/cooploc run quick

test: lint types floors units  ## everything CI checks

quick-test: lint types floors  ## every room in two minutes: all but the tests marked slow
	$(BIN)/pytest $(PARALLEL) -m "not slow"

lint: $(VENV)/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.ready
	$(BIN)/mypy

floors: $(VENV)/.ready
	$(BIN)/lint-imports --no-cache

units: $(VENV)/.ready
	$(BIN)/pytest $(PARALLEL)

hooks: $(VENV)/.ready  ## before every commit what CI checks but for the tests, before every push make quick-test
	$(BIN)/pre-commit install

looks: $(VENV)/.ready  ## a report in a real browser, at 400 and 1400 pixels and on paper; pictures in build/looks
	command -v chromium >/dev/null || { apt-get update -qq && apt-get install -y -qq chromium; }
	LOOKS=build/looks $(BIN)/pytest tests/analysis/report/test_looks.py

bench: $(VENV)/.ready  ## what speed was aimed at and what is reached, beside a reference; five minutes; keeps its report
	$(BIN)/python benchmarks/speed.py reports/speed.md
	$(BIN)/python reports/page.py speed-notes build reports/speed.md
	$(BIN)/python reports/page.py speeds build README.md

prove: $(VENV)/.ready  ## how often intervals and verdicts are right, by simulation; keeps its report
	$(BIN)/python benchmarks/statistics/rates.py reports/statistics.md
	$(BIN)/python benchmarks/statistics/stopping.py reports/statistics.md

accuse: $(VENV)/.ready  ## is an honest estimator ever accused? an hour; keeps its report after every seed
	$(BIN)/python benchmarks/statistics/accusations.py reports/accusations.md 50

findings: $(VENV)/.ready  ## how often `cooploc inspect` names what is wrong, and what is not; half an hour
	PYTHONPATH=tests/helpers $(BIN)/python benchmarks/statistics/findings.py reports/findings.md 100

reliability: $(VENV)/.ready  ## what a plug-in's crash, damage, death and isolation cost; ten minutes; keeps its report
	$(BIN)/python benchmarks/reliability/crash_matrix.py reports/reliability.md
	$(BIN)/python benchmarks/reliability/damage.py reports/reliability.md
	$(BIN)/python benchmarks/reliability/report_size.py reports/reliability.md
	$(BIN)/python benchmarks/reliability/isolation_price.py reports/reliability.md

alike: $(VENV)/.ready  ## are copies of one estimator, each tuned alike, called different? ten minutes; keeps its report
	$(BIN)/python benchmarks/statistics/tuned_alike.py reports/tuned-alike.md

oddities: $(VENV)/.ready  ## and one with unusual habits? keeps its report after every seed
	$(BIN)/python benchmarks/statistics/oddities.py reports/oddities.md 20

truth: $(VENV)/.ready  ## what was tried to get past the checks, what caught it, what is known to pass; keeps its report
	$(BIN)/python benchmarks/statistics/truth.py reports/truth.md

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

peers: $(VENV)/.ready  ## other people's filters as plug-ins: glue, agreement, checks, error, cost; keeps its report
	$(BIN)/python benchmarks/peers/table.py reports/peers.md

lock:  ## pin what is new and keep the other pins, or pin everything again: make lock UPGRADE=--upgrade (needs uv)
	uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --no-emit-find-links --no-header $(UPGRADE) --output-file requirements.lock
	uv pip compile pyproject.toml --extra docs --universal --python-version 3.11 --generate-hashes -c requirements.lock \
	  --no-emit-index-url --no-emit-find-links --no-header $(UPGRADE) --output-file docs/requirements.lock

clean:
	rm -rf $(VENV) .venv-docs build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache
