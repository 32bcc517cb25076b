// A block of glass in a striped room; Declare=Named=0: its face is not said to be one of a block.
#version 3.7;
#include "slf.inc"
#ifndef (Named) #declare Named = 1; #end
global_settings { assumed_gamma 1.0 max_trace_level 12 }
light_source { <1, 3.5, -3> rgb 0.8 }
box { <-4, 0, -4>, <4, 4, 4> hollow inverse
  pigment { gradient x+z color_map { [0.5 rgb <0.2, 0.3, 0.6>] [0.5 rgb <0.9, 0.8, 0.6>] } scale 0.7 }
  finish { ambient 0.3 diffuse 0.7 } }
box { <-2.5, 0.3, -1.2>, <2.5, 3.7, 0.3>
  pigment { rgbf 0.97 } finish { ambient 0 diffuse 0 reflection { 0 1 fresnel on } conserve_energy } interior { ior 1.5 } }
camera { location <0, 2, -3.8> right x*4/3 up y angle 60 look_at <0, 1.5, 0> }
Slf_Quad("pane", <2.5, 0.3, -1.2>, -5*x, 3.4*y, <64, 64>, Slf_Auto)
#if (Named) Slf_Slab("pane", 1.5, 1.5) #end
