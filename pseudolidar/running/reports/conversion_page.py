"""`report.html` of a conversion: what was made, how dense and how far, and how it looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.evaluation.page import Picture, PictureRow, Section, render_page
from pseudolidar.evaluation.pictures import (
    disparity_picture,
    error_picture,
    thicker,
    top_picture,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.products.encoders import DEPTH_BIN_M
from pseudolidar.running.products.preview import PREVIEW_NAME
from pseudolidar.running.reports.removed import (
    KEPT,
    REMOVED,
    colours_text,
    removed_lines,
    removed_picture,
)
from pseudolidar.running.reports.run_sections import notes_section, skips_section
from pseudolidar.running.reports.samples import FrameSample, read_samples
from pseudolidar.running.results import RunResult
from pseudolidar.structures.camera import StereoRig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPORT_NAME = "report.html"
# The colour scale of disparity ends where all but this share of the sampled pixels lie below.
DISPARITY_QUANTILE = 0.995
TOP_SCALE = 3
# Edges of the axes, shares of a plot: fixed, since to search them costs as much as to draw it.
MARGINS = {"left": 0.1, "right": 0.99, "bottom": 0.17, "top": 0.9}
_TOP_TEXT = (
    "Points from above, as far ahead as said below each, half of that to each side, the sensor at "
    "the middle of the lower edge."
)


def write_conversion_page(
    folder: Path, result: RunResult, rig: StereoRig | None, *, settings: Mapping[str, str]
) -> Path:
    """Write `report.html`, self-contained, from what a run left in its folder.

    Args:
        folder: output folder.
        result: how the run ended.
        rig: of the first frame, where there is one.
        settings: what was chosen, by name, for the reader.

    Returns:
        Path of the page.

    Raises:
        OutputError: the disk is full or gone.
    """
    samples = read_samples(folder, result.committed)
    sections = [
        Section("Overview", table=_overview(result, rig, settings)),
        *_preview(folder),
        *notes_section(result),
        *skips_section(result),
        *_plots(result),
        *_contact_sheet(samples),
    ]
    subtitle = "every number in metres and pixels; sigma is one standard deviation (68 %)"
    path = folder / REPORT_NAME
    write_atomic(path, render_page(result.source.line, subtitle, sections))
    return path


def _overview(
    result: RunResult, rig: StereoRig | None, settings: Mapping[str, str]
) -> list[tuple[str, str]]:
    done = f"{len(result.committed)} of {result.total}, {len(result.skipped)} skipped"
    rows = [("frames", done)]
    if rig is not None:
        rows += [*rig_rows(rig), ("sigma includes", _systematic(rig))]
    means = {name: figure["mean"] for name, figure in result.figures.items()}
    if "density" in means:
        rows.append(("density", f"{means['density']:.1%} of the pixels, mean over frames"))
    if means:
        rows.append(("points", f"{means['points']:,.0f} a frame"))
    rows += [("removed", line.partition(": ")[2]) for line in removed_lines(result.figures)]
    counts = [
        name
        for name in means
        if name.startswith(("pixels_", "points_")) and not name.startswith((REMOVED, KEPT))
    ]
    rows += [(name.replace("_", " "), f"{means[name]:,.0f} a frame") for name in counts]
    if "sigma_m_median" in means:
        rows.append(("sigma of a point", f"{means['sigma_m_median']:.3f} m, median"))
    return rows + list(settings.items())


def rig_rows(rig: StereoRig) -> list[tuple[str, str]]:
    """What a reader should know of a rig."""
    width, height = rig.left.size_px
    return [
        ("images", f"{width} x {height} px"),
        ("rig", f"f {rig.left.focal_px:.4f} px, {rig.baseline_text}"),
        ("depth at 1 px", f"{rig.fB_px_m:.1f} m"),
    ]


def _systematic(rig: StereoRig) -> str:
    if rig.correction is None:
        return f"a systematic {rig.systematic_sigma_px:g} px: the rig was not refined"
    origin = rig.correction.origin or "unknown origin"
    return f"a systematic {rig.systematic_sigma_px:.2f} px: the rig was refined ({origin})"


def _preview(folder: Path) -> list[Section]:
    if not (folder / PREVIEW_NAME).exists():
        return []
    text = "Pictures and the cloud from above, at the pace of the recording."
    return [Section("Preview", text, video=PREVIEW_NAME)]


def _plots(result: RunResult) -> list[Section]:
    frames = [record.figures for record in result.committed]
    if not frames:
        return []
    dense = all("density" in frame for frame in frames)
    plots = [*([_density_plot(result)] if dense else []), _depth_plot(frames)]
    return [Section("Density and depth" if dense else "Depth", plots=plots)]


def _axes(title: str, x: str, y: str) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.6, 3.0))
    axes = figure.subplots(gridspec_kw=MARGINS)
    axes.set(title=title, xlabel=x, ylabel=y)
    axes.grid(visible=True, alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _density_plot(result: RunResult) -> Picture:
    figure, axes = _axes("Pixels with a depth", "frame", "share, %")
    index = [record.index for record in result.committed]
    share = [100 * record.figures["density"] for record in result.committed]
    marker = "." if len(index) < 100 else ""
    axes.plot(index, share, marker=marker, linewidth=1.2)
    for record in result.skipped:
        if record.index is not None:  # a frame refused at opening has no place in the sequence
            axes.axvline(record.index, color="tab:red", alpha=0.4, linewidth=1)
    axes.set_ylim(0, 100)
    axes.xaxis.get_major_locator().set_params(integer=True)
    if len(index) == 1:  # around a single point there are no whole numbers
        axes.set_xticks(index)
    return Picture.plot(figure, "share of pixels with a depth by frame; skipped frames are red")


def _depth_plot(frames: Sequence[Mapping[str, Any]]) -> Picture:
    counts = np.sum([frame["depth_histogram"] for frame in frames], axis=0) / len(frames)
    edges = DEPTH_BIN_M * np.arange(len(counts))
    figure, axes = _axes("Depth", "depth Z, m", "pixels a frame")
    axes.bar(edges, counts, width=0.92 * DEPTH_BIN_M, align="edge")
    labels = [f"{edge:.0f}" for edge in edges]
    axes.set_xticks(edges, [*labels[:-1], f"{labels[-1]}+"])
    if counts.any():
        axes.set_yscale("log")
    return Picture.plot(figure, "pixels by depth, mean over frames; the last bar holds all beyond")


def _contact_sheet(samples: Mapping[str, FrameSample]) -> list[Section]:
    if not samples:
        return []
    known = [s.disparity[np.isfinite(s.disparity)] for s in samples.values()]
    pixels = np.concatenate(known).astype(np.float32)
    max_px = float(np.quantile(pixels, DISPARITY_QUANTILE)) if len(pixels) else 1.0
    rows = [_sample_row(name, sample, max_px) for name, sample in samples.items()]
    if not len(pixels):
        return [Section("Frames", _TOP_TEXT, pictures=rows)]
    gone = colours_text(samples.values())
    text = (
        f"Photo; disparity from 0 (blue) to {max_px:.0f} px (red), black where there is none; "
        "error against the ground truth where there is one (blue: within 3 px or 5 %, red: worse, "
        f"white: no disparity). {gone}{_TOP_TEXT}"
    )
    return [Section("Frames", text, pictures=rows)]


def _sample_row(name: str, sample: FrameSample, max_px: float) -> PictureRow:
    disparity, truth = (a.astype(np.float32) for a in (sample.disparity, sample.truth))
    pictures = []
    if sample.photo.size:
        wide = sample.photo.shape[1] / sample.photo.shape[0]
        pictures.append(Picture.photo(sample.photo, name, width=wide))
        if np.isfinite(disparity).any():
            shown = disparity_picture(disparity, max_px)
            pictures.append(Picture.exact(shown, "disparity", width=wide))
        if sample.removed.any():
            shown = removed_picture(sample.photo, sample.removed)
            pictures.append(Picture.exact(shown, "removed", width=wide))
        if np.isfinite(truth).any():
            pictures.append(Picture.exact(error_picture(disparity, truth), "error", width=wide))
    top = thicker(top_picture(sample.top), TOP_SCALE)
    caption = f"{sample.ahead_m:g} m ahead"
    caption = caption if pictures else f"{name}, {caption}"
    return PictureRow((*pictures, Picture.exact(top, caption)))
