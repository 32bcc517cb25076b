# libslf, and the slf command.

LIBSLF := $(OUT)/libslf.a
SLF := $(OUT)/slf

LIBSLF_OBJECTS := $(addprefix $(OBJ)/codec/,block_code.o direction.o encode.o encode_codes.o \
  encode_colours.o encode_place.o encode_slices.o encode_stream.o encode_symbols.o format.o huffman.o \
  kernel.o layer.o parallel.o rate.o read.o scratch.o stream.o texels.o write.o)

# The hot path, once for any processor and on x86-64 twice more: see codec/kernel.h.
KERNEL_PARTS := find parse levels transform decode
LIBSLF_OBJECTS += $(KERNEL_PARTS:%=$(OBJ)/codec/%.o)
# Its vectors are only passed to functions that are inlined, so their calling convention is none.
$(OBJ)/codec/transform.o: PKG_CFLAGS = -Wno-psabi
ifneq ($(filter x86_64-%,$(shell $(CC) -dumpmachine)),)
LIBSLF_OBJECTS += $(KERNEL_PARTS:%=$(OBJ)/codec/%.avx2.o) $(KERNEL_PARTS:%=$(OBJ)/codec/%.avx512.o)
$(OBJ)/codec/kernel.o: PKG_CFLAGS = -DSLF_HAS_AVX2
AVX2_CFLAGS := -mavx2 -mtune=haswell -mbmi -mbmi2 -mpopcnt -mlzcnt -DSLF_KERNEL_AVX2
# To find and parse has no vectors to gain from: with these flags lone blocks take 6 % longer.
$(OBJ)/codec/levels.avx512.o $(OBJ)/codec/transform.avx512.o $(OBJ)/codec/decode.avx512.o: PKG_CFLAGS = \
  -mavx512f -mavx512bw -mavx512dq -mavx512vl -mavx512vbmi -mavx512vbmi2
# Nor from pairs of numbers that go through a vector's register to lie side by side.
NO_PAIRS := $(foreach part,find parse decode,$(foreach kernel,avx2 avx512,$(OBJ)/codec/$(part).$(kernel).o))
$(NO_PAIRS): PKG_CFLAGS += -fno-tree-slp-vectorize
$(OBJ)/codec/%.avx2.o: codec/%.c $(OBJ)/flags | $(DEPS)
	@mkdir -p $(@D)
	$(call say,compile,$<)$(CC) $(ALL_CFLAGS) $(AVX2_CFLAGS) $(PKG_CFLAGS) -MMD -MP -c $< -o $@
$(OBJ)/codec/%.avx512.o: codec/%.c $(OBJ)/flags | $(DEPS)
	@mkdir -p $(@D)
	$(call say,compile,$<)$(CC) $(ALL_CFLAGS) $(AVX2_CFLAGS) -DSLF_KERNEL_AVX512 $(PKG_CFLAGS) -MMD -MP -c $< -o $@
endif

$(LIBSLF): $(LIBSLF_OBJECTS)
	$(call say,archive,$@)rm -f $@ && $(AR) crs $@ $^

SLF_OBJECTS := $(addprefix $(OBJ)/codec/,slf_command.o jpeg_slice.o slice_image.o)
$(SLF_OBJECTS): PKG_CFLAGS = $(shell pkg-config --cflags libpng libjpeg OpenEXR)
$(SLF): $(SLF_OBJECTS) $(LIBSLF)
	$(call say,link,$@)$(CC) $(ALL_LDFLAGS) $^ $(shell pkg-config --libs libpng libjpeg) $(filter -L% -lOpenEXRCore%,$(shell pkg-config --libs OpenEXR)) -lm -o $@

# The interface's version is the soname's; the library's own is slf_version().
SOVERSION := 1
LIBSLF_VERSION := $(shell sed -n 's/^  return "\([0-9.]*\)";$$/\1/p' codec/format.c)
LIBSLF_SO := $(OUT)/libslf.so.$(LIBSLF_VERSION)
$(LIBSLF_SO): $(LIBSLF_OBJECTS)
	$(call say,link,$@)$(CC) -shared $(ALL_LDFLAGS) -Wl,-soname,libslf.so.$(SOVERSION) -Wl,--no-undefined $^ -lm -o $@

all: $(LIBSLF) $(LIBSLF_SO) $(SLF)

