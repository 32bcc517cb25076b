// A gallery under a skylight: global illumination. Walls lit by what the others scatter (radiosity),
// a caustic under a glass ball (photons), a gilt sculpture of CSG that only trace() can parametrise, a
// polished floor, and light brighter than white.
//
// Declare=Texels=256    texels of the floor along U and V; the sculpture and the ball have half
// Declare=Directions=16 directions of the shiny surfaces along S and T
// Declare=Fine=0        radiosity in a quarter of the time, with streaks on the walls
#version 3.7;
#include "slf.inc"

#ifndef (Texels) #declare Texels = 256; #end
#ifndef (Directions) #declare Directions = 16; #end
#ifndef (Fine) #declare Fine = 1; #end

global_settings {
  assumed_gamma 1.0
  max_trace_level 8
  radiosity {
    #if (Fine) count 250 nearest_count 10 error_bound 0.5 low_error_factor 0.5
    #else count 80 nearest_count 8 error_bound 0.7 low_error_factor 0.6 #end
    pretrace_start 0.08 pretrace_end 0.02 recursion_limit 2 gray_threshold 0 brightness 1
    Slf_Radiosity()
  }
  photons { count 60000 autostop 0 jitter 0.4 Slf_Photons() }
}

// The room: x -5..5, y 0..4, z -4..4.
#declare Height = 4;
#declare Plaster = texture { pigment { rgb <0.88, 0.86, 0.82> } finish { ambient 0 diffuse 0.8 } }

// ---- Light: a spot on the glass, a softer one on the sculpture, and the skylight ------------------------
light_source { <2.6, 3.9, 0.9> color rgb <1.0, 0.95, 0.85>*2.2
  spotlight point_at <2.0, 1.2, 0.6> radius 16 falloff 26 fade_distance 2.5 fade_power 2
  photons { refraction on reflection off } }
light_source { <-2.4, 3.9, -1.4> color rgb <1.0, 0.96, 0.88>*1.5
  spotlight point_at <-1.6, 1.2, 0.2> radius 18 falloff 32 fade_distance 2.5 fade_power 2
  photons { refraction off reflection off } }

// Radiosity's main source: brighter than white.
#declare Sky_Low = <-2.5, Height - 0.02, -1.2>;
#declare Sky_High = <2.5, Height, 1.2>;
box { Sky_Low, Sky_High pigment { rgb <0.82, 0.92, 1.0> } finish { emission 5 ambient 0 diffuse 0 } }

// ---- Room --------------------------------------------------------------------------------------------
#declare Floor_Finish = finish { ambient 0 diffuse 0.55 reflection { 0.06 0.45 fresnel off falloff 3 } phong 0.15 phong_size 60 }
plane { y, 0
  pigment { gradient x color_map { [0 rgb <0.30, 0.19, 0.11>] [0.96 rgb <0.42, 0.27, 0.15>] [0.97 rgb <0.12, 0.07, 0.04>] [1 rgb <0.12, 0.07, 0.04>] } scale 0.5
    warp { turbulence 0.03 } }
  finish { Floor_Finish } }
plane { -y, -Height texture { Plaster } }
plane { -z, -4 texture { Plaster } }
plane { z, -4 texture { Plaster pigment { rgb <0.62, 0.72, 0.70> } } }
plane { -x, -5 texture { Plaster pigment { rgb <0.78, 0.42, 0.30> } } }
plane { x, -5 texture { Plaster pigment { rgb <0.40, 0.48, 0.66> } } }

// ---- Pictures on the far wall: a thin box each ------------------------------------------------------------
#declare Canvas = finish { ambient 0 diffuse 0.85 }
#declare Picture_Low = array[3] { <-4.1, 1.0, 3.96>, <-1.1, 0.9, 3.96>, <1.9, 1.1, 3.96> }
#declare Picture_High = array[3] { <-2.1, 2.6, 4>, <1.0, 2.9, 4>, <4.0, 2.5, 4> }
#declare Pictures = array[3] {
  pigment { agate agate_turb 0.6 color_map { [0 rgb <0.06, 0.16, 0.30>] [0.5 rgb <0.85, 0.80, 0.62>] [1 rgb <0.80, 0.24, 0.12>] } scale 0.8 },
  pigment { spherical translate <0, 1.9, 4> scale 1 color_map { [0 rgb <0.92, 0.70, 0.20>] [0.30 rgb <0.86, 0.36, 0.14>] [0.31 rgb <0.12, 0.22, 0.34>] [0.7 rgb <0.10, 0.34, 0.40>] [1 rgb <0.90, 0.86, 0.70>] } },
  pigment { leopard color_map { [0 rgb <0.12, 0.30, 0.22>] [0.4 rgb <0.90, 0.88, 0.80>] [1 rgb <0.72, 0.16, 0.18>] } scale 0.13 } }
