// The smallest scene with a shiny surface, a curved one and a matte one, for tests that bake often.
#version 3.7;
global_settings { assumed_gamma 1.0 }
#include "slf.inc"
#ifndef (Glow) #declare Glow = 1; #end
plane { y, 0 pigment { rgb 0.1 } finish { reflection 0.7 diffuse 0.1 ambient 0 } }
sphere { <0, 1, 0>, 0.6 pigment { checker rgb <0.9, 0.3, 0.2>, rgb 0.9 scale 0.3 } finish { ambient 0.5*Glow diffuse 0.5 } }
plane { -z, -2 pigment { gradient x color_map { [0 rgb <0.2, 0.4, 0.7>] [1 rgb 0.9] } scale 0.5 } finish { ambient Glow } }
light_source { <2, 4, -3> rgb 0.5 }
camera { location <0, 2, -5> look_at <0, 0.5, 0> }

Slf_Quad("floor", <-2, 0, -2>, 4*z, 4*x, <16, 16>, <4, 4>)
Slf_Sphere("ball", <0, 1, 0>, 0.6, <16, 16>, Slf_Matte)
#ifdef (Hdr) Slf_Hdr("floor") #end
Slf_Quad("wall", <2, 0, 2>, -4*x, 3*y, <24, 16>, Slf_Matte)
