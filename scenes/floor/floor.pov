// The paper's figure 2: a room with strong vertical and horizontal detail, a few solids, a lamp,
// and a purely reflective floor with a Phong highlight and no diffuse term.
//
// Declare=Mirror=1      a perfect mirror instead of a dull reflector
// Declare=Texels=128    texels of the floor along U and V
// Declare=Directions=16 directions of the floor along S and T
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 6 }
#include "slf.inc"

#ifndef (Mirror) #declare Mirror = 0; #end
#ifndef (Texels) #declare Texels = 128; #end
#ifndef (Directions) #declare Directions = 16; #end

// The room: x -4..4, y 0..4, z -4..4.
#declare Half = 4;
#declare Height = 4;

// ---- Light -------------------------------------------------------------------------------------
light_source { <-1.2, 3.7, -1.0> color rgb 0.85 fade_distance 6 fade_power 1 }

#declare Matte = finish { ambient 0.22 diffuse 0.75 }

// ---- Floor -------------------------------------------------------------------------------------
// A dull reflector spreads the reflected rays over a lobe whose standard deviation in s and in t is
// one cell of 16x16 directions, 2/16 = 0.125. Half of its variance is four facets tilted to the four
// sides, each hit by every ray; half is micro-normals far smaller than a texel, averaged over many
// rays. Four facets cost 2.5 times one and leave the noise of eight times the rays.
#declare Mirror_Finish = finish { ambient 0 diffuse 0 reflection 0.8 phong 0.6 phong_size 30 }
#macro Facet(Tilt_X, Tilt_Z) // tilts in s and t, as measured under a position-coded sky
  pigment { rgb 0 }
  normal { average normal_map { [1 function { 0.5 + (Tilt_X*x + Tilt_Z*z)/16 } 120.4] [1 bumps 0.325 scale 0.0004] } }
  finish { Mirror_Finish }
#end

plane { y, 0
  #if (Mirror)
    texture { pigment { rgb 0 } finish { Mirror_Finish } }
  #else
    #declare Tilt = 0.0884; // 0.125 / sqrt 2
    texture { average texture_map { [1 Facet(-Tilt, -Tilt)] [1 Facet(Tilt, -Tilt)] [1 Facet(-Tilt, Tilt)] [1 Facet(Tilt, Tilt)] } }
  #end
}

// ---- Walls and ceiling -------------------------------------------------------------------------
#declare Stripes = pigment { gradient x
  color_map { [0 rgb <0.93, 0.90, 0.82>] [0.68 rgb <0.93, 0.90, 0.82>]
              [0.70 rgb <0.22, 0.34, 0.55>] [0.98 rgb <0.22, 0.34, 0.55>] [1 rgb <0.93, 0.90, 0.82>] } }
#declare Bands = pigment { gradient y
  color_map { [0 rgb <0.86, 0.62, 0.36>] [0.48 rgb <0.86, 0.62, 0.36>]
              [0.52 rgb <0.55, 0.20, 0.14>] [0.96 rgb <0.55, 0.20, 0.14>] [1 rgb <0.86, 0.62, 0.36>] } }

plane { -z, -Half pigment { Stripes scale 0.8 translate 0.1*x } finish { Matte } }               // far
plane {  z, -Half pigment { Bands scale 0.8 } finish { Matte } }                                 // near
plane { -x, -Half pigment { Bands scale 0.8 } finish { Matte } }                                 // right
plane {  x, -Half pigment { Stripes rotate 90*y scale 0.8 } finish { Matte } }                   // left
plane { -y, -Height pigment { rgb <0.82, 0.84, 0.86> } finish { Matte } }                        // ceiling

// ---- Solids ------------------------------------------------------------------------------------
#declare Ball_Centre = <0.9, 1.1, 0.6>;
#declare Ball_Radius = 0.8;
sphere { Ball_Centre, Ball_Radius
  pigment { gradient y color_map { [0.5 rgb <0.85, 0.22, 0.18>] [0.5 rgb <0.95, 0.93, 0.88>] }
            scale 0.4 translate 0.3*y }
  finish { Matte } }

#declare Block_Low = <-2.6, 0, 0.2>;
#declare Block_High = <-1.4, 1.9, 1.4>;
box { Block_Low, Block_High
  pigment { checker rgb <0.95, 0.80, 0.30>, rgb <0.16, 0.42, 0.36> scale <0.3, 0.475, 0.3>
            translate <-2.6, 0, 0.2> }
  finish { Matte } }

camera { perspective location <-0.6, 2.3, -3.7> right x*4/3 up y angle 75 look_at <0.1, 0.75, 0.6> }

// ---- Surfaces ----------------------------------------------------------------------------------
Slf_Quad("floor", <-Half, 0, -Half>, 2*Half*z, 2*Half*x, <Texels, Texels>, <Directions, Directions>)

Slf_Quad("far", <Half, 0, Half>, -2*Half*x, Height*y, <512, 256>, Slf_Matte)
Slf_Quad("near", <-Half, 0, -Half>, 2*Half*x, Height*y, <512, 256>, Slf_Matte)
Slf_Quad("right", <Half, 0, -Half>, 2*Half*z, Height*y, <512, 256>, Slf_Matte)
Slf_Quad("left", <-Half, 0, Half>, -2*Half*z, Height*y, <512, 256>, Slf_Matte)
Slf_Quad("ceiling", <-Half, Height, -Half>, 2*Half*x, 2*Half*z, <128, 128>, Slf_Matte)

Slf_Sphere("ball", Ball_Centre, Ball_Radius, <256, 128>, Slf_Matte)

// The block's faces but the one it stands on.
#declare Size = Block_High - Block_Low;
Slf_Quad("block_near", Block_Low, Size.y*y, Size.x*x, <256, 192>, Slf_Matte)
Slf_Quad("block_far", <Block_High.x, Block_Low.y, Block_High.z>, Size.y*y, -Size.x*x, <256, 192>, Slf_Matte)
Slf_Quad("block_left", <Block_Low.x, Block_Low.y, Block_High.z>, Size.y*y, -Size.z*z, <256, 192>, Slf_Matte)
Slf_Quad("block_right", <Block_High.x, Block_Low.y, Block_Low.z>, Size.y*y, Size.z*z, <256, 192>, Slf_Matte)
Slf_Quad("block_top", <Block_Low.x, Block_High.y, Block_Low.z>, Size.z*z, Size.x*x, <192, 192>, Slf_Matte)
