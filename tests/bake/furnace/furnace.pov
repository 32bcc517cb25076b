// A white ball in a uniform sky: whatever leaves it has the sky's radiance, 1, everywhere.
#version 3.7;
#include "slf.inc"
global_settings { assumed_gamma 1.0
  radiosity { pretrace_start 0.2 pretrace_end 0.1 count 50 error_bound 1 recursion_limit 1 brightness 1 Slf_Radiosity() } }
background { rgb 1 }
sphere { 0, 1 pigment { rgb 1 } finish { ambient 0 diffuse 1 } }
Slf_Sphere("ball", 0, 1, <16, 16>, <4, 4>)
camera { location <0, 0, -4> look_at 0 }
