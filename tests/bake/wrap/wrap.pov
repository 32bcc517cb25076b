// Objects that only trace() can parametrise: a die of CSG, a cup with holes in its side, and what
// global illumination, caches and automatic directions are tested with.
#version 3.7;
#include "slf.inc"
#ifndef (Light) #declare Light = 0; #end
global_settings { assumed_gamma 1.0
  #if (Light)
    radiosity { pretrace_start 0.08 pretrace_end 0.04 count 30 error_bound 1 recursion_limit 1 Slf_Radiosity() }
    photons { count 2000 Slf_Photons() }
  #end
}
light_source { <2, 4, -3> rgb 0.8 photons { refraction on reflection on } }
plane { y, -1 pigment { checker rgb 0.9, rgb 0.3 } finish { ambient 0.1 diffuse 0.8 } }

#declare Die = difference {
  superellipsoid { <0.3, 0.3> }
  sphere { <0, 0, -1.1>, 0.4 } sphere { <1.1, 0.4, 0.4>, 0.3 } sphere { <1.1, -0.4, -0.4>, 0.3 }
  scale 0.8
  pigment { rgb <0.9, 0.3, 0.2> } finish { ambient 0.1 diffuse 0.7 specular 0.5 roughness 0.02 } }
object { Die }
Slf_Wrap("die", Die, Slf_Wrap_Sphere, <32, 32>, Slf_Auto)

#declare Cup = difference {
  cylinder { <2.5, -1, 0>, <2.5, 0.6, 0>, 0.6 }
  cylinder { <2.5, -0.9, 0>, <2.5, 0.7, 0>, 0.55 }
  box { <2.3, -0.3, -1>, <2.7, 0.2, 1> }
  pigment { rgb <0.3, 0.5, 0.9> } finish { ambient 0.1 diffuse 0.7 } }
object { Cup }
Slf_Wrap("cup", Cup, Slf_Wrap_Cylinder, <64, 32>, Slf_Auto)

sphere { <-2, 0, 0.5>, 0.7 pigment { rgbf 0.95 } finish { reflection 0.1 specular 0.4 }
  interior { ior 1.5 } photons { target refraction on reflection on } }
Slf_Sphere("ball", <-2, 0, 0.5>, 0.7, <16, 16>, <4, 4>)
Slf_Quad("ground", <-4, -1, -3>, 6*z, 8*x, <64, 64>, Slf_Auto)
camera { location <1, 2, -5> look_at <0.3, -0.3, 0> }
