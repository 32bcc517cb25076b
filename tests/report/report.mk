# The report: measurements, each kept in build/report/measured so that a run that was stopped goes on
# where it was, and the page that is drawn from them. matplotlib and FLIP live in a venv of its own.
REPORT_PYTHON := build/venv/bin/python
REPORT_PROGRAMS := build/report/recode build/report/frame

NEED.report.programs := python3
NEED.report.packages := python3 python3-venv

$(REPORT_PYTHON): tests/report/requirements.txt | build/deps/report
	python3 -m venv build/venv
	build/venv/bin/pip -q install -r $<
	@touch $@

build/report/%: build/obj/tests/report/%.o $(filter-out %/slfview.o %/window.o %/window_files.o %/window_keys.o %/window_overlays.o,$(VIEWER_OBJECTS)) $(LIBSLF)
	@mkdir -p $(@D)
	$(call say,link,$@)$(CC) -o $@ $^ $(ALL_LDFLAGS) -lpng -ldl -lm

.PHONY: report report-scenes
report: all $(REPORT_PYTHON) $(REPORT_PROGRAMS) $(CODEC_BENCH) $(PEERS_PYTHON) build/bench/viewer build/bench/room build/tests/pond/water_mesh | $(CHECK_DEPS) ## Speed against error: build/report/index.html (QUALITY=paper for the paper's sizes)
	$(REPORT_PYTHON) tests/report/measure.py --quality $(QUALITY)
	$(REPORT_PYTHON) tests/report/page.py
report-scenes: all $(REPORT_PYTHON) $(REPORT_PROGRAMS) | $(CHECK_DEPS) ## The table of scenes alone: build/report/scenes.md
	$(REPORT_PYTHON) tests/report/measure.py --quality $(QUALITY) --only scenes
	$(REPORT_PYTHON) tests/report/page.py --only scenes
