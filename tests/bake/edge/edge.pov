// A mirror of 4 x 4 units under a plate at 1 unit that ends at x = Edge, in a room of 8 units' height. Straight up,
// each texel sees of the plate as much as lies under it. The room's colour changes at x = Border,
// the mirror's own at x = Own.
#version 3.7;
#include "slf.inc"
#ifndef (Edge) #declare Edge = 0.1; #end
#ifndef (Border) #declare Border = 9; #end
#ifndef (Own) #declare Own = 9; #end
#ifndef (Bent) #declare Bent = 0; #end
global_settings { assumed_gamma 1.0 }
#declare Even = texture { pigment { rgb 0.5 } finish { ambient 1 diffuse 0 } }
#declare Halves = texture {
  pigment { gradient x color_map { [0.5 rgb 0.5] [0.5 rgb 0.1] } scale 18 translate (Border - 9)*x }
  finish { ambient 1 diffuse 0 }
}
box { <-9, -1, -9>, <9, 8, 9> hollow inverse texture { Halves } }
box { <-9, 1, -9>, <Edge, 1.1, 9> texture { Even } }
#declare Mirror = texture {
  pigment { gradient x color_map { [0.5 rgb 0.1] [0.5 rgb 0.6] } scale 18 translate (Own - 9)*x }
  finish { ambient 0.5 diffuse 0.2 reflection 0.8 }
}
#declare Slf_Layers = 2;
#if (Bent) // as flat, but said to be curved: rays come from a table
  box { <-2, -0.1, -2>, <2, 0, 2> texture { Mirror } }
  #macro Slf_Point(U, V) (<-2 + 4*V, 0, -2 + 4*U>) #end
  Slf_Parametric("mirror", 0, 0, <16, 16>, <3, 3>)
#else
  box { <-2, -0.1, -2>, <2, 0, 2> texture { Mirror } }
  Slf_Quad("mirror", <-2, 0, -2>, 4*z, 4*x, <16, 16>, <3, 3>)
#end
camera { location <0, 0.5, -1.8> right x*4/3 up y angle 80 look_at <0, 0.8, 0.5> }
