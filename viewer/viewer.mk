# The viewer. Its core needs no GL and is what the unit tests link; GLFW, EGL and OSMesa are loaded
# at run time, their headers are needed to build.
VIEWER_CORE_OBJECTS := $(addprefix $(OBJ)/viewer/,uv_mesh.o angular_level.o block_cache.o resample.o depth_mix.o \
  depth_pages.o depth_frames.o depth_kernel.o depth_kernel_avx2.o depth_kernel_flat.o \
  depth_kernel_avx2_flat.o texture.o mipmap.o \
  camera.o path.o ripple.o ripple_script.o water.o pick.o)
VIEWER_OBJECTS := $(VIEWER_CORE_OBJECTS) $(addprefix $(OBJ)/viewer/,gl_api.o context.o context_egl.o \
  context_osmesa.o checked_file.o draw.o overlay.o maps.o truth.o video.o image.o \
  window.o window_files.o window_keys.o window_overlays.o water_input.o slfview.o)

# sqrtf becomes a vector instruction when it need not set errno, a conditional division a blend when
# it need not trap. Neither changes a value.
$(addprefix $(OBJ)/viewer/,resample.o depth_mix.o texture.o water.o): PKG_CFLAGS := -fno-math-errno -fno-trapping-math
# The same source for any processor and for those with AVX2, for any surface and for flat mirrors.
DEPTH_KERNELS := $(addprefix $(OBJ)/viewer/depth_kernel,.o _avx2.o _flat.o _avx2_flat.o)
$(DEPTH_KERNELS): PKG_CFLAGS = -fno-math-errno -fno-trapping-math -Wno-psabi $(if $(findstring avx2,$@),-mavx2 -mf16c) $(if $(findstring flat,$@),-DFLAT=1)
$(DEPTH_KERNELS): viewer/depth_kernel.c $(OBJ)/flags | $(DEPS)
	$(call say,compile,$<)$(CC) $(ALL_CFLAGS) $(PKG_CFLAGS) -MMD -MP -c $< -o $@
$(OBJ)/viewer/overlay.o: PKG_CFLAGS = $(shell pkg-config --cflags stb)
$(addprefix $(OBJ)/viewer/,image.o truth.o): PKG_CFLAGS = $(shell pkg-config --cflags libpng)
$(addprefix $(OBJ)/viewer/,window.o window_files.o window_keys.o window_overlays.o): PKG_CFLAGS = $(shell pkg-config --cflags glfw3)
$(OBJ)/viewer/context_egl.o: PKG_CFLAGS = $(shell pkg-config --cflags egl)
$(OBJ)/viewer/context_osmesa.o: PKG_CFLAGS = $(shell pkg-config --cflags osmesa)

$(OUT)/slfview: $(VIEWER_OBJECTS) $(LIBSLF)
	$(call say,link,$@)$(CC) $(ALL_CFLAGS) $^ $(ALL_LDFLAGS) -lpng -ldl -lm -o $@.part && mv $@.part $@

all: $(OUT)/slfview

view: bake $(OUT)/slfview ## Open SCENE, baked first where needed
	$(OUT)/slfview build/$(NAME).slf

demo: all ## Bake a pond that stays sharp and show it; without a display, film it to build/demo
	$(MAKE) --no-print-directory bake SCENE=pond NAME=demo QUALITY=paper RAYS=9 \
	  DECLARE="Texels=256 Directions=8 Slf_Layers=8"
	@viewer/demo $(OUT)/slfview build/demo.slf

# Benches that draw.
$(addprefix $(OUT)/bench/,pond depth): $(OUT)/bench/%: $(OBJ)/tests/bench/%.o $(filter-out %/slfview.o,$(VIEWER_OBJECTS)) $(LIBSLF)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) $(ALL_CFLAGS) $^ $(ALL_LDFLAGS) -lpng -ldl -lm -o $@

# The pond's light fields, of 128 and of 256 texels: independent blocks at about 10:1, and the same
# again as layers of angular detail at 20:1 or more.
POND_BENCH := $(addprefix $(OUT)/bench/room-,128-10.slf 128-20.slf 256-10.slf 256-20.slf)
$(OUT)/bench/room-128-10.slf: ROOM = 128 32 2 72
$(OUT)/bench/room-256-10.slf: ROOM = 256 32 2 78
$(OUT)/bench/room-%-10.slf: $(OUT)/bench/room
	$(call say,make,$@)$< $(ROOM) $@ 32
$(OUT)/bench/room-%-20.slf: $(OUT)/bench/room-%-10.slf $(OUT)/slf
	$(call say,make,$@)$(OUT)/slf encode --quality=66 $< $@
$(OUT)/bench/pond.json: $(OUT)/bench/pond $(POND_BENCH)
	$(call say,measure,$@)$< $(POND_BENCH) > $@.part && mv $@.part $@

# Programs of tests/bench: they link what the unit tests link.
$(OUT)/bench/%: $(OBJ)/tests/bench/%.o $(VIEWER_CORE_OBJECTS) $(LIBSLF)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) $(ALL_CFLAGS) $^ $(ALL_LDFLAGS) -lm -o $@
# Tests of the window and of paths want a light field that needs no ray tracer, a file manager that
# drops files, and an X library that is slow.
unit-suites: $(OUT)/bench/room $(OUT)/tests/window/drop $(OUT)/tests/window/slow.so
$(OBJ)/tests/window/%.o: PKG_CFLAGS = $(shell pkg-config --cflags x11)
$(OBJ)/tests/window/drop.o $(OBJ)/tests/window/slow.o: | $(CHECK_DEPS)
$(OUT)/tests/window/drop: $(OBJ)/tests/window/drop.o
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) $(ALL_CFLAGS) $^ $(ALL_LDFLAGS) $(shell pkg-config --libs x11) -o $@
$(OUT)/tests/window/slow.so: $(OBJ)/tests/window/slow.o
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) $(ALL_CFLAGS) -shared $^ $(ALL_LDFLAGS) -ldl -o $@

.PHONY: bench-viewer
bench-viewer: all $(addprefix $(OUT)/bench/,viewer open) $(OUT)/slfview build/tests/images/compare ## Measure the viewer: build/bench/viewer.json
	@QUALITY=$(QUALITY) tests/bench/viewer.sh

.PHONY: install-viewer
install-viewer: $(OUT)/slfview
	install -d $(DESTDIR)$(PREFIX)/bin $(DESTDIR)$(PREFIX)/share/man/man1
	install -m 755 $(OUT)/slfview $(DESTDIR)$(PREFIX)/bin
	install -m 644 viewer/slfview.1 $(DESTDIR)$(PREFIX)/share/man/man1
