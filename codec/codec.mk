# libslf, and the slf command.

LIBSLF := $(OUT)/libslf.a
SLF := $(OUT)/slf

LIBSLF_OBJECTS := $(addprefix $(OBJ)/codec/,block_code.o decode.o direction.o encode.o format.o \
  huffman.o kernel.o layer.o parallel.o rate.o read.o stream.o write.o)

$(LIBSLF): $(LIBSLF_OBJECTS)
	rm -f $@ && $(AR) crs $@ $^

$(OBJ)/codec/slf_command.o: PKG_CFLAGS = $(shell pkg-config --cflags libpng)
$(SLF): $(OBJ)/codec/slf_command.o $(LIBSLF)
	$(CC) $(ALL_LDFLAGS) $^ $(shell pkg-config --libs libpng) -lm -o $@

all: $(LIBSLF) $(SLF)