.PHONY: install-codec
install-codec: $(LIBSLF) $(LIBSLF_SO) $(SLF)
	install -d $(DESTDIR)$(PREFIX)/bin $(DESTDIR)$(PREFIX)/include $(DESTDIR)$(PREFIX)/lib/pkgconfig \
	  $(DESTDIR)$(PREFIX)/share/man/man1
	install -m 755 $(SLF) $(DESTDIR)$(PREFIX)/bin
	install -m 644 codec/slf.h $(DESTDIR)$(PREFIX)/include
	install -m 644 $(LIBSLF) $(DESTDIR)$(PREFIX)/lib
	install -m 755 $(LIBSLF_SO) $(DESTDIR)$(PREFIX)/lib
	ln -sf $(notdir $(LIBSLF_SO)) $(DESTDIR)$(PREFIX)/lib/libslf.so.$(SOVERSION)
	ln -sf libslf.so.$(SOVERSION) $(DESTDIR)$(PREFIX)/lib/libslf.so
	install -m 644 codec/slf.1 $(DESTDIR)$(PREFIX)/share/man/man1
	printf '%s\n' 'Name: slf' 'Description: Surface light fields, compressed in blocks' \
	  'Version: $(LIBSLF_VERSION)' 'Cflags: -I$(PREFIX)/include' 'Libs: -L$(PREFIX)/lib -lslf' \
	  'Libs.private: -lm -pthread' > $(DESTDIR)$(PREFIX)/lib/pkgconfig/slf.pc

# Its numbers go to build/bench/codec.json. The peers' codecs live in a venv of their own.
CODEC_BENCH := $(OUT)/bench/codec
$(OBJ)/tests/bench/codec.o: PKG_CFLAGS = $(shell pkg-config --cflags libjpeg OpenEXR)
$(CODEC_BENCH): $(OBJ)/tests/bench/codec.o $(OBJ)/tests/bench/synthetic.o \
  $(addprefix $(OBJ)/bake/,surface.o sample.o image.o fail.o) $(LIBSLF)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) $^ -o $@ $(ALL_LDFLAGS) $(shell pkg-config --libs libjpeg OpenEXR) -lm

NEED.peers.programs := astcenc jq python3
NEED.peers.packages := astcenc jq python3 python3-venv
PEERS_PYTHON := build/bench/venv/bin/python
$(PEERS_PYTHON): tests/bench/requirements.txt | build/deps/peers
	python3 -m venv build/bench/venv
	build/bench/venv/bin/pip -q install -r $<
	@touch $@

.PHONY: bench-codec
bench-codec: all $(CODEC_BENCH) $(PEERS_PYTHON) ## Measure the codec beside its peers: build/bench/codec.json
	@QUALITY=$(QUALITY) tests/bench/codec.sh

# libFuzzer's targets: the library, compiled once for all, and one tests/fuzz/NAME.c, by clang, sanitized.
FUZZ_TARGETS := open blocks round_trip
FUZZ_SECONDS ?= 60
FUZZ_CFLAGS := -std=c11 -D_GNU_SOURCE -O1 -gline-tables-only -ffp-contract=off -pthread -Wno-psabi -I. \
  -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all
FUZZ_SOURCES := $(filter-out codec/slf_command.c codec/slice_image.c codec/jpeg_slice.c,$(wildcard codec/*.c))

.PHONY: fuzz fuzz-targets
fuzz-targets: $(FUZZ_TARGETS:%=build/fuzz/%)
FUZZ_OBJECTS := $(FUZZ_SOURCES:%.c=build/fuzz/obj/%.o)
$(FUZZ_OBJECTS): build/fuzz/obj/%.o: %.c $(wildcard codec/*.h) | $(CHECK_DEPS)
	@mkdir -p $(@D)
	$(call say,compile,$<)clang $(subst =fuzzer,=fuzzer-no-link,$(FUZZ_CFLAGS)) -c $< -o $@
$(FUZZ_TARGETS:%=build/fuzz/%): build/fuzz/%: tests/fuzz/%.c $(FUZZ_OBJECTS) $(wildcard codec/*.h)
	$(call say,link,$@)clang $(FUZZ_CFLAGS) $< $(FUZZ_OBJECTS) -lm -o $@
fuzz: fuzz-targets ## Fuzz each target for FUZZ_SECONDS
	@for t in $(FUZZ_TARGETS); do mkdir -p build/fuzz/$$t.new; \
	  build/fuzz/$$t -max_total_time=$(FUZZ_SECONDS) -max_len=8192 -timeout=20 -rss_limit_mb=4096 \
	    -artifact_prefix=build/fuzz/$$t- build/fuzz/$$t.new tests/fuzz/corpus/$$t || exit 1; done
