# The light fields that the benches and the report measure: tests/bench/bakes lists them.
.PHONY: bench-bakes
bench-bakes: all ## Bake what is measured, build/bench-*.slf
	@QUALITY=$(QUALITY) tests/bench/bakes.sh
