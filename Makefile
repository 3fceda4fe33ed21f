# Needs python3 (3.11 or newer) with pip, and nothing else.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
OUT ?= out
PYTEST_FLAGS ?= -n auto --dist loadfile --durations=30

.PHONY: run test smoke bench lint reference notebooks clean

# The main job on built-in data: constants, tables, a rate map and a report.
run: $(VENV)/run.installed
	$(BIN)/alsarr run -o $(OUT)

# Both precisions: double first, then JAX's default.
test: $(VENV)/test.installed
	$(BIN)/python -m pytest $(PYTEST_FLAGS)
	$(BIN)/python -m pytest $(PYTEST_FLAGS) --float32

# The golden values alone, to try another Python.
smoke: $(VENV)/test.installed
	$(BIN)/python -m pytest tests/test_quality.py tests/test_csf.py tests/alsarr/test_alsarr_greedy.py

# Times, never a test: on a machine that has nothing else to do.
bench: $(VENV)/bench.installed
	$(BIN)/camojab bench -o $(OUT)/bench
	$(BIN)/python tests/benchmarks/bench_fit.py
	$(BIN)/python -m pytest tests/benchmarks/bench_model.py -p no:xdist
	$(BIN)/python tests/benchmarks/bench_tables.py
	$(BIN)/python tests/benchmarks/bench_control.py
	$(BIN)/python tests/benchmarks/bench_sequences.py
	$(BIN)/python tests/benchmarks/bench_capture.py
	$(BIN)/python tests/benchmarks/bench_metrics.py
	$(BIN)/python tests/benchmarks/bench_network.py
	$(BIN)/python tests/benchmarks/bench_explore.py

lint: $(VENV)/dev.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

# The page of every public name, from the docstrings.
reference: $(VENV)/notebooks.installed
	$(BIN)/python notebooks/reference.py

# What the notebooks store, of the built-in data.
notebooks: $(VENV)/test.installed
	$(BIN)/python notebooks/execute.py

$(VENV)/%.installed: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.$(if $(filter-out run,$*),[$*])'
	touch $@

clean:
	rm -rf $(VENV) $(OUT) dist
