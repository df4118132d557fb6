"""`--rows` and `--balance` are flags of every verb that matches, and reach its matcher."""

from __future__ import annotations

from pathlib import Path

import pytest
from pseudolidar.pipelines.live import Live, convert_frame

from pseudolidar.calibration.overlap import Overlap
from pseudolidar.commandline.verbs import load_verb, verb_files
from pseudolidar.running.aligning import SeeFrame
from pseudolidar.running.settings_schema import settings_fields
from pseudolidar.sources.body import BodySource
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.balance import BalancedMatcher
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.row_alignment import RowAligned
from pseudolidar.stereo.sgbm import Sgbm
from tests.body_rigs import body_rig


@pytest.mark.parametrize("flag", ["rows", "balance"])
def test_every_verb_that_matches_has_it(flag):
    flags = {
        verb: {field.name for field in settings_fields(load_verb(verb).settings)}
        for verb in verb_files()
    }
    matching = {verb for verb, names in flags.items() if "matcher" in names}
    assert matching >= {"convert", "compare", "refine", "tune", "live", "align"}
    assert {verb for verb in matching if flag not in flags[verb]} == set()


@pytest.mark.parametrize("rows", ["auto", "never"])
@pytest.mark.parametrize("when", ["auto", "always", "never"])
def test_live_and_align_do_as_they_say(when, rows):
    source = Synthetic("room", frames=1, width_px=160).open()
    job = Live("left", "right", Path("out"), matcher=Sgbm(), rows=rows, balance=when)
    body = BodySource("body", body_rig(), (source,) * 3, (("0", (0, 0, 0)),))
    see = SeeFrame.of(body, Sgbm(), Overlap(), eyes=Eyes(rows, when), min_depth_m=None)
    matches = [convert_frame(job, source).match, *see.match.values()]
    assert len(matches) == 4
    for match in matches:
        matcher = match.matcher
        assert isinstance(matcher, RowAligned) is (rows == "auto")
        if isinstance(matcher, RowAligned):
            matcher = matcher.matcher
        assert isinstance(matcher, BalancedMatcher) is (when != "never")
