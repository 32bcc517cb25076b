// The paper's figure 5: a glass cube, which reflects and refracts.
//
// Declare=Texels=128    texels of each face along U and V
// Declare=Directions=16 directions of each face along S and T (the paper's: 4, 16, 32, 64)
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 12 adc_bailout 0.003 }
#include "slf.inc"

#ifndef (Texels) #declare Texels = 128; #end
#ifndef (Directions) #declare Directions = 16; #end

// The room: x -5..5, y 0..4, z -5..5, a table top at its floor.
#declare Half = 5;
#declare Height = 4;

// ---- Light ---------------------------------------------------------------------------------------
light_source { <-2.4, 3.6, -2.2> color rgb <1.0, 0.95, 0.86>*0.85 fade_distance 6 fade_power 1 }
light_source { <3.2, 3.0, 1.8> color rgb <0.7, 0.82, 1.0>*0.4 fade_distance 6 fade_power 1 }

#declare Matte = finish { ambient 0.2 diffuse 0.75 }

// ---- Room ----------------------------------------------------------------------------------------
plane { y, 0
  pigment { hexagon rgb <0.82, 0.74, 0.60>, rgb <0.50, 0.24, 0.16>, rgb <0.22, 0.26, 0.34> scale 0.45 }
  finish { Matte } }
plane { -y, -Height pigment { rgb <0.86, 0.87, 0.88> } finish { Matte } }
plane { -z, -Half
  pigment { gradient x color_map {
    [0 rgb <0.16, 0.30, 0.46>] [0.46 rgb <0.16, 0.30, 0.46>] [0.48 rgb <0.92, 0.88, 0.78>]
    [0.98 rgb <0.92, 0.88, 0.78>] [1 rgb <0.16, 0.30, 0.46>] } }
  finish { Matte } }
plane { z, -Half
  pigment { gradient y color_map {
    [0 rgb <0.60, 0.18, 0.14>] [0.46 rgb <0.60, 0.18, 0.14>] [0.5 rgb <0.92, 0.82, 0.62>]
    [0.96 rgb <0.92, 0.82, 0.62>] [1 rgb <0.60, 0.18, 0.14>] } }
  finish { Matte } }
plane { -x, -Half
  pigment { checker rgb <0.90, 0.72, 0.24>, rgb <0.93, 0.90, 0.84> scale 1 translate 0.5*x }
  finish { Matte } }
plane { x, -Half
  pigment { checker rgb <0.26, 0.46, 0.28>, rgb <0.90, 0.92, 0.84> scale 1 translate 0.5*x }
  finish { Matte } }

// ---- Cube: it hovers a little above the table, so that nothing touches ------------------------------
#declare Turn = 28*y;
#declare Low = <-0.8, 0.02, -0.8>;
#declare High = <0.8, 1.62, 0.8>;
box { Low, High rotate Turn
  pigment { rgbf <0.96, 1.0, 0.98, 0.97> }
  finish { ambient 0 diffuse 0.02 specular 0.5 roughness 0.005 reflection { 0 1 fresnel on } conserve_energy }
  interior { ior 1.5 } }

// ---- Company for the cube --------------------------------------------------------------------------
#declare Ball_Centre = <1.7, 0.5, 1.3>;
#declare Ball_Radius = 0.5;
sphere { Ball_Centre, Ball_Radius
  pigment { gradient y color_map { [0.5 rgb <0.88, 0.24, 0.18>] [0.5 rgb <0.96, 0.92, 0.84>] } scale 0.25 }
  finish { Matte } }
#declare Block_Low = <-2.3, 0, 0.4>;
#declare Block_High = <-1.6, 1.1, 1.1>;
box { Block_Low, Block_High pigment { rgb <0.24, 0.42, 0.62> } finish { Matte } }

camera { perspective location <1.2, 2.2, -3.9> right x*4/3 up y angle 48 look_at <0, 0.75, 0> }

// ---- Surfaces ----------------------------------------------------------------------------------------
// A face of the cube, from a corner and its edges before the turn.
#macro Face(Name, Corner, Edge_U, Edge_V, Thickness)
  Slf_Quad(Name, vrotate(Corner, Turn), vrotate(Edge_U, Turn), vrotate(Edge_V, Turn), <Texels, Texels>, <Directions, Directions>)
  Slf_Slab(Name, Thickness, 1.5)
#end
#declare E = High - Low;
Face("cube_near", <High.x, Low.y, Low.z>, -E.x*x, E.y*y, E.z)
Face("cube_far", <Low.x, Low.y, High.z>, E.x*x, E.y*y, E.z)
Face("cube_left", Low, E.z*z, E.y*y, E.x)
Face("cube_right", <High.x, Low.y, High.z>, -E.z*z, E.y*y, E.x)
Face("cube_top", <Low.x, High.y, Low.z>, E.z*z, E.x*x, E.y)

Slf_Quad("floor", <-Half, 0, -Half>, 2*Half*z, 2*Half*x, <640, 640>, Slf_Matte)
Slf_Quad("ceiling", <-Half, Height, -Half>, 2*Half*x, 2*Half*z, <64, 64>, Slf_Matte)
Slf_Quad("far", <Half, 0, Half>, -2*Half*x, Height*y, <384, 160>, Slf_Matte)
Slf_Quad("near", <-Half, 0, -Half>, 2*Half*x, Height*y, <384, 160>, Slf_Matte)
Slf_Quad("right", <Half, 0, -Half>, 2*Half*z, Height*y, <384, 160>, Slf_Matte)
Slf_Quad("left", <-Half, 0, Half>, -2*Half*z, Height*y, <384, 160>, Slf_Matte)
Slf_Sphere("ball", Ball_Centre, Ball_Radius, <128, 128>, Slf_Matte)
Slf_Box("block", Block_Low, Block_High, <64, 64>, Slf_Matte)
