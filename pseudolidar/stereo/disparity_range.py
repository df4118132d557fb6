"""How many disparities to search."""

from __future__ import annotations

import math

from pseudolidar.errors import StereoConfig
from pseudolidar.structures.camera import StereoRig

RANGE_STEP_PX = 32


def disparity_range(rig: StereoRig, min_depth_m: float) -> int:
    """Disparities to search so that points at `min_depth_m` are found, px.

    The nearest multiple of 32 of `f B / Z - doffs`, never above half the width.

    Raises:
        StereoConfig: the image is narrower than 64 px, or the depth is no number above 0.
    """
    check_min_depth(min_depth_m)
    largest = rig.left.width_px // (2 * RANGE_STEP_PX) * RANGE_STEP_PX
    if largest == 0:
        raise StereoConfig(
            f"images {rig.left.width_px} px wide",
            want=f"at least {2 * RANGE_STEP_PX} px",
            fix="Use larger images.",
        )
    wanted_px = rig.fB_px_m / min_depth_m - rig.doffs_px
    return min(max(RANGE_STEP_PX, round(wanted_px / RANGE_STEP_PX) * RANGE_STEP_PX), largest)


def check_min_depth(min_depth_m: float) -> None:
    """Refuse a nearest depth from which no range follows.

    Raises:
        StereoConfig: not a number above 0.
    """
    if not 0 < min_depth_m < math.inf:
        raise StereoConfig(
            f"a nearest depth of {min_depth_m:g} m", want="above 0", where="--min-depth"
        )


def check_range(disparities: int, width_px: int, *, multiple: int) -> None:
    """Refuse a range that the matcher or the image cannot have.

    Raises:
        StereoConfig: not a positive multiple of `multiple`, or not below the image width.
    """
    if disparities <= 0 or disparities % multiple:
        below = max(multiple, disparities // multiple * multiple)
        raise StereoConfig(
            f"disparities {disparities}",
            want=f"a positive multiple of {multiple}, such as {below} or {below + multiple}",
            where="disparities",
        )
    if disparities >= width_px:
        largest = (width_px - 1) // multiple * multiple
        raise StereoConfig(
            f"disparities {disparities} for images {width_px} px wide",
            want=f"at most {largest}" if largest else f"images wider than {multiple} px",
            fix="Lower --matcher.disparities, or raise --min-depth.",
            where="disparities",
        )
