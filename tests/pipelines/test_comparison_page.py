"""`report.html` of a comparison: the numbers of compare.json, every picture, in a real browser."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.comparison.comparison import compare_frames
from pseudolidar.running.products.compared_file import read_compared
from pseudolidar.running.reports.comparison_page import PHOTOS, VIEWS, comparison_page
from pseudolidar.running.reports.comparison_report import ComparisonReport
from pseudolidar.running.reports.comparison_verdict import one_sided, verdict
from pseudolidar.running.reports.samples import FrameSample
from pseudolidar.running.results import RunResult
from pseudolidar.sources.source import SourceSummary

STREET = ("synthetic:street:8", "--width-px", "480")
PLOTS = 13
SECTIONS = (
    "Verdict",
    "What was compared",
    "Error by range",
    "Bias of the disparities",
    "Coverage and large errors",
    "Errors over the picture",
    "Both clouds from above",
    "Cloud against cloud",
    "Are the stated errors right?",
    "Diagnosis of the rig",
    "Frame by frame",
    "How to read this",
)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of eight frames of a street; not to be changed."""
    out = tmp_path_factory.mktemp("page") / "out"
    assert main(["compare", *STREET, str(out), "--to", "none"]) == 0
    return out


@pytest.fixture(scope="module")
def report(street) -> tuple[ComparisonReport, dict[str, FrameSample]]:
    """The same as nouns."""
    names = sorted(path.stem for path in (street / ".compared").iterdir())
    compared = compare_frames([read_compared(street, name) for name in names], reference="scans")
    source = SourceSummary("street", str(street), "a street")
    samples = {name: FrameSample.read(street / ".report" / f"{name}.npz") for name in names}
    return ComparisonReport(compared, RunResult(source, len(names), (), len(names))), samples


