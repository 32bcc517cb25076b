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

# libFuzzer's targets: the library and one tests/fuzz/NAME.c, by clang, sanitized.
FUZZ_TARGETS := open blocks round_trip
FUZZ_SECONDS ?= 60
FUZZ_CFLAGS := -std=c11 -D_GNU_SOURCE -O1 -g -ffp-contract=off -pthread -I. \
  -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all
FUZZ_SOURCES := $(filter-out codec/slf_command.c codec/image.c codec/command_%,$(wildcard codec/*.c))

.PHONY: fuzz fuzz-targets
fuzz-targets: $(FUZZ_TARGETS:%=build/fuzz/%)
build/fuzz/%: tests/fuzz/%.c $(FUZZ_SOURCES) $(wildcard codec/*.h) | $(CHECK_DEPS)
	@mkdir -p $(@D)
	clang $(FUZZ_CFLAGS) $< $(FUZZ_SOURCES) -lm -o $@
fuzz: fuzz-targets ## Fuzz each target for FUZZ_SECONDS
	@for t in $(FUZZ_TARGETS); do mkdir -p build/fuzz/$$t.new; \
	  build/fuzz/$$t -max_total_time=$(FUZZ_SECONDS) -max_len=8192 -timeout=20 -rss_limit_mb=4096 \
	    -artifact_prefix=build/fuzz/$$t- build/fuzz/$$t.new tests/fuzz/corpus/$$t || exit 1; done
