# POV-Ray scene -> .slf. `make bake` writes down what was asked for and calls make again with
# BAKE=NAME; from there on the folder build/bake/NAME says everything, so that any node of a cluster
# can make any of its goals.
#
#   build/bake/NAME/options.mk   scene's folder, numbers, texel scale, rays
#   build/bake/NAME/scene.txt    the surfaces, as POV-Ray describes them
#   build/bake/NAME/look         the scene without comments and the lines that only name surfaces
#   build/bake/NAME/light.*      caches of its radiosity and photons (if it has Slf_Radiosity, Slf_Photons)
#   build/bake/NAME/surfaces.mk  what each surface needs, as rules; chunks.mk: the chunks
#   build/bake/NAME/SURFACE/     surface.txt, rays (if curved), cover, choice (if auto), cost (if not matte), and
#                                the chunks 0000.exr ...: a few slices each, one below the other
#   build/NAME.slf
#
# Files that others depend on (surface.txt, rays, cover, choice, look) keep their time when they come out the
# same: only what changed is baked again.

BAKE_PROGRAMS := $(addprefix $(OUT)/bake/,plan camera ray_scene ray_table find_cover choose match gather layers pack progress)
BAKE_OBJECTS := $(addprefix $(OBJ)/bake/,surface.o frame.o texel_frame.o cover.o probe.o fog.o outline.o sample.o image.o fail.o)
$(OBJ)/bake/%.o: PKG_CFLAGS = $(shell pkg-config --cflags OpenEXR)

all: $(BAKE_PROGRAMS)
$(BAKE_PROGRAMS): $(OUT)/bake/%: $(OBJ)/bake/%.o $(BAKE_OBJECTS) $(LIBSLF)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) $^ -o $@ $(ALL_LDFLAGS) $(filter -L% -lOpenEXRCore%,$(shell pkg-config --libs OpenEXR)) -lm

# NAME may be an environment variable of somebody else's.
NAME := $(if $(filter command line,$(origin NAME)),$(NAME),$(SCENE))
DECLARE ?=
# The folder of scenes.
SCENES ?= scenes
RAYS ?= $(if $(filter paper,$(QUALITY)),25,9)
TEXEL_SCALE = $(if $(filter paper,$(QUALITY)),1,0.5)
# More POV-Rays than processors hide the quarter second that each spends waiting for its front end.
BAKE_JOBS = $(shell echo $$(($(JOBS) + 1)))

