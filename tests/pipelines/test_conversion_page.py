"""`report.html` holds everything itself, shows the frames, names what was skipped."""

import base64
import io
import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
from pseudolidar.pipelines.convert import Convert, run

from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.recognise import recognise


def page_of(source, out):
    report = run(Convert(recognise(str(source)), out, to=Outputs.parse("pcd")))
    assert report.page == out / "report.html"
    assert str(report.page) in report.text()
    return report.page.read_text()


def embedded(page, kind):
    return [base64.b64decode(b) for b in re.findall(rf"data:{kind};base64,([^\"]+)", page)]


def test_page_is_self_contained_and_its_pictures_open(drive, tmp_path):
    page = page_of(drive, tmp_path)
    assert not re.findall(r"(?:src|href)=\"(?!data:)", page)
    photos, maps = embedded(page, "image/jpeg"), embedded(page, "image/png")
    assert len(photos) == 12  # a sample of the 14 frames
    assert len(maps) == 3 * 12  # disparity, removed and top view; there is no ground truth
    assert "Removed pixels by reason: sky cyan" in page
    for data in (*photos, *maps):
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert picture.std() > 1
    plots = embedded(page, "image/svg\\+xml")
    assert len(plots) == 2
    for plot in plots:
        assert ET.parse(io.BytesIO(plot)).getroot().tag.endswith("svg")
    assert "baseline 0.50000 m" in page
    assert "50.0 m" in page  # depth at one pixel
    assert "the rig was not refined" in page


def test_skipped_frames_are_named_and_escaped(own_drive, tmp_path):
    broken = own_drive / "left" / "000002.png"
    broken.rename(broken.with_name("<b>&2.png"))
    (own_drive / "right" / "000002.png").rename(own_drive / "right" / "<b>&2.png")
    (own_drive / "left" / "<b>&2.png").write_bytes(b"not a picture")
    page = page_of(own_drive, tmp_path / "out")
    assert "Skipped frames" in page
    assert "ImageUnreadable" in page
    assert "<b>&2" not in page


def test_one_frame_is_enough_for_a_page(drive, tmp_path):
    from pseudolidar.sources.selection import FrameSelection

    job = Convert(
        recognise(str(drive)),
        tmp_path,
        to=Outputs.parse("pcd"),
        frames=FrameSelection.parse("0:1"),
    )
    page = run(job).page.read_text()
    assert "1 of 1, 0 skipped" in page
