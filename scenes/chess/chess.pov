// POV-Ray's own sample scene, advanced/chess2.pov (package povray-examples), included as it is; this
// file only says in which gamma it works, and names its surfaces. This is the recipe for a scene that
// somebody else wrote.
//
// Declare=Texels=256    texels of the board along U and V; a piece has a quarter and a half
// Declare=Directions=16 directions of the board along S and T; the rest has half
// Declare=Most=8        bake so many pieces of each of the four rows (8 is all)
//
// Quality of its focal blur does not matter: the camera below takes the place of its own.
#ifndef (Chess) #declare Chess = "/usr/share/doc/povray/examples/advanced/chess2.pov"; #end
#include Chess

#version 3.7;
// Radiance must be linear; the sample works in a gamma of 2.2.
global_settings { assumed_gamma 1.0 }
#include "slf.inc"

#ifndef (Texels) #declare Texels = 256; #end
#ifndef (Directions) #declare Directions = 16; #end
#ifndef (Most) #declare Most = 8; #end

camera { perspective location <46, 22, -52> right x*4/3 up y angle 50 look_at <2, 1, -4> }

Slf_Background(<0.80, 0.72, 0.77>)

// ---- Board, frame, table, ground ------------------------------------------------------------------
Slf_Quad("board", <-32, 0, -32>, 64*z, 64*x, <Texels, Texels>, <Directions, Directions>)

// A point of the square of half side R at U: its corners lie at U = 0, 1/4, 1/2, 3/4.
#macro On_Square(R, U)
  #local Side = int(4*U);
  #local At = 4*U - Side;
  vrotate(<R, 0, R*(2*At - 1)>, -90*mod(Side, 4)*y)
#end
#macro Slf_Point(U, V)
  (On_Square(32 + 3*V, mod(U + 1, 1)) - 0.15*y)
#end
Slf_Parametric("frame", 1, 0, <Texels, 8>, Slf_Matte)
#macro Slf_Point(U, V)
  (On_Square(35, mod(U + 1, 1)) - (0.15 + 2.85*V)*y)
#end
Slf_Parametric("frame_side", 1, 0, <Texels, 8>, Slf_Matte)

// The table's top: between the frame's square and its round edge.
#macro Slf_Point(U, V)
  #local From = On_Square(35, mod(U + 1, 1));
  (From*(1 - V) + 54.9*V*vnormalize(From) - 3*y)
#end
Slf_Parametric("table", 1, 0, <Texels, Texels/4>, <Directions/2, Directions/2>)
// The ground, out to where it cannot be told from its horizon: half a degree below.
#macro Slf_Point(U, V)
  (vrotate(40*(exp(6*V) - 1)*x, -360*U*y) - 80*y)
#end
Slf_Parametric("ground", 1, 0, <64, 64>, Slf_Matte)

// ---- Pieces: a cylinder shrunk onto each. Boxes bound them, as their CSG does not. -------------------
#macro Piece(Name, Object, Place, Top)
  Slf_Wrap(Name, intersection { object { Object } box { <-3.1, 0, -3.1>, <3.1, Top, 3.1> } translate Place },
    Slf_Wrap_Cylinder, <Texels/4, Texels/2>, <Directions/2, Directions/2>)
#end

#declare White_Row = array[8] { WRook, WKnight, WBishop, WQueen, WKing, WBishop, WKnight, WRook }
#declare Black_Row = array[8] { BRook, BKnight, BBishop, BQueen, BKing, BBishop, BKnight, BRook }
#declare Tops = array[8] { 10.1, 10.6, 11.2, 12.8, 13.6, 11.2, 10.6, 10.1 }
#declare I = 0;
#while (I < Most)
  Piece(concat("white_pawn_", str(I, 0, 0)), WPawn, <8*I - 28, 0, -20>, 8.6)
  Piece(concat("black_pawn_", str(I, 0, 0)), BPawn, <8*I - 28, 0, 20>, 8.6)
  Piece(concat("white_", str(I, 0, 0)), White_Row[I], <8*I - 28, 0, -28>, Tops[I])
  Piece(concat("black_", str(I, 0, 0)), Black_Row[I], <8*I - 28, 0, 28>, Tops[I])
  #declare I = I + 1;
#end
