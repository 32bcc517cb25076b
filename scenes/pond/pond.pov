// The paper's figure 7: a hall with vertical lines on its walls, a ball, and a perfectly reflecting
// floor that is the water of a pond. Nothing but the water reflects, so that its light field holds
// what ripples need (section 4).
//
// Declare=Texels=128    texels of the water along U and V
// Declare=Directions=32 directions of the water along S and T
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 4 }
#include "slf.inc"

#ifndef (Texels) #declare Texels = 128; #end
#ifndef (Directions) #declare Directions = 32; #end

// The hall: x -4..4, y 0..4, z -4..4. Water at y = 0.
#declare Half = 4;
#declare Height = 4;

// ---- Light: a lamp under the ceiling, and daylight from the windows' side ---------------------------
light_source { <0.8, 3.6, -0.6> color rgb <1.0, 0.93, 0.82>*0.75 fade_distance 5 fade_power 1 }
light_source { <-1.5, 2.6, 3.3> color rgb <0.62, 0.76, 1.0>*0.35 fade_distance 5 fade_power 1 }

#declare Plaster = finish { ambient 0.2 diffuse 0.75 }

// ---- Walls: lines, a dark skirting at the water, a frieze at the top ------------------------------
#macro Lines(Ground, Line)
  gradient x color_map { [0.00 Line] [0.10 Line] [0.12 Ground] [0.98 Ground] [1.00 Line] } scale 0.5
#end

#macro Wall(Ground, Line, Along)
  gradient y
  texture_map {
    [0.05 pigment { rgb <0.10, 0.12, 0.14> } finish { Plaster }]
    [0.05 pigment { Lines(Ground, Line) rotate Along*y scale 1/4.4 } finish { Plaster }]
    [0.82 pigment { Lines(Ground, Line) rotate Along*y scale 1/4.4 } finish { Plaster }]
    [0.82 pigment { Line } finish { Plaster }]
    [0.85 pigment { Line } finish { Plaster }]
    [0.85 pigment { Ground*1.05 } finish { Plaster }] }
  scale 4.4
#end

// Two tall windows in the far wall, bright with sky.
#declare Window = function(x, y) { max(abs(abs(x) - 1.9) - 0.62, abs(y - 1.95) - 1.05) }
#declare Pane = function(x, y) { max(0.035 - abs(mod(abs(x) - 1.9 + 10, 0.41) - 0.205), 0.035 - abs(mod(y + 0.2, 0.7) - 0.35)) }

#declare Sky = texture {
  pigment { gradient y color_map { [0.2 rgb <0.95, 0.90, 0.80>] [0.75 rgb <0.45, 0.66, 0.95>] } scale 4 }
  finish { ambient 1 diffuse 0 } }
#declare Frame = texture { pigment { rgb <0.93, 0.92, 0.88> } finish { Plaster } }

plane { -z, -Half
  texture {
    function { select(Window(x, y), select(Pane(x, y), 0, 0.5), select(Window(x, y) - 0.07, 0.5, 1)) }
    texture_map {
      [0.25 Sky] [0.25 Frame] [0.75 Frame]
      [0.75 Wall(color rgb <0.90, 0.82, 0.66>, color rgb <0.55, 0.20, 0.12>, 0)] } } }
plane { z, -Half texture { Wall(color rgb <0.80, 0.84, 0.80>, color rgb <0.16, 0.36, 0.36>, 0) } }
plane { -x, -Half texture { Wall(color rgb <0.90, 0.86, 0.78>, color rgb <0.22, 0.30, 0.52>, 90) } }
plane { x, -Half texture { Wall(color rgb <0.92, 0.84, 0.74>, color rgb <0.40, 0.46, 0.18>, 90) } }

// A coffered ceiling.
#declare Coffers = pigment {
  boxed translate <1, 0, 1> scale 0.5 warp { repeat 1*x } warp { repeat 1*z }
  color_map { [0.00 rgb <0.50, 0.36, 0.22>] [0.16 rgb <0.50, 0.36, 0.22>]
              [0.18 rgb <0.86, 0.80, 0.70>] [1 rgb <0.92, 0.87, 0.78>] } }
plane { -y, -Height pigment { Coffers translate Height*y } finish { Plaster } }

// ---- A ball above the water, and two columns in it -----------------------------------------------
#declare Ball_Centre = <0.5, 0.85, 0.7>;
#declare Ball_Radius = 0.75;
sphere { Ball_Centre, Ball_Radius
  pigment { gradient x color_map {
    [0.00 rgb <0.92, 0.28, 0.16>] [0.5 rgb <0.92, 0.28, 0.16>] [0.5 rgb <0.96, 0.93, 0.86>] }
    scale 0.5 rotate 20*z translate Ball_Centre }
  finish { Plaster } }

#declare Column_Radius = 0.32;
#declare Columns = array[2] { <-2.2, 0, 1.6>, <2.4, 0, -1.4> }
#declare I = 0;
#while (I < 2)
  cylinder { Columns[I], Columns[I] + Height*y, Column_Radius open
    pigment { spiral1 1 color_map {
      [0 rgb <0.90, 0.86, 0.78>] [0.7 rgb <0.90, 0.86, 0.78>] [0.72 rgb <0.30, 0.42, 0.40>]
      [0.98 rgb <0.30, 0.42, 0.40>] [1 rgb <0.90, 0.86, 0.78>] }
      rotate 90*x scale <1, 1.2, 1> translate Columns[I] }
    finish { Plaster } }
  #declare I = I + 1;
#end

// ---- Water -----------------------------------------------------------------------------------------
plane { y, 0 pigment { rgb 0 } finish { ambient 0 diffuse 0 reflection rgb <0.84, 0.92, 0.95> } }

camera { perspective location <-1.2, 1.9, -3.7> right x*4/3 up y angle 75 look_at <0.2, 0.7, 0.8> }

// ---- Surfaces --------------------------------------------------------------------------------------
Slf_Quad("water", <-Half, 0, -Half>, 2*Half*z, 2*Half*x, <Texels, Texels>, <Directions, Directions>)
Slf_Water("water")

Slf_Quad("far", <Half, 0, Half>, -2*Half*x, Height*y, <768, 384>, Slf_Matte)
Slf_Quad("near", <-Half, 0, -Half>, 2*Half*x, Height*y, <512, 256>, Slf_Matte)
Slf_Quad("right", <Half, 0, -Half>, 2*Half*z, Height*y, <512, 256>, Slf_Matte)
Slf_Quad("left", <-Half, 0, Half>, -2*Half*z, Height*y, <512, 256>, Slf_Matte)
Slf_Quad("ceiling", <-Half, Height, -Half>, 2*Half*x, 2*Half*z, <256, 256>, Slf_Matte)
Slf_Sphere("ball", Ball_Centre, Ball_Radius, <256, 128>, Slf_Matte)

#macro Slf_Point(U, V) (Column + <Column_Radius*cos(2*pi*U), Height*(1-V), Column_Radius*sin(2*pi*U)>) #end
#declare Column = Columns[0];
Slf_Parametric("column_far", 1, 0, <128, 256>, Slf_Matte)
#declare Column = Columns[1];
Slf_Parametric("column_near", 1, 0, <128, 256>, Slf_Matte)
