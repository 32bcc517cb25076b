// The paper's figure 3: a rippled silver bottle in a room. The ripples turn its normals this way and
// that, so that a slice of its light field is striped.
//
// Declare=Texels=256    texels of the bottle along U, around it
// Declare=Along=2       so many times as many along V, from its lid down: ripples turn its normals faster along
//                       it than around it; 1 by default
// Declare=Directions=32 directions of the bottle along S and T
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 6 }
#include "slf.inc"

#ifndef (Texels) #declare Texels = 256; #end
#ifndef (Along) #declare Along = 1; #end
#ifndef (Directions) #declare Directions = 32; #end

// The room: x -3..3, y 0..4, z -3..3.
#declare Half = 3;
#declare Height = 4;

// ---- Light ---------------------------------------------------------------------------------------
light_source { <-1.8, 3.7, -1.6> color rgb <1.0, 0.94, 0.85>*0.8 fade_distance 5 fade_power 1 }
light_source { <2.4, 2.8, 0.4> color rgb <0.7, 0.8, 1.0>*0.35 fade_distance 5 fade_power 1 }

#declare Matte = finish { ambient 0.2 diffuse 0.75 }

// ---- Room ----------------------------------------------------------------------------------------
plane { y, 0
  pigment { checker rgb <0.86, 0.80, 0.68>, rgb <0.24, 0.20, 0.22> scale 0.5 } finish { Matte } }
plane { -y, -Height pigment { rgb <0.88, 0.87, 0.84> } finish { Matte } }
plane { -z, -Half
  pigment { brick rgb <0.80, 0.76, 0.70>, rgb <0.62, 0.24, 0.17> brick_size <0.6, 0.25, 0.4> mortar 0.03 }
  finish { Matte } }
plane { z, -Half
  pigment { gradient x color_map {
    [0 rgb <0.20, 0.40, 0.42>] [0.6 rgb <0.20, 0.40, 0.42>] [0.62 rgb <0.88, 0.84, 0.70>]
    [0.98 rgb <0.88, 0.84, 0.70>] [1 rgb <0.20, 0.40, 0.42>] } scale 0.5 }
  finish { Matte } }
plane { -x, -Half
  pigment { gradient z color_map {
    [0 rgb <0.90, 0.66, 0.22>] [0.46 rgb <0.90, 0.66, 0.22>] [0.5 rgb <0.93, 0.90, 0.84>]
    [0.96 rgb <0.93, 0.90, 0.84>] [1 rgb <0.90, 0.66, 0.22>] } scale 0.75 }
  finish { Matte } }
plane { x, -Half
  pigment { gradient y color_map {
    [0 rgb <0.28, 0.34, 0.58>] [0.5 rgb <0.28, 0.34, 0.58>] [0.54 rgb <0.84, 0.88, 0.92>]
    [0.96 rgb <0.84, 0.88, 0.92>] [1 rgb <0.28, 0.34, 0.58>] } scale 0.8 }
  finish { Matte } }

// ---- Bottle ----------------------------------------------------------------------------------------
// Its radius at a height: a neck, a shoulder, a body, and ripples that fade towards both ends.
#declare Bottle_Height = 2.4;
#declare Radius = function(h) {
  0.22 + 0.53/(1 + exp((h - 1.65)*12)) + 0.05*exp(-pow((h - Bottle_Height)/0.12, 2))
  + 0.011*sin(2*pi*h/0.16)/(1 + exp((h - 1.45)*20))/(1 + exp((0.12 - h)*40))
}

// Bezier segments through the profile from the lid down: Hermite's, with the function's own slope.
#declare Steps = 60;
#declare Profile = array[4*(Steps + 1)];
#declare Profile[0] = <0, Bottle_Height>;
#declare Profile[1] = <Radius(Bottle_Height)/3, Bottle_Height>;
#declare Profile[2] = <2*Radius(Bottle_Height)/3, Bottle_Height>;
#declare Profile[3] = <Radius(Bottle_Height), Bottle_Height>;
#declare Slope = function(h) { (Radius(h + 0.0001) - Radius(h - 0.0001))/0.0002 }
#declare Rise = Bottle_Height/Steps;
#declare I = 0;
#while (I < Steps)
  #declare A = Bottle_Height - I*Rise;
  #declare B = A - Rise;
  #declare Profile[4*I + 4] = <Radius(A), A>;
  #declare Profile[4*I + 5] = <Radius(A) - Slope(A)*Rise/3, A - Rise/3>;
  #declare Profile[4*I + 6] = <Radius(B) + Slope(B)*Rise/3, B + Rise/3>;
  #declare Profile[4*I + 7] = <Radius(B), B>;
  #declare I = I + 1;
#end

// Without sturm POV-Ray misses one ray in a thousand, near the ends of segments.
lathe {
  bezier_spline 4*(Steps + 1)
  #declare I = 0;
  #while (I < 4*(Steps + 1)) , Profile[I] #declare I = I + 1; #end
  sturm
  pigment { rgb <0.90, 0.90, 0.92> }
  finish { ambient 0 diffuse 0.08 reflection { 0.88 metallic } phong 0.8 phong_size 60 metallic }
}

// ---- Company for the bottle ------------------------------------------------------------------------
#declare Orange_Centre = <1.15, 0.34, -0.75>;
sphere { Orange_Centre, 0.34 pigment { bozo color_map { [0 rgb <0.95, 0.50, 0.10>] [1 rgb <0.90, 0.40, 0.06>] } scale 0.05 } finish { Matte } }
#declare Block_Low = <-1.75, 0, -0.9>;
#declare Block_High = <-1.0, 0.7, -0.15>;
box { Block_Low, Block_High pigment { rgb <0.22, 0.46, 0.30> } finish { Matte } }

camera { perspective location <0.9, 2.1, -2.85> right x*4/3 up y angle 70 look_at <0, 1.05, 0.2> }

// ---- Surfaces ----------------------------------------------------------------------------------------
Slf_Lathe("bottle", Profile, <Texels, Along*Texels>, <Directions, Directions>)

Slf_Quad("floor", <-Half, 0, -Half>, 2*Half*z, 2*Half*x, <512, 512>, Slf_Matte)
Slf_Quad("ceiling", <-Half, Height, -Half>, 2*Half*x, 2*Half*z, <64, 64>, Slf_Matte)
Slf_Quad("far", <Half, 0, Half>, -2*Half*x, Height*y, <512, 384>, Slf_Matte)
Slf_Quad("near", <-Half, 0, -Half>, 2*Half*x, Height*y, <384, 256>, Slf_Matte)
Slf_Quad("right", <Half, 0, -Half>, 2*Half*z, Height*y, <384, 256>, Slf_Matte)
Slf_Quad("left", <-Half, 0, Half>, -2*Half*z, Height*y, <384, 256>, Slf_Matte)
Slf_Sphere("orange", Orange_Centre, 0.34, <128, 64>, Slf_Matte)
Slf_Box("block", Block_Low, Block_High, <64, 64>, Slf_Matte)
