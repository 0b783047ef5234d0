# Blender: `make addon` builds and validates dist/sacha-blender-VERSION.zip; `make test-blender` tests it inside each supported Blender and in a
# Blender executable; `make test-all` is `make test` with the oldest Blender as well.
.PHONY: addon test-blender test-all

# Blender 4.2 to 5.0 are built for Python 3.11, whatever the engine runs with.
BLENDER_PYTHON ?= $(shell command -v python3.11 || echo $(PYTHON))

addon:
	$(BLENDER_PYTHON) tools/blender_env.py
	$(BLENDER_PYTHON) tools/build_addon.py

test-blender: install
	$(BLENDER_PYTHON) tools/test_blender.py $(BLENDER_TESTS)
	$(BLENDER_PYTHON) tools/test_executable.py

test-all: BLENDER_TESTS = --all
test-all: test