class Page(HTMLParser):
    """Tables as rows of cells, pictures with their texts, headings."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self.pictures: list[dict[str, str | None]] = []
        self.headings: list[str] = []
        self.links: list[str] = []
        self.points: list[str] = []
        self._within = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._within = self._within if tag == "a" else tag
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif tag == "img":
            self.pictures.append(dict(attrs))
        elif tag == "a":
            self.links.append(dict(attrs)["href"] or "")
        elif tag == "li":
            self.points.append("")

    def handle_endtag(self, tag: str) -> None:
        self._within = "" if tag in ("td", "th", "h2") else self._within

    def handle_data(self, data: str) -> None:
        if self._within in ("td", "th"):
            self.tables[-1][-1][-1] += data.strip()
        elif self._within == "h2":
            self.headings.append(data)
        elif self._within == "li":
            self.points[-1] += data


def _every(told: dict) -> list[dict]:
    return [*told["bins"], told]


def test_the_page_has_the_numbers_of_the_json(street):
    text = (street / "report.html").read_text()
    page, stored = Page(text), json.loads((street / "compare.json").read_text())
    assert [h for h in page.headings if h in SECTIONS] == list(SECTIONS)
    errors, coverage, sigma = (t for t in page.tables if t[0][0] == "depth, m")
    assert len(errors) == len(coverage) == len(sigma) == 1 + 5 + 1
    rows = zip(errors[1:], coverage[1:], sigma[1:], [*stored["bins"], stored], strict=True)
    for error, covered, sure, each in rows:
        name = f"{each['from_m']}-{each['to_m']}"
        assert error[0] == covered[0] == sure[0]
        assert error[0] in (name, f"all, {name}")
        low, high = each["intervals"]["median_rel"]
        assert error[1:5] == [
            f"{100 * each['median_rel']:.2f}",
            f"{100 * low:.2f} to {100 * high:.2f}",
            f"{100 * each['p90_rel']:.2f}",
            f"{100 * each['bias_rel']:+.2f}",
        ]
        assert error[6:] == [f"{each['rmse_m']:.2f}", f"{each['n']:,}"]
        assert covered[1] == f"{100 * each['density']:.1f}"
        assert covered[3:] == [
            f"{100 * each['delta_1_05']:.1f}",
            f"{100 * each['delta_1_25']:.1f}",
            f"{each['reference_points']:,}",
        ]
        assert [sure[1], sure[3]] == [
            f"{100 * each[n]:.1f}" for n in ("within_1_sigma", "within_95")
        ]
    (distances,) = (t for t in page.tables if t[0][0] == "range, m")
    for row, each in zip(distances[1:], _every(stored["clouds"]), strict=True):
        assert row[5:8] == [
            f"{each['chamfer_m']:.3f}",
            f"{100 * each['f_score_0_1']:.1f}",
            f"{100 * each['f_score_0_2']:.1f}",
        ]
        assert row[-1] == f"{each['reference_points']:,}"
    (lead,) = re.findall(r'class="lead">([^<]*)<', text)
    assert f"half of the stereo depths agree with the {stored['reference']} to " in lead
    assert f"{100 * stored['median_rel']:.2f} %" in lead
    assert f"{100 * stored['p90_rel']:.2f} %" in lead
    assert f"{stored['n']:,} points of 8 frames" in lead
    worst = max(stored["bins"], key=lambda each: each["median_rel"])
    assert (
        f"largest at {worst['from_m']}-{worst['to_m']} m ({100 * worst['median_rel']:.2f}" in lead
    )
    assert "census (quality fast) + clean" in text
    for cause in stored["diagnosis"]["chosen"]["causes"]:
        assert cause["text"][1:].replace("+-", "±") in text


def test_worst_frames_are_those_of_the_table_of_all(street):
    page = Page((street / "report.html").read_text())
    (table,) = (t for t in page.tables if t[0][0] == "frame")
    lines = (street / "compare.csv").read_text().splitlines()
    head = lines[0].split(",")
    rows = [dict(zip(head, line.split(","), strict=True)) for line in lines[1:]]
    whole = [r for r in rows if (r["from_m"], r["to_m"]) == ("5", "80") and r["frame"] != "all"]
    whole.sort(key=lambda row: -float(row["median_rel"]))
    assert [row[0] for row in table[1:]] == [row["frame"] for row in whole[:5]]
    assert table[1][1] == f"{100 * float(whole[0]['median_rel']):.2f} %"


def test_the_page_is_self_contained_and_says_what_pictures_show(street):
    text = (street / "report.html").read_text()
    assert not re.findall(r"(?:src|href)=\"(?!data:)", text)
    assert "@media print" in text
    assert "color-scheme: light" in text
    page = Page(text)
    assert all(picture["alt"] and len(picture["alt"]) > 20 for picture in page.pictures)
    uris = [picture["src"] or "" for picture in page.pictures]
    photos = [uri for uri in uris if uri.startswith("data:image/jpeg")]
    assert len(photos) == PHOTOS + VIEWS
    for uri in photos:
        data = np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8)
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert picture.std() > 20
        assert picture.shape[1] > 1200
    assert len(uris) - len(photos) == PLOTS


def _browser() -> str | None:
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)


# What a browser makes of the page: how many pictures it shows, and whether anything sticks out.
PROBE = """<script>addEventListener("load", () => { const all = [...document.images];
document.title = JSON.stringify({shown: all.filter(i => i.complete && i.naturalWidth > 99).length,
pictures: all.length, sticks: document.documentElement.scrollWidth - innerWidth}) })</script>"""


@pytest.mark.skipif(_browser() is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width_px", [1200, 600])
def test_a_browser_shows_every_picture_and_nothing_sticks_out(street, tmp_path, width_px):
    path = tmp_path / "page.html"
    path.write_text((street / "report.html").read_text() + PROBE)
    browser = _browser()
    assert browser is not None
    args = ("--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr")
    window = (f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width_px},900")
    done = subprocess.run(
        [browser, *args, *window, "--virtual-time-budget=5000", "--dump-dom", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    (title,) = re.findall(r"<title>(.*?)</title>", done.stdout)
    found = json.loads(title)
    assert found["shown"] == found["pictures"] == PHOTOS + VIEWS + PLOTS
    assert found["sticks"] <= 0
    assert "CONSOLE" not in done.stderr


def shown(report: ComparisonReport, samples: dict[str, FrameSample]) -> tuple[str, Page]:
    text = comparison_page(report, samples=samples, settings={}).decode()
    return text, Page(text)


def compared_again(report: ComparisonReport, frames: list) -> ComparisonReport:
    return replace(report, comparison=compare_frames(frames, reference="scans"))


def test_one_frame_without_sigma_and_an_empty_bin(report):
    whole, samples = report
    frame = whole.comparison.frames[0]
    near = frame.reference_m < 30
    columns = ("u", "v", "reference_m", "disparity_px", "slope")
    kept = {name: getattr(frame, name)[near] for name in columns}
    alone = compared_again(whole, [replace(frame, sigma_px=None, **kept)])
    text, page = shown(alone, samples)
    assert "without a stated error" in text
    assert "no interval of a single frame" in text
    assert "Frame by frame" not in page.headings
    table, _ = (t for t in page.tables if t[0][0] == "depth, m")
    assert table[5][1:4] == ["-", "-", "-"]  # 50-80 m
    assert table[5][-1] == "0"


def off_by(frame: ComparedFrame, share: float, noise_px: float) -> ComparedFrame:
    """The frame as a rig of another baseline has it, with errors of its own."""
    noise = np.random.default_rng(frame.index).normal(0, noise_px, len(frame))
    return replace(frame, disparity_px=frame.reference_px / (1 + share) + noise)


def test_the_verdict_tells_the_rig_from_the_matching(report):
    whole, _ = report
    frames = whole.comparison.frames
    wrong = compare_frames([off_by(frame, 0.03, 0.05) for frame in frames])
    assert [each.from_m for each in one_sided(wrong.by_range)] == [5, 10, 20, 30, 50]
    first, second, _ = verdict(wrong)
    assert "too far by 3." in first or "too far by 2.9" in first
    assert "one of the calibration" in first
    assert re.search(r"Baseline or focal length (2\.9|3|3\.1) ± 0\.1 % too long", second)
    right = compare_frames([off_by(frame, 0.0, 0.5) for frame in frames])
    first, second, _ = verdict(right)
    assert "comes from the matching" in first
    assert "No cause in the rig explains more than chance" in second
    near = compare_frames([off_by(frame, -0.03, 0.05) for frame in frames])
    assert "too near by" in verdict(near)[0]
    nothing = [replace(f, disparity_px=np.full(len(f), np.nan)) for f in frames]
    assert verdict(compare_frames(nothing))[0].startswith("There are too few points")


def test_causes_that_cancel_are_no_facts_in_the_report(report):
    """A principal point and a rotation that are wrong, the one making up for the other."""
    whole, _ = report
    frames = []
    for frame in whole.comparison.frames:
        focal_px, centre_px = frame.rig.right.focal_px, frame.rig.right.K[0, 2]
        x = (frame.u - frame.reference_px - centre_px) / focal_px
        error_px = 1.5 - 1.6 * (1 + x**2) + 0.1 * np.random.default_rng(1).normal(size=len(frame))
        frames.append(replace(frame, disparity_px=frame.reference_px + error_px))
    compared = compared_again(whole, frames)
    assert compared.comparison.diagnosis.chosen.effect.cancels
    text, page = shown(compared, {})
    assert "none of them is found for itself" in page.points[1]
    assert "only the sum is sure" in text


def test_few_points_and_none_at_all(report):
    whole, samples = report
    frame = whole.comparison.frames[0]
    few, page = shown(compared_again(whole, [frame.thinned(20)]), {})
    assert "Too few points to tell causes apart" in few
    assert "Errors over the picture" not in page.headings
    nothing = replace(frame, disparity_px=np.full_like(frame.disparity_px, np.nan))
    text, page = shown(compared_again(whole, [nothing, nothing]), samples)
    assert "there is no point that can be compared, in 2 frames" in text
    table = next(t for t in page.tables if t[0][0] == "depth, m")
    assert all(row[1] == "-" and row[-1] == "0" for row in table[1:])


def test_names_from_files_are_escaped(report):
    whole, samples = report
    frame = replace(whole.comparison.frames[0], id="<script>&")
    text, _ = shown(
        compared_again(whole, [frame, whole.comparison.frames[1]]),
        {**samples, "<script>&": next(iter(samples.values()))},
    )
    assert "<script>" not in text
    assert "&lt;script&gt;&amp;" in text


def test_drives_and_clouds_have_pages_with_the_numbers_of_their_json(tmp_path):
    for seed in (1, 2):
        drive = ("synth", str(tmp_path / "in" / f"<{seed}>"), "--seed", str(seed))
        assert main([*drive, "--frames", "1", "--width-px", "320"]) == 0
    out = tmp_path / "out"
    assert main(["compare", str(tmp_path / "in"), str(out), "--all", "--to", "pcd"]) == 0
    text, stored = (out / "report.html").read_text(), json.loads((out / "compare.json").read_text())
    page = Page(text)
    assert f"{100 * stored['median_rel']:.2f} % of the distance" in text
    drives, causes = (t for t in page.tables if t[0][0] == "drive")
    assert [row[0] for row in causes[1:]] == ["<1>", "<2>"]
    # both names lead to the page of their drive, from either table
    linked = [(out / unquote(link)).resolve() for link in page.links]
    assert linked == 2 * [out / f"<{seed}>" / "report.html" for seed in (1, 2)]
    assert f"{stored['clouds']['chamfer_m']:.3f}" in text
    assert [row[0] for row in drives[1:]] == ["<1>", "<2>", "all"]
    medians = [each["median_rel"] for each in (*stored["drives"], stored)]
    assert [row[-4] for row in drives[1:]] == [f"{100 * median:.2f} %" for median in medians]
    assert "<1>" not in text
    assert all((out / f"<{seed}>" / "report.html").exists() for seed in (1, 2))

    one, two, clouds = out / "<1>" / "pcd", out / "<2>" / "pcd", tmp_path / "clouds"
    assert main(["compare", str(one), str(two), "--out", str(clouds)]) == 0
    text = (clouds / "report.html").read_text()
    stored = json.loads((clouds / "compare.json").read_text())
    (table,) = (t for t in Page(text).tables if t[0][0] == "range, m")
    for row, each in zip(table[1:], _every(stored), strict=True):
        score, length = each["f_score_0_2"], each["chamfer_m"]
        assert row[5] == ("-" if length is None else f"{length:.3f}")
        assert row[7] == ("-" if score is None else f"{100 * score:.1f}")
    assert f"{stored['accuracy_median_m']:.3f} m" in text or stored["accuracy_median_m"] >= 1
    assert len(Page(text).pictures) == 2
