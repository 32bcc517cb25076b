/* Images out and in: what is written is read, by rows, whatever compresses badly. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <unistd.h>

#include <cmocka.h>

#include "bake/image.h"

/* Exact in half floats: a number and as much noise below it as an image has, from none to all bits.
 * Some rows then deflate to exactly the size that they had. */
static float number_at(uint32_t index) {
  uint32_t noise = (index + 1) * 2654435761u;
  noise ^= noise >> 15;
  return (float)(1024 + (noise >> 8 & ((1u << index / 96 % 11) - 1))) / 4096;
}

static void rows_come_back(uint32_t width, uint32_t height) {
  char path[] = "/tmp/bake_image.XXXXXX";
  close(mkstemp(path));
  size_t count = (size_t)width * height * 3;
  float *rgb = malloc(count * sizeof *rgb), *row = malloc(width * 3 * sizeof *row);
  for (size_t i = 0; i < count; i++) rgb[i] = number_at((uint32_t)i);
  image_write(path, width, height, rgb);
  image *back = image_open(path);
  assert_int_equal(image_width(back), width);
  assert_int_equal(image_height(back), height);
  for (uint32_t i = 0; i < height; i++) {
    uint32_t y = (i * 7 + 3) % height; /* out of order */
    image_read_rows(back, "RGB", y, 1, row);
    assert_memory_equal(row, rgb + (size_t)y * width * 3, width * 3 * sizeof *row);
  }
  float *all = malloc(count * sizeof *all);
  image_read_rows(back, "RGB", 0, height, all);
  assert_memory_equal(all, rgb, count * sizeof *rgb);
  image_close(back);
  free(all);
  free(rgb);
  free(row);
  unlink(path);
}

static void noise_survives_at_any_size(void **state) {
  (void)state;
  rows_come_back(1, 1);
  rows_come_back(3, 40);
  rows_come_back(32, 3000);
  rows_come_back(257, 33);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(noise_survives_at_any_size)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
