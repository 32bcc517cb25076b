// Surfaces whose radiance has a closed form. Declare=Mirror=0: radiance is the place, P Scale + 1/2,
// less its whole part. Declare=Mirror=1: perfect mirrors that reflect nothing but a sky whose
// radiance is its direction, R Scale + 1/2, less its whole part.
#version 3.7;
global_settings { assumed_gamma 1.0 }
#include "slf.inc"

#ifndef (Mirror) #declare Mirror = 0; #end

#ifndef (Scale) #declare Scale = 1; #end

#macro Coded()
  pigment { average pigment_map {
    [1 function { x*Scale + 0.5 } color_map { [0 rgb 0] [1 rgb 3*x] }]
    [1 function { y*Scale + 0.5 } color_map { [0 rgb 0] [1 rgb 3*y] }]
    [1 function { z*Scale + 0.5 } color_map { [0 rgb 0] [1 rgb 3*z] }] } }
#end

#if (Mirror)
  sky_sphere { Coded() }
  #declare Skin = texture { pigment { rgb 0 } finish { ambient 0 diffuse 0 reflection 1 } }
#else
  #declare Skin = texture { Coded() finish { ambient 1 diffuse 0 } }
#end

// A parallelogram that is neither level nor square, and the same place as any P(U,V). Nothing may cut
// another surface: rays start 0.001 before it.
#declare Corner = <-4, 0.5, -1>;
#declare Edge_U = <2, 0.3, 0.1>;
#declare Edge_V = <0.4, -0.2, 1.5>;
plane { vnormalize(vcross(Edge_U, Edge_V)), vdot(Corner, vnormalize(vcross(Edge_U, Edge_V)))
  clipped_by { sphere { Corner + (Edge_U + Edge_V)/2, 2 } }
  texture { Skin } no_reflection }
Slf_Quad("quad", Corner, Edge_U, Edge_V, <16, 16>, <8, 8>)
#macro Slf_Point(U, V) (Corner + U*Edge_U + V*Edge_V) #end
Slf_Parametric("same", 0, 0, <16, 16>, <8, 8>)

sphere { <2, 1, 1>, 0.9 texture { Skin } no_reflection }
Slf_Sphere("ball", <2, 1, 1>, 0.9, <16, 16>, <8, 8>)

// A wavy surface of revolution: two humps around a waist.
#declare Profile = array[12] {
  <0, 0.9>, <0.5, 0.9>, <0.8, 0.7>, <0.8, 0.4>,  <0.8, 0.1>, <0.5, 0.1>, <0.5, -0.2>, <0.6, -0.4>,
  <0.6, -0.4>, <0.7, -0.6>, <0.5, -0.9>, <0, -0.9> };
lathe { bezier_spline 12, Profile[0], Profile[1], Profile[2], Profile[3], Profile[4], Profile[5],
  Profile[6], Profile[7], Profile[8], Profile[9], Profile[10], Profile[11]
  sturm texture { Skin } no_reflection }
Slf_Lathe("wave", Profile, <16, 32>, <8, 8>)

camera { location <0, 3, -6> look_at 0 }
