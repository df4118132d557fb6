"""Fit the census matcher's sigma models to KITTI stereo 2015; prints what `stereo/census.py` holds.

    python -m tests.benchmarks.fit_sigma [TRAINING_FOLDER]

The rig's disparity correction is fitted first and taken off: sigma is what remains of a pixel.
"""

from __future__ import annotations

import sys

import numpy as np

from pseudolidar.calibration.refine import fit
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.stereo.census import Census, CensusMatcher
from pseudolidar.stereo.sigma_model import fit_sigma
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.disparity import RADIUS_95_PER_SIGMA
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples
from tests.conftest import DATA

EVERY_NTH_PIXEL = 5


def errors_and_features(
    matcher: CensusMatcher, frames: list[StereoFrame]
) -> tuple[Float64, Float64]:
    """(N,) px errors with the systematic part removed, and (N, 5) features."""
    columns: list[tuple[Float64, ...]] = []
    features = []
    for index, frame in enumerate(frames):
        evidence = matcher.evidence(frame)
        assert frame.truth is not None
        where = (evidence.disparity > 0) & frame.truth.valid
        v, u = (a[::EVERY_NTH_PIXEL].astype(np.float64) for a in np.nonzero(where))
        measured = evidence.disparity[where][::EVERY_NTH_PIXEL].astype(np.float64)
        reference = frame.truth.values[where][::EVERY_NTH_PIXEL].astype(np.float64)
        columns.append((measured, reference, u, v, np.full(len(u), index)))
        features.append(evidence.features(where)[::EVERY_NTH_PIXEL])
    measured, reference, u, v, index = (np.concatenate(c) for c in zip(*columns, strict=True))
    size = frames[0].size_px
    samples = DisparitySamples(measured, reference, u, v, index.astype(np.int64), size)
    errors = measured - fit(samples).offset_px(measured, u, v, size) - reference
    return errors, np.concatenate(features)


def main() -> None:
    """Fit both qualities and say how well the result is calibrated on its own data."""
    folder = sys.argv[1] if len(sys.argv) > 1 else str(DATA / "kitti_stereo2015" / "training")
    source = KittiStereo(folder).open()
    frames = [source.load(i) for i in range(len(source.ids))]
    for quality in ("fast", "fine"):
        errors, features = errors_and_features(Census(quality=quality).load(), frames)
        model = fit_sigma(features, errors)
        ratio = np.abs(errors) / model.sigma_px(features)
        print(f'"{quality}": {model},')
        print(
            f"  within sigma {np.mean(ratio < 1):.4f}, "
            f"within the 95 % radius {np.mean(ratio < RADIUS_95_PER_SIGMA):.4f}"
        )


if __name__ == "__main__":
    main()
