# slf: surface light fields, baked by POV-Ray, played back lazily.
# `make help` lists the goals. Each part brings its own rules: codec/codec.mk and so on.

SHELL := bash
MAKEFLAGS += --no-builtin-rules
.DELETE_ON_ERROR:
.SUFFIXES:
.DEFAULT_GOAL := all

SCENE ?= floor
QUALITY ?= preview
FARM ?= local
CONFIG ?= release
PREFIX ?= /usr/local
JOBS ?= $(shell nproc)
ifeq ($(MAKELEVEL),0)
MAKEFLAGS += --jobs=$(JOBS)
endif
CC := $(if $(filter default,$(origin CC)),gcc,$(CC))

# A sanitized or debug build lives beside the release build and shares nothing with it.
OUT := $(if $(filter release,$(CONFIG)),build,build/$(CONFIG))
OBJ := $(OUT)/obj
.PRECIOUS: $(OBJ)/%.o

CFLAGS ?=
ifneq ($(filter release debug asan,$(CONFIG)),$(CONFIG))
$(error CONFIG=$(CONFIG): expected release, debug or asan)
endif
CONFIG_CFLAGS.release := -O3 -DNDEBUG
CONFIG_CFLAGS.debug := -O0 -g
CONFIG_CFLAGS.asan := -O1 -g1 -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=all
CONFIG_LDFLAGS.asan := -fsanitize=address,undefined
# No contraction: a fused multiply-add would make the plain C differ between processors.
ALL_CFLAGS = -std=c11 -D_GNU_SOURCE -Wall -Wextra -Werror -Wshadow -Wstrict-prototypes -Wvla -fPIC -fvisibility=hidden \
  -ffp-contract=off -pthread $(CONFIG_CFLAGS.$(CONFIG)) -I. -Icodec $(CFLAGS)
ALL_LDFLAGS = -pthread $(CONFIG_LDFLAGS.$(CONFIG)) $(LDFLAGS)

# What the project needs of the system: programs, pkg-config modules, and the Debian packages that
# hold them. Installed where apt is at hand, named where it is not. DEPS is for building, baking and
# viewing; CHECK_DEPS is what the tests need on top.
DEPS := build/deps/build
CHECK_DEPS := build/deps/check
NEED.build.programs := gcc pkg-config povray ffmpeg
NEED.build.modules := OpenEXR libpng libjpeg glfw3 osmesa egl gl stb
NEED.build.packages := gcc libc6-dev pkg-config povray povray-includes libopenexr-dev libpng-dev \
  libjpeg-dev libglfw3-dev libosmesa6-dev libegl-dev libgl-dev libegl1 libgl1-mesa-dri libstb-dev ffmpeg
NEED.check.programs := jq python3 clang clang-format idiff oiiotool xvfb-run xdotool import
NEED.check.modules := cmocka x11
NEED.check.packages := jq python3 python3-venv clang clang-format libclang-rt-14-dev openimageio-tools xvfb xauth xdotool \
  imagemagick libcmocka-dev libx11-dev

# What a scene of ours needs on top, once somebody bakes it.
NEED.chess.files := /usr/share/doc/povray/examples/advanced/chess2.pov
NEED.chess.packages := povray-examples

build/deps/%: | build/deps/
	@missing() { for p in $(NEED.$*.programs); do command -v $$p >/dev/null || echo $$p; done; \
	    for f in $(NEED.$*.files); do [ -e $$f ] || echo $$f; done; \
	    for m in $(NEED.$*.modules); do pkg-config --exists $$m 2>/dev/null || echo $$m; done; }; \
	  if [ -n "$$(missing)" ]; then \
	    if ! command -v apt-get >/dev/null; then \
	      echo "slf: missing:" $$(missing)". Please install what Debian calls: $(NEED.$*.packages)" >&2; exit 1; fi; \
	    sudo=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	    echo "slf: missing:" $$(missing); echo "slf: installing $(NEED.$*.packages)"; \
	    $$sudo apt-get -qq update && DEBIAN_FRONTEND=noninteractive $$sudo apt-get install -qq -y \
	      --no-install-recommends $(NEED.$*.packages) > build/deps/$*.log 2>&1 || \
	      { tail -n 5 build/deps/$*.log >&2; exit 1; }; \
	    [ -z "$$(missing)" ] || { echo "slf: still missing:" $$(missing) >&2; exit 1; }; fi
	@touch $@
$(CHECK_DEPS): | $(DEPS)
build/deps/:
	@mkdir -p $@

.PHONY: all help demo check bake view bench report install clean clean-bake

all: ## Build libslf, slf, slfview and the bake's programs
help: ## Show the goals
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  \1\t\2/' | expand -t 18
	@echo
	@echo "  SCENE=$(SCENE) QUALITY=$(QUALITY) (preview, paper) FARM=$(FARM) CONFIG=$(CONFIG) (release, debug, asan)"
	@echo "  scenes: $(notdir $(wildcard scenes/*))"

# Commands are shown with V=1, else what they make.
say = $(if $(V),,@printf '%8s  %s\n' $(1) $(2) && )

# Objects are made again when the flags change.
$(OBJ)/flags: FORCE
	@mkdir -p $(@D)
	@echo '$(CC) $(ALL_CFLAGS)' | cmp -s - $@ || echo '$(CC) $(ALL_CFLAGS)' > $@
.PHONY: FORCE
FORCE:

$(OBJ)/%.o: %.c $(OBJ)/flags | $(DEPS)
	@mkdir -p $(@D)
	$(call say,compile,$<)$(CC) $(ALL_CFLAGS) $(PKG_CFLAGS) -MMD -MP -c $< -o $@

include codec/codec.mk
include bake/bake.mk
include viewer/viewer.mk
include tests/tests.mk
-include $(shell find $(OBJ) -name '*.d' 2>/dev/null)

install: install-codec install-viewer install-bake ## Install under DESTDIR PREFIX: libslf, slf, slfview, slf.inc, man pages

clean: ## Remove everything built, bakes too
	rm -rf build
clean-bake: ## Remove what was baked for SCENE
	rm -rf build/bake/$(SCENE) build/$(SCENE).slf
