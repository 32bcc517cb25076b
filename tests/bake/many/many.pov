// A dozen small mirrors in a room: a chunk each, for tests of a farm.
#version 3.7;
global_settings { assumed_gamma 1.0 }
#include "slf.inc"
sky_sphere { pigment { gradient y color_map { [0 rgb <0.9, 0.8, 0.6>] [0.5 rgb <0.3, 0.5, 0.8>] [1 rgb 1] } scale 2 translate -y } }
light_source { <2, 4, -3> rgb 0.7 }
plane { y, 0 pigment { checker rgb 0.9, rgb 0.2 scale 0.5 } finish { reflection 0.5 diffuse 0.5 } }
sphere { <2, 1, 1.5>, 0.7 pigment { rgb <0.8, 0.3, 0.2> } finish { diffuse 0.8 } }
camera { location <2, 3, -5> look_at <2, 0, 1.5> }
#declare I = 0;
#while (I < 12)
  Slf_Quad(concat("tile_", str(I, 0, 0)), <mod(I, 4), 0, int(I/4)>, z, x, <24, 24>, <8, 8>)
  #declare I = I + 1;
#end
