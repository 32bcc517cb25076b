# The viewer. Its core needs no GL and is what the unit tests link; GLFW, EGL and OSMesa are loaded
# at run time, their headers are needed to build.
VIEWER_CORE_OBJECTS := $(addprefix $(OBJ)/viewer/,uv_mesh.o block_cache.o resample.o texture.o camera.o ripple.o \
  ripple_script.o water.o pick.o)
VIEWER_OBJECTS := $(VIEWER_CORE_OBJECTS) $(addprefix $(OBJ)/viewer/,gl_api.o context.o context_egl.o \
  context_osmesa.o draw.o image.o window.o slfview.o)

# sqrtf becomes one instruction, and so a vector one, when it need not set errno.
$(OBJ)/viewer/resample.o $(OBJ)/viewer/texture.o $(OBJ)/viewer/water.o: PKG_CFLAGS := -fno-math-errno
$(OBJ)/viewer/image.o: PKG_CFLAGS = $(shell pkg-config --cflags libpng)
$(OBJ)/viewer/window.o: PKG_CFLAGS = $(shell pkg-config --cflags glfw3)
$(OBJ)/viewer/context_egl.o: PKG_CFLAGS = $(shell pkg-config --cflags egl)
$(OBJ)/viewer/context_osmesa.o: PKG_CFLAGS = $(shell pkg-config --cflags osmesa)

$(OUT)/slfview: $(VIEWER_OBJECTS) $(LIBSLF)
	$(CC) $(ALL_CFLAGS) $^ $(ALL_LDFLAGS) -lpng -ldl -lm -o $@.part && mv $@.part $@

all: $(OUT)/slfview

# Programs of tests/bench: they link what the unit tests link.
$(OUT)/bench/%: $(OBJ)/tests/bench/%.o $(VIEWER_CORE_OBJECTS) $(LIBSLF)
	@mkdir -p $(@D)
	$(CC) $(ALL_CFLAGS) $^ $(ALL_LDFLAGS) -lm -o $@
