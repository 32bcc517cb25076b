// The paper's figure 6: a box whose faces are marble, purely diffuse, with a decorative pattern that
// reflects: a composite shader. Blocks of texels that only see marble are the same from everywhere.
//
// Declare=Texels=128    texels of each face along U and V
// Declare=Directions=16 directions of each face along S and T
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 5 }
#include "slf.inc"

#ifndef (Texels) #declare Texels = 128; #end
#ifndef (Directions) #declare Directions = 16; #end

// The room: x -4..4, y 0..4, z -4..4.
#declare Half = 4;
#declare Height = 4;

// ---- Light ---------------------------------------------------------------------------------------
light_source { <-2.2, 3.6, -2.4> color rgb <1.0, 0.95, 0.88>*0.8 fade_distance 6 fade_power 1 }
light_source { <2.8, 3.2, 1.2> color rgb <0.75, 0.84, 1.0>*0.4 fade_distance 6 fade_power 1 }

#declare Matte = finish { ambient 0.2 diffuse 0.75 }

// ---- Room ----------------------------------------------------------------------------------------
plane { y, 0 pigment { checker rgb <0.74, 0.70, 0.62>, rgb <0.36, 0.40, 0.42> scale 0.8 } finish { Matte } }
plane { -y, -Height pigment { rgb <0.86, 0.86, 0.84> } finish { Matte } }
plane { -z, -Half
  pigment { gradient x color_map {
    [0 rgb <0.60, 0.20, 0.18>] [0.66 rgb <0.60, 0.20, 0.18>] [0.68 rgb <0.93, 0.86, 0.72>]
    [0.98 rgb <0.93, 0.86, 0.72>] [1 rgb <0.60, 0.20, 0.18>] } scale 0.8 }
  finish { Matte } }
plane { z, -Half
  pigment { gradient y color_map {
    [0 rgb <0.20, 0.36, 0.52>] [0.46 rgb <0.20, 0.36, 0.52>] [0.5 rgb <0.88, 0.90, 0.88>]
    [0.96 rgb <0.88, 0.90, 0.88>] [1 rgb <0.20, 0.36, 0.52>] } scale 0.8 }
  finish { Matte } }
plane { -x, -Half
  pigment { gradient z color_map {
    [0 rgb <0.88, 0.64, 0.20>] [0.46 rgb <0.88, 0.64, 0.20>] [0.5 rgb <0.93, 0.90, 0.82>]
    [0.96 rgb <0.93, 0.90, 0.82>] [1 rgb <0.88, 0.64, 0.20>] } scale 0.8 }
  finish { Matte } }
plane { x, -Half
  pigment { gradient z color_map {
    [0 rgb <0.24, 0.44, 0.30>] [0.46 rgb <0.24, 0.44, 0.30>] [0.5 rgb <0.90, 0.90, 0.80>]
    [0.96 rgb <0.90, 0.90, 0.80>] [1 rgb <0.24, 0.44, 0.30>] } scale 0.8 }
  finish { Matte } }

// ---- Box -----------------------------------------------------------------------------------------
// Veins within veins: omega, what each octave keeps of the one before, makes fine ones.
#declare Marble = texture {
  pigment { marble turbulence 0.9 octaves 8 omega 0.68 color_map {
    [0.0 rgb <0.93, 0.91, 0.87>] [0.55 rgb <0.84, 0.81, 0.76>] [0.80 rgb <0.62, 0.58, 0.55>] [1 rgb <0.34, 0.31, 0.33>] }
    scale 0.6 rotate <20, 35, 50> }
  finish { Matte } }
#declare Mirror = texture {
  pigment { rgb <0.9, 0.78, 0.5> } finish { ambient 0 diffuse 0.05 reflection { 0.82 metallic } phong 0.4 phong_size 40 metallic } }

// The inlay on a face with centred coordinates -1..1: a line along its edges, and a medallion, a star
// of eight points in a ring. Less than 0.5 is marble.
#declare Border = function(x, y) { abs(max(abs(x), abs(y)) - 0.935) - 0.025 }
#declare Medallion_Ring = function(r) { abs(r - 0.225) - 0.02 }
#declare Star = function(r, a) { r - 0.04 - 0.14*cos(4*a)*cos(4*a) }
#declare Inlay = function(x, y) {
  select(min(Border(x, y), min(Medallion_Ring(sqrt(x*x + y*y)), Star(sqrt(x*x + y*y), atan2(y, x)))), 1, 0) }

#declare Size = 1.5;
#declare Low = <-Size/2, 0, -Size/2>;
#declare High = <Size/2, Size, Size/2>;
// Which pair of faces a point is on decides the face's own coordinates.
#declare On_Box = function(x, y, z) {
  select(0.999 - abs(x), Inlay(y, z), select(0.999 - abs(y), Inlay(x, z), Inlay(x, y))) }
#declare Turn = -24*y;
box { -1, 1
  texture { function { On_Box(x, y, z) } texture_map { [0.5 Marble] [0.5 Mirror] } }
  scale Size/2 translate Size/2*y rotate Turn }

// ---- Company for the box ---------------------------------------------------------------------------
#declare Ball_Centre = <1.55, 0.45, -0.7>;
#declare Ball_Radius = 0.45;
sphere { Ball_Centre, Ball_Radius
  pigment { gradient x color_map { [0.5 rgb <0.86, 0.24, 0.18>] [0.5 rgb <0.95, 0.92, 0.86>] } scale 0.3 rotate 30*z }
  finish { Matte } }

camera { perspective location <1.3, 2.3, -3.5> right x*4/3 up y angle 52 look_at <0.1, 0.65, 0> }

// ---- Surfaces --------------------------------------------------------------------------------------
// A face of the box, from a corner and its edges before the turn.
#macro Face(Name, Corner, Edge_U, Edge_V)
  Slf_Quad(Name, vrotate(Corner, Turn), vrotate(Edge_U, Turn), vrotate(Edge_V, Turn), <Texels, Texels>, <Directions, Directions>)
#end
Face("box_near", <High.x, Low.y, Low.z>, -Size*x, Size*y)
Face("box_far", <Low.x, Low.y, High.z>, Size*x, Size*y)
Face("box_left", Low, Size*z, Size*y)
Face("box_right", <High.x, Low.y, High.z>, -Size*z, Size*y)
Face("box_top", <Low.x, High.y, Low.z>, Size*z, Size*x)

Slf_Quad("floor", <-Half, 0, -Half>, 2*Half*z, 2*Half*x, <512, 512>, Slf_Matte)
Slf_Quad("ceiling", <-Half, Height, -Half>, 2*Half*x, 2*Half*z, <64, 64>, Slf_Matte)
Slf_Quad("far", <Half, 0, Half>, -2*Half*x, Height*y, <384, 192>, Slf_Matte)
Slf_Quad("near", <-Half, 0, -Half>, 2*Half*x, Height*y, <384, 192>, Slf_Matte)
Slf_Quad("right", <Half, 0, -Half>, 2*Half*z, Height*y, <384, 192>, Slf_Matte)
Slf_Quad("left", <-Half, 0, Half>, -2*Half*z, Height*y, <384, 192>, Slf_Matte)
Slf_Sphere("ball", Ball_Centre, Ball_Radius, <128, 128>, Slf_Matte)
