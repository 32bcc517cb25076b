# libslf, and the slf command.

LIBSLF := $(OUT)/libslf.a
SLF := $(OUT)/slf

LIBSLF_OBJECTS := $(addprefix $(OBJ)/codec/,block_code.o direction.o encode.o format.o huffman.o \
  kernel.o layer.o parallel.o rate.o read.o stream.o texels.o write.o)

# The hot path, once for any processor and on x86-64 once more: see codec/kernel.h.
KERNEL_PARTS := find parse transform decode
LIBSLF_OBJECTS += $(KERNEL_PARTS:%=$(OBJ)/codec/%.o)
# Its vectors are only passed to functions that are inlined, so their calling convention is none.
$(OBJ)/codec/transform.o: PKG_CFLAGS = -Wno-psabi
ifneq ($(filter x86_64-%,$(shell $(CC) -dumpmachine)),)
LIBSLF_OBJECTS += $(KERNEL_PARTS:%=$(OBJ)/codec/%.avx2.o)
$(OBJ)/codec/kernel.o: PKG_CFLAGS = -DSLF_HAS_AVX2
$(OBJ)/codec/%.avx2.o: codec/%.c $(OBJ)/flags | $(DEPS)
	@mkdir -p $(@D)
	$(call say,compile,$<)$(CC) $(ALL_CFLAGS) -mavx2 -mtune=haswell -mbmi -mbmi2 -mpopcnt -DSLF_KERNEL_AVX2 -MMD -MP -c $< -o $@
endif

$(LIBSLF): $(LIBSLF_OBJECTS)
	$(call say,archive,$@)rm -f $@ && $(AR) crs $@ $^

$(OBJ)/codec/slf_command.o: PKG_CFLAGS = $(shell pkg-config --cflags libpng)
$(SLF): $(OBJ)/codec/slf_command.o $(LIBSLF)
	$(call say,link,$@)$(CC) $(ALL_LDFLAGS) $^ $(shell pkg-config --libs libpng) -lm -o $@

all: $(LIBSLF) $(SLF)
