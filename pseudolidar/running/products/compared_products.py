"""What a compared frame becomes in the output folder."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.comparison.error_cloud import (
    clouds_together,
    error_cloud,
    reference_points,
)
from pseudolidar.formats.points.ply import encode_ply
from pseudolidar.geometry.cloud_frames import default_frame, left_in
from pseudolidar.geometry.depth import depth_map
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.compared_file import compared_name, encode_compared
from pseudolidar.running.products.compared_outputs import TOGETHER
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import FrameEncoder
from pseudolidar.running.products.product import Product
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame


@dataclass(frozen=True)
class ComparedEncoder:
    """Encodes everything that is written of a compared frame: pure, picklable.

    Args:
        encode: of the cloud coloured by its error, and of the sample for the report.
        together: whether to write both clouds in one file.
        most: reference points to keep.
    """

    encode: FrameEncoder
    together: bool
    most: int

    def __call__(
        self,
        frame: StereoFrame,
        disparity: DisparityMap,
        stereo: PointCloud,
        compared: ComparedFrame,
    ) -> Product:
        """Bytes of the files and of the recording's parts.

        Args:
            frame: with the scan that it was compared with, if it was one.
            disparity: of its left image.
            stereo: its cloud, in the left camera's frame.
            compared: it and all its reference points.
        """
        T_frame_left = left_in(frame.rig, default_frame(frame.rig))
        coloured = error_cloud(stereo, compared).transformed(T_frame_left)
        depth = depth_map(disparity, frame.rig)
        product = self.encode(Converted(frame, coloured, disparity, depth))
        kept = encode_compared(compared.thinned(self.most))
        files = [*product.files, OutputFile.of(compared_name(frame.id), kept)]
        if self.together:
            reference = reference_points(frame, compared, scanned=frame.scan is not None)
            both = clouds_together(stereo, reference).transformed(T_frame_left)
            files.append(OutputFile.of(f"{TOGETHER}/{frame.id}.ply", encode_ply(both)))
        return Product(tuple(files), product.parts)
