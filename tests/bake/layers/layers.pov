// What is worth baking as layers, and what is not, in a striped room. Declare=Light=1: lit by radiosity and
// with a caustic; Declare=Directions=8: of the mirrors, else chosen; Far=4, Bent_Far=4: their layers,
// declared; Shine=0.1: what the table reflects.
#version 3.7;
#include "slf.inc"
#ifndef (Light) #declare Light = 0; #end
#ifndef (Shine) #declare Shine = 0; #end
#ifndef (Directions) #declare Directions = 0; #end
global_settings { assumed_gamma 1.0
  #if (Light)
    radiosity { pretrace_start 0.08 pretrace_end 0.04 count 30 error_bound 1 recursion_limit 1 Slf_Radiosity() }
    photons { count 4000 Slf_Photons() }
  #end
}
light_source { <1, 3.5, -1> rgb 0.8 photons { refraction on reflection on } }
#declare Matte = finish { ambient (Light ? 0 : 0.3) diffuse 0.7 }
box { <-4, 0, -4>, <4, 4, 4> hollow inverse
  pigment { gradient x+z color_map { [0.5 rgb <0.2, 0.3, 0.6>] [0.5 rgb <0.9, 0.8, 0.6>] } scale 0.7 } finish { Matte } }

// A mirror for a floor, and one that bulges from the wall.
#declare Mirror = texture { pigment { rgb 0.1 } finish { ambient 0 diffuse 0.2 reflection 0.8 } }
#ifdef (Far) #declare Slf_Layers = Far; #end
plane { y, 0.02 texture { Mirror } }
Slf_Quad("mirror", <-3, 0.02, -3>, 6*z, 6*x, <64, 64>, <Directions, Directions>)
#ifdef (Bent_Far) #declare Slf_Layers = Bent_Far; #end
sphere { <1, 1.5, 7.5>, 5 texture { Mirror } }
#macro Slf_Point(U, V)
  (<1, 1.5, 7.5> + 5*<sin((0.5 - U)/2)*cos((V - 0.5)/2), sin((V - 0.5)/2), -cos((0.5 - U)/2)*cos((V - 0.5)/2)>)
#end
Slf_Parametric("mirror_bent", 0, 0, <48, 48>, <Directions, Directions>)

// A ball with a highlight; one of glass, for its caustic; a matte table under that.
sphere { <-1.8, 1.2, 1.4>, 0.7 pigment { rgb <0.8, 0.3, 0.2> } finish { Matte phong 0.6 phong_size 20 } }
Slf_Sphere("plastic", <-1.8, 1.2, 1.4>, 0.7, <16, 16>, Slf_Auto)
sphere { <0, 1.5, -1>, 0.5 pigment { rgbf 0.95 } finish { reflection 0.1 } interior { ior 1.5 }
  photons { target refraction on reflection on } }
box { <-1, 0.5, -2>, <1, 0.6, 0> pigment { checker rgb 0.9, rgb 0.3 scale 0.25 } finish { Matte reflection Shine } }
Slf_Quad("table", <-1, 0.6, -2>, 2*z, 2*x, <16, 16>, <4, 4>)
camera { location <0, 2.5, -3.8> right x*4/3 up y angle 80 look_at <0, 0.8, 0.5> }
