# make demo | test | test-all | lint | bench.  Everything lives in .venv and out/; nothing else is touched.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_SCENE := examples/microwave
DEMO_OUT := out/demo
APT := libgl1 libegl1 libegl-mesa0 libgl1-mesa-dri libgles2 libx11-6 libopengl0
# pymeshlab opens libGL, libOpenGL and libX11 at import; capture draws through EGL.
LIBS := libGL.so.1 libOpenGL.so.0 libX11.so.6 libEGL.so.1 libEGL_mesa.so.0
export MUJOCO_GL ?= egl

.PHONY: demo test test-all lint bench system clean

demo: $(VENV)/.installed system
	@$(BIN)/part2gs-robot build $(DEMO_SCENE) -o $(DEMO_OUT); code=$$?; \
	if [ $$code -le 1 ]; then \
	  for f in twin.xml twin.urdf report.html; do echo "$$f: $(CURDIR)/$(DEMO_OUT)/$$f"; done; \
	fi; exit $$code

test: $(VENV)/.dev system
	$(BIN)/pytest -q -m "not slow" --durations=10

test-all: $(VENV)/.dev system
	$(BIN)/pytest -q --durations=20

# mypy sees the three folders as one package through a throw-away mirror of links.
lint: $(VENV)/.dev
	$(BIN)/ruff check .
	@rm -rf .typing && mkdir -p .typing && cp -rs "$(CURDIR)/part2gs_robotics" .typing/
	@cp -rs "$(CURDIR)/exporters" "$(CURDIR)/sim_checks" .typing/part2gs_robotics/
	MYPYPATH=.typing $(BIN)/mypy -p part2gs_robotics

bench: $(VENV)/.dev system
	$(BIN)/python benchmarks/reconstruction_suite.py $(if $(KIT),--kit $(KIT))

# The C library's index of shared libraries tells what is there; ldconfig is often outside a user's PATH.
system:
	@PATH="$$PATH:/sbin:/usr/sbin"; missing=""; for l in $(LIBS); do ldconfig -p 2>/dev/null | grep -q "$$l" || missing="$$missing $$l"; done; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(APT) >/dev/null; \
	else echo "missing system libraries:$$missing. Run: sudo apt-get install -y $(APT)"; exit 2; fi

$(VENV)/bin/pip:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "part2gs-robotics needs Python 3.11 or newer; run make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/pip
	$(BIN)/pip install -q --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/bin/pip
	$(BIN)/pip install -q --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@ $(VENV)/.installed

clean:
	rm -rf $(VENV) .typing build dist out