bake: $(BAKE_PROGRAMS) $(if $(filter scenes,$(SCENES)),$(NEED.$(SCENE).packages:%=build/deps/$(SCENE))) ## Bake SCENE (NAME=, DECLARE="X=1 Y=2", QUALITY=, RAYS=, FARM=) to build/NAME.slf
	@[ -f '$(SCENES)/$(SCENE)/$(SCENE).pov' ] || { echo "slf: no scene '$(SCENE)': expected one of" \
	  $(notdir $(wildcard $(SCENES)/*)) >&2; exit 1; }
	@case '$(QUALITY)' in preview|paper) ;; *) echo "slf: QUALITY=$(QUALITY): expected preview or paper" >&2; exit 1;; esac
	@case '$(RAYS)' in 1|9|25|49|121) ;; *) echo "slf: RAYS=$(RAYS): expected 1, 9, 25, 49 or 121" >&2; exit 1;; esac
	@[ ! -f 'build/bake/$(NAME)' ] || { echo "slf: NAME=$(NAME): is a program of the bake: another NAME, please" >&2; exit 1; }
	@mkdir -p 'build/bake/$(NAME)'
	@printf 'BAKE_SCENE := %s\nBAKE_DECLARE := %s\nBAKE_SCALE := %s\nBAKE_RAYS := %s\n' '$(SCENES)/$(SCENE)' \
	  '$(DECLARE)' '$(TEXEL_SCALE)' '$(RAYS)' > 'build/bake/$(NAME)/options.part'
	@cd 'build/bake/$(NAME)' && { cmp -s options.part options.mk || mv options.part options.mk; }
	@rm -f 'build/bake/$(NAME)/options.part'
	@bake/sweep 'build/bake/$(NAME)/tmp'
	@MAKEFLAGS= $(MAKE) --no-print-directory CONFIG=$(CONFIG) -j$(BAKE_JOBS) BAKE='$(NAME)' \
	  $(if $(filter local,$(FARM)),,bake-ready && MAKEFLAGS= bake/farm '$(FARM)' '$(NAME)' && MAKEFLAGS= $(MAKE) \
	  --no-print-directory CONFIG=$(CONFIG) -j$(BAKE_JOBS) BAKE='$(NAME)') 'build/$(NAME).slf'

ifdef BAKE
BAKE_DIR := build/bake/$(BAKE)
include $(BAKE_DIR)/options.mk
BAKE_BIN := $(OUT)/bake
export BAKE_LIGHT BAKE_DIR BAKE_SCENE BAKE_DECLARE BAKE_SCALE BAKE_RAYS BAKE_BIN
# Sorted: a folder's own order differs between file systems, and look holds them in this one.
BAKE_FILES := $(sort $(shell find $(BAKE_SCENE) -type f ! -name views))
BAKE_TEXTS := $(filter %.pov %.inc,$(BAKE_FILES))
BAKE_OTHERS := $(filter-out $(BAKE_TEXTS),$(BAKE_FILES))

$(BAKE_DIR)/scene.txt: $(BAKE_FILES) $(BAKE_DIR)/options.mk bake/slf.inc
	@bake/trace describe $@

$(BAKE_DIR)/surfaces.mk: $(BAKE_DIR)/scene.txt bake/surface.c
	@$(BAKE_BIN)/plan surfaces $(BAKE_DIR) $(BAKE_RAYS) > $@.part && mv $@.part $@
include $(BAKE_DIR)/surfaces.mk

# make begins again once surfaces.mk is made; only then it knows the choices.
$(BAKE_DIR)/chunks.mk: $(BAKE_DIR)/surfaces.mk $(CHOICES)
	@$(BAKE_BIN)/plan chunks $(BAKE_DIR) $(BAKE_RAYS) > $@.part && mv $@.part $@
include $(BAKE_DIR)/chunks.mk

# $1.made is made again when something before it changed; $1 itself only takes a new time when it
# comes out different.
define keep_if_same
@cmp -s $(1).part $(1) || mv $(1).part $(1)
@rm -f $(1).part; touch $(1).made
endef
$(RAY_TABLES) $(COVERS) $(CHOICES) $(BAKE_DIR)/look: %: %.made
	@:

# Comments and blanks go from lines without quotes only, where they cannot be text.
$(BAKE_DIR)/look.made: $(BAKE_FILES) $(BAKE_DIR)/options.mk
	@{ cat $(BAKE_DIR)/options.mk; export LC_ALL=C; sed -E \
	  -e '/^[[:space:]]*Slf_(Quad|Box|Sphere|Lathe|Parametric|Wrap|Water|Slab|Hdr|Background)[[:space:]]*\([^#;]*\)[[:space:]]*(\/\/.*)?$$/d' \
	  -e '/"/!{s|//.*||; s/[[:space:]]+/ /g; s/^ | $$//g; /^$$/d}' $(BAKE_TEXTS); \
	  $(if $(BAKE_OTHERS),cksum $(BAKE_OTHERS);) } > $(BAKE_DIR)/look.part
	$(call keep_if_same,$(BAKE_DIR)/look)

# Radiosity and photons, computed once. Whatever sees the scene reads them.
LIGHT := $(if $(BAKE_LIGHT),$(BAKE_DIR)/light.made)
$(LIGHT): $(BAKE_DIR)/look $(COVERS:%cover=%surface.txt) bake/camera.c bake/sample.c bake/frame.c bake/texel_frame.c | $(RAY_TABLES) $(COVERS)
	@bake/trace light '$(notdir $(patsubst %/,%,$(dir $(COVERS))))' $@

$(RAY_PARTS): $(BAKE_DIR)/scene.txt bake/sample.c
	@bake/trace rays $(notdir $(@D)) $(subst .,,$(suffix $@)) $@
$(addsuffix .made,$(RAY_TABLES)):
	@cat $^ > $(@D)/rays.part
	$(call keep_if_same,$(@D)/rays)
$(addsuffix .made,$(COVERS)): $(BAKE_DIR)/look bake/camera.c bake/sample.c bake/frame.c bake/texel_frame.c
	@bake/trace cover $(notdir $(@D)) $(@D)/cover.part
	$(call keep_if_same,$(@D)/cover)
$(addsuffix .made,$(CHOICES)): $(LIGHT) $(BAKE_DIR)/look $(addprefix bake/,camera.c frame.c texel_frame.c sample.c probe.c choose.c match.c fog.c)
	@bake/trace choice $(notdir $(@D)) $(@D)/choice.part
	$(call keep_if_same,$(@D)/choice)

$(COSTS): $(BAKE_DIR)/look | $(LIGHT) $(RAY_TABLES)
	@bake/trace cost $(notdir $(@D)) $@

$(CHUNKS): $(LIGHT) $(BAKE_DIR)/look $(addprefix bake/,camera.c frame.c texel_frame.c surface.c cover.c sample.c layers.c fog.c outline.c image.c) | bake-begins
	$(if $(BAKE_LIST),$(info $@),@bake/trace chunk $(notdir $(@D)) $(basename $(notdir $@)) $@)
	$(if $(BAKE_LIST)$(FARM_TASK),,@$(BAKE_BIN)/progress report $(BAKE_DIR) $(BAKE_RAYS))
.PHONY: bake-begins bake-ready bake-chunks
# BAKE_LIST=1 names the chunks that are missing or stale instead of baking them. (make -n cannot: it
# takes a file that would keep its time for a new one.) FARM_TASK=1 is one of a farm's tasks: the farm
# says how far all of them are.
bake-chunks: $(CHUNKS)
# All that chunks need, made here before a farm makes those.
bake-ready: $(BAKE_DIR)/chunks.mk $(BAKE_DIR)/look $(RAY_TABLES) $(COVERS) $(CHOICES) $(LIGHT) $(COSTS)
bake-begins: | $(BAKE_DIR)/look $(RAY_TABLES) $(COVERS) $(LIGHT) $(COSTS)
	$(if $(BAKE_LIST)$(FARM_TASK),,@$(BAKE_BIN)/progress begin $(BAKE_DIR) $(BAKE_RAYS))

build/$(BAKE).slf: $(BAKE_BIN)/pack $(BAKE_DIR)/chunks.mk $(CHUNKS) $(wildcard $(BAKE_SCENE)/views)
	@$(BAKE_BIN)/pack $(BAKE_DIR) $(BAKE_RAYS) $(wildcard $(BAKE_SCENE)/views) $@
endif

# Checkers that shell suites run on what they baked.
BAKE_CHECKERS := $(OUT)/tests/bake/exact
$(BAKE_CHECKERS): $(OUT)/tests/bake/%: $(OBJ)/tests/bake/%.o $(BAKE_OBJECTS) $(LIBSLF)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) $^ -o $@ $(ALL_LDFLAGS) $(filter -L% -lOpenEXRCore%,$(shell pkg-config --libs OpenEXR)) -lm
unit-suites: $(BAKE_CHECKERS)
$(OUT)/tests/unit/bake_sample: $(OBJ)/bake/sample.o
$(OUT)/tests/unit/bake_image: $(addprefix $(OBJ)/bake/,image.o fail.o)

.PHONY: install-bake
install-bake:
	install -d $(DESTDIR)$(PREFIX)/share/slf
	install -m 644 bake/slf.inc $(DESTDIR)$(PREFIX)/share/slf
