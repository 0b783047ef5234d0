# Every target works from a bare clone: the first one makes .venv with the pinned versions of constraints.txt.
PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3.13 || command -v python3)
BIN := .venv/bin
PIP_QUIET := --quiet --disable-pip-version-check

GLTF_VALIDATOR := gltf-validator@2.0.0-dev.3.10
SHAPED := $(addprefix tests/,avatar density evaluate flame geometry interchange regions)

.PHONY: demo test quick fuzz shapes lint bench bench-page install clean peers judges

demo: install
	$(BIN)/sacha demo --out out/demo

test: install judges test-blender
	$(BIN)/python -m pytest -n 2 --dist loadfile

quick: install
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow"

# Hostile files, for hours; what breaks a promise is kept in tests/codec/found. `make fuzz INPUTS=100000` for fewer.
INPUTS ?= 1000000
fuzz: install
	$(BIN)/python tests/codec/fuzzing.py --inputs $(INPUTS)

# The same tests of NumPy code, with every call held to the shapes and types that its annotations promise.
shapes: install
	SACHA_CHECK_SHAPES=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "not wrong_shapes" $(SHAPED)

lint: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Every bench in its quick preset, what is timed once more at the end: tables, plots and a page. For more, `sacha bench all` without --quick.
bench: install
	$(BIN)/sacha bench all --quick --repeat --out out/bench

# The same, put into the performance page.
bench-page: bench
	$(BIN)/sacha bench page out/bench --out docs/performance.md

# PlayCanvas' splat-transform, pinned, for `sacha bench codec` and `sacha export --format spz`: into .peers, with a line that tells them where
# it is. And the Khronos Group's validator of glTF, which the tests find there.
peers:
	npm install --prefix .peers --no-audit --no-fund @playcanvas/splat-transform@3.7.0 $(GLTF_VALIDATOR)
	@echo "export SACHA_SPLAT_TRANSFORM=$(CURDIR)/.peers/node_modules/.bin/splat-transform"

# The Khronos Group's validator of glTF alone, where there is an npm to fetch it; without it its tests say why they skip.
judges:
	@test -d .peers/node_modules/gltf-validator || ! command -v npm > /dev/null \
	|| npm install --prefix .peers --no-audit --no-fund $(GLTF_VALIDATOR) || echo "no validator of glTF could be fetched"

install: .venv/.installed

.venv/.installed: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "SACHA needs Python 3.11 or newer; install python3 and python3-venv"; exit 1; }
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "SACHA needs Python 3.11 or newer; name one with: make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install $(PIP_QUIET) --constraint constraints.txt --editable ".[shell,test,lint]"
	touch $@

clean:
	rm -rf .venv .peers .venv-bpy* out dist build *.egg-info

-include tools/blender.mk
