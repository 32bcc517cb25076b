# Suites print TAP: cmocka programs from tests/unit and tests/stability, built plain and sanitized,
# and the shell suites beside them. tests/run sums them up.

UNIT_SOURCES := $(wildcard tests/unit/*.c tests/stability/*.c)
UNIT_SUITES := $(UNIT_SOURCES:tests/%.c=$(OUT)/tests/%)
SHELL_SUITES := $(sort $(filter-out tests/bench/%,$(wildcard tests/*/*.sh)))
TEST_LIBS = -lcmocka $(shell pkg-config --libs libpng libjpeg OpenEXR) -lm -ldl

$(UNIT_SUITES): $(OUT)/tests/%: $(OBJ)/tests/%.o $(VIEWER_CORE_OBJECTS) $(LIBSLF) | $(CHECK_DEPS)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) -o $@ $(filter %.o %.a,$^) $(ALL_LDFLAGS) $(TEST_LIBS)
$(UNIT_SOURCES:%.c=$(OBJ)/%.o): PKG_CFLAGS = $(shell pkg-config --cflags OpenEXR libpng cmocka)
$(UNIT_SOURCES:%.c=$(OBJ)/%.o): | $(CHECK_DEPS)

# What the image suites measure with.
build/tests/images/compare: build/obj/tests/images/compare.o
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) -o $@ $^ $(ALL_LDFLAGS) $(shell pkg-config --libs libpng) -lm

# The viewer's ripples as a mesh for POV-Ray, and how far ripples move a reflection.
build/tests/pond/%: build/obj/tests/pond/%.o $(VIEWER_CORE_OBJECTS) $(LIBSLF)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) -o $@ $^ $(ALL_LDFLAGS) $(shell pkg-config --libs libpng) -lm

# Small bakes that still mean something. The dull floor takes more texels than a preview: its facets are
# noise, which four texels that are mixed average out as more rays a texel would, for less.
CHECK_BAKES := check-floor check-floor-mirror check-pond check-pond-layers check-floor-layers
.PHONY: check-bakes $(CHECK_BAKES)
check-bakes: $(CHECK_BAKES)
$(CHECK_BAKES): all
	$(MAKE) bake NAME=$@ $(OPTIONS)
check-floor: OPTIONS = SCENE=floor DECLARE=Texels=144
check-floor-mirror: OPTIONS = SCENE=floor QUALITY=paper RAYS=1 DECLARE="Mirror=1 Directions=32"
check-pond: OPTIONS = SCENE=pond RAYS=1
check-pond-layers: OPTIONS = SCENE=pond DECLARE="Texels=256 Directions=8 Slf_Layers=8"
check-floor-layers: OPTIONS = SCENE=floor DECLARE="Mirror=1 Texels=256 Directions=8 Slf_Layers=8"

.PHONY: unit-suites format
unit-suites: $(UNIT_SUITES)

# The other compiler must accept all of it too.
build/clang.ok: $(wildcard codec/*.[ch] bake/*.[ch] viewer/*.[ch] tests/*/*.[ch]) | $(CHECK_DEPS)
	$(MAKE) CC=clang CONFIG=debug all unit-suites
	@touch $@

check: all unit-suites build/clang.ok build/tests/images/compare build/tests/pond/water_mesh build/tests/pond/wiggle check-bakes | $(CHECK_DEPS) ## Run all the tests, installing what they need
	$(MAKE) CONFIG=asan all unit-suites
	@tests/run build/tap $(UNIT_SUITES) $(UNIT_SUITES:build/%=build/asan/%) $(SHELL_SUITES)

format: | $(CHECK_DEPS) ## Lay out the sources with clang-format
	clang-format -i $(wildcard codec/*.[ch] bake/*.[ch] viewer/*.[ch] tests/*/*.[ch])

include tests/bench/bakes.mk
include tests/report/report.mk

# Each part measures itself, one after another; jq puts the flat objects together.
.PHONY: bench
bench: all | $(CHECK_DEPS) ## Measure everything: build/bench.json
	$(MAKE) bench-codec
	$(MAKE) bench-viewer
	$(MAKE) build/bench/pond.json
	tests/bench/bake.sh
	tests/bench/depth.sh
	jq -s add build/bench/{codec,viewer,pond,bake,depth}.json > build/bench.json.part && mv build/bench.json.part build/bench.json