#declare I = 0;
#while (I < 3)
  box { Picture_Low[I], Picture_High[I] pigment { Pictures[I] } finish { Canvas } }
  #declare I = I + 1;
#end

// ---- Plinths -------------------------------------------------------------------------------------------
#declare Plinth_Low = array[2] { <-2.05, 0, -0.25>, <1.55, 0, 0.15> }
#declare Plinth_High = array[2] { <-1.15, 0.9, 0.65>, <2.45, 0.8, 1.05> }
#declare I = 0;
#while (I < 2)
  box { Plinth_Low[I], Plinth_High[I] texture { Plaster pigment { rgb 0.92 } } }
  #declare I = I + 1;
#end

// ---- Sculpture: a ball with eight bites, gilt ----------------------------------------------------------------
#declare Sculpture = difference {
  sphere { 0, 0.62 }
  #declare I = 0;
  #while (I < 8)
    sphere { <mod(I, 2) - 0.5, mod(int(I/2), 2) - 0.5, int(I/4) - 0.5>*1.02, 0.36 }
    #declare I = I + 1;
  #end
  pigment { rgb <0.92, 0.68, 0.30> }
  finish { ambient 0 diffuse 0.25 reflection { 0.55 metallic } specular 0.6 roughness 0.03 metallic brilliance 2 }
  rotate <20, 30, 10>
  translate <-1.6, 1.54, 0.2> }
object { Sculpture }

// ---- Glass ball: over its plinth, for its caustic ------------------------------------------------------------
#declare Ball_Centre = <2.0, 1.3, 0.6>;
#declare Ball_Radius = 0.36;
sphere { Ball_Centre, Ball_Radius
  pigment { rgbf <0.97, 1, 0.98, 0.98> }
  finish { ambient 0 diffuse 0 reflection { 0 1 fresnel on } conserve_energy specular 0.4 roughness 0.004 }
  interior { ior 1.5 }
  photons { target refraction on reflection off collect off } }

camera { perspective location <0.9, 1.9, -3.6> right x*4/3 up y angle 75 look_at <0.1, 1.1, 1> }

// ---- Surfaces -----------------------------------------------------------------------------------------------
Slf_Quad("floor", <-5, 0, -4>, 8*z, 10*x, <Texels, Texels>, <Directions, Directions>)
Slf_Quad("ceiling", <-5, Height, -4>, 10*x, 8*z, <128, 128>, Slf_Matte)
Slf_Quad("far", <5, 0, 4>, -10*x, Height*y, <256, 128>, Slf_Matte)
Slf_Quad("near", <-5, 0, -4>, 10*x, Height*y, <128, 64>, Slf_Matte)
Slf_Quad("right", <5, 0, -4>, 8*z, Height*y, <128, 64>, Slf_Matte)
Slf_Quad("left", <-5, 0, 4>, -8*z, Height*y, <128, 64>, Slf_Matte)
Slf_Quad("skylight", <Sky_Low.x, Sky_Low.y, Sky_Low.z>, (Sky_High.x - Sky_Low.x)*x, (Sky_High.z - Sky_Low.z)*z, <16, 16>, Slf_Matte)
Slf_Hdr("skylight")
Slf_Hdr("floor")
#declare I = 0;
#while (I < 3)
  #declare A = Picture_Low[I];
  #declare B = Picture_High[I];
  Slf_Quad(concat("picture_", str(I, 0, 0)), <B.x, A.y, A.z>, (A.x - B.x)*x, (B.y - A.y)*y, <192, 160>, Slf_Matte)
  #declare I = I + 1;
#end
Slf_Box("plinth_sculpture", Plinth_Low[0], Plinth_High[0], <64, 64>, Slf_Matte)
Slf_Box("plinth_ball", Plinth_Low[1], Plinth_High[1], <96, 96>, Slf_Matte)
Slf_Wrap("sculpture", Sculpture, Slf_Wrap_Sphere, <Texels/2, Texels/2>, <Directions, Directions>)
Slf_Sphere("ball", Ball_Centre, Ball_Radius, <Texels/2, Texels/2>, <Directions, Directions>)
