/* ray_scene - writes the scene with which POV-Ray evaluates P(U,V) and its frame for some rows of
 * texels of a curved surface, at the rays' own places within each texel (pass 2 of slf.inc). */
#include <stdio.h>
#include <stdlib.h>

#include "fail.h"
#include "sample.h"
#include "surface.h"

int main(int argc, char **argv) {
  if (argc != 8) {
    fputs("usage: ray_scene FOLDER SURFACE RAYS PART SCENE.pov TEXEL_SCALE OUT.txt > PART.pov\n",
          stderr);
    return 2;
  }
  surface *self = surface_read(argv[1], argv[2]);
  uint32_t rays = (uint32_t)atoi(argv[3]);
  row_range rows = surface_ray_rows(self, rays, (uint32_t)atoi(argv[4]));
  double uv[SAMPLE_MAX_RAYS][2];
  sample_texel_offsets(rays, uv);
  printf("#version 3.7;\n#declare Slf_Pass = 2;\n#declare Slf_Output = \"%s\";\n"
         "#declare Slf_Texel_Scale = %s;\n#declare Slf_Surface = \"%s\";\n"
         "#declare Slf_Row_First = %u;\n#declare Slf_Row_Last = %u;\n"
         "#declare Slf_Offsets = array[%u] {\n",
         argv[7], argv[6], self->name, rows.first, rows.first + rows.count - 1, rays);
  for (uint32_t m = 0; m < rays; m++)
    printf("  <%.17g, %.17g>%s\n", uv[m][0], uv[m][1], m + 1 < rays ? "," : "");
  printf("}\n#include \"%s\"\n", argv[5]);
  surface_free(self);
  if (fflush(stdout) || ferror(stdout)) fail("%s: its rays' scene cannot be written", argv[5]);
  return 0;
}
