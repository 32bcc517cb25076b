# The light fields that the benches and the report measure, build/bench-SCENE-DIRECTIONS.slf: the paper's
# directions with fewer texels and rays, minutes on two cores. One ray a texel where a ray is dear: a
# lathe, glass, six faces. With QUALITY=paper they have the scenes' own texels and 25 rays.
# $1 scene, $2 directions, $3 texels, $4 rays, $5 what else is declared
define bench_bake
	+$(MAKE) bake SCENE=$1 NAME=bench-$1-$2 QUALITY=paper RAYS=$(if $(filter paper,$(QUALITY)),25,$4) \
	  DECLARE="Directions=$2$(if $(filter paper,$(QUALITY)),, Texels=$3)$(5:%= %)"

endef

# One after another: each keeps all processors busy.
.PHONY: bench-bakes
bench-bakes: all
	$(foreach n,8 16 32,$(call bench_bake,floor,$n,128,9,Mirror=1))
	$(foreach n,8 16 32 64,$(call bench_bake,bottle,$n,64,1))
	$(foreach n,8 16 32 64,$(call bench_bake,cube,$n,48,1))
	$(call bench_bake,box,16,128,1)
	$(call bench_bake,pond,32,256,1)
