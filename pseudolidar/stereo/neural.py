"""Two-image stereo networks in ONNX files behind the matcher protocol."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pseudolidar.errors import PseudolidarError, StereoConfig
from pseudolidar.formats.onnx.licence import licence_of
from pseudolidar.formats.onnx.model import OnnxModel, check_sha256, read_onnx
from pseudolidar.formats.onnx.session import NetworkSession, Provider
from pseudolidar.geometry.grey import grey8_pair, rgb8, shift_to_8_bits
from pseudolidar.stereo.disparity_range import check_min_depth, disparity_range
from pseudolidar.stereo.networks.layout import NetworkLayout, layout_beside
from pseudolidar.stereo.networks.names import expected_layout, family_of
from pseudolidar.stereo.networks.sizes import padded, resized, tiled
from pseudolidar.structures.arrays import Float32, Image, UInt8
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M, DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.image_size import ImageSize

if TYPE_CHECKING:
    from pseudolidar.stereo.networks.trial import TrialResult

_log = logging.getLogger(__name__)
# Digits of a hash that are shown to people.
SHOWN = 12


@dataclass(frozen=True)
class Onnx:
    """A stereo network in an ONNX file, run by onnxruntime.

    How it is fed and read follows from the flags, else from its metadata or a JSON file of its name
    beside it, else from names and shapes, and is found out or confirmed by a pair of known
    disparity. `docs/networks.md` names networks and their licences.

    Args:
        path: the network, a .onnx file.
        layout: what is known of how it is fed and read.
        probe: show it pairs of known disparity; otherwise flags, file and names must tell all.
        consistency: run the mirrored pair too, which costs double, and keep what agrees.
        agreement_px: largest left-right difference then.
        size: size that pictures are brought to, such as 640x384, for networks of free size.
        tile: run on tiles of this size, where a whole picture needs too much memory.
        iterations: for networks that ask for a number of them.
        max_disparity: larger ones are not believed, px; by default the picture's width.
        sigma_scale: factor on sigma, as `evaluate disparity` tells.
        provider: where it runs: cpu, cuda, tensorrt, openvino, coreml, directml, or auto.
        threads: of one frame; 1 is best where frames run side by side.
        sha256: refuse any other file.
        trial_seconds: time for the trial of a file that was not run before.
        trial_memory_mb: memory for it.
    """

    path: Path
    layout: NetworkLayout = field(default_factory=NetworkLayout)
    probe: bool = True
    consistency: bool = False
    agreement_px: float = 1.0
    size: ImageSize | None = None
    tile: ImageSize | None = None
    iterations: int = 16
    max_disparity: float | None = None
    sigma_scale: float = 1.0
    provider: Provider = "cpu"
    threads: int = 1
    sha256: str | None = None
    trial_seconds: float = 300.0
    trial_memory_mb: int = 8192
    compares_brightness: ClassVar[bool] = True  # they were trained on pairs that are alike

    def __post_init__(self) -> None:
        names = ("agreement_px", "iterations", "sigma_scale", "threads", "trial_seconds")
        for name in (*names, "trial_memory_mb", "max_disparity"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise StereoConfig(f"{name} {value}", want="a positive number", where=name)
        if self.size is not None and self.tile is not None:
            raise StereoConfig("both a size and tiles", want="one of the two", where="size, tile")

    def load(self, *, min_depth_m: float = DEFAULT_MIN_DEPTH_M) -> NetworkMatcher:
        """The matcher; says in one line what it found out about the network.

        Raises:
            ModelError: the file cannot be used, or its layout cannot be told.
            MissingDependency: the provider is not there.
        """
        check_min_depth(min_depth_m)
        model = read_onnx(self.path)
        check_sha256(model, self.sha256)
        result, decided_by = self._settled(model)
        matcher = NetworkMatcher(self, model, result.layout, min_depth_m)
        file = f"sha256 {model.sha256()[:SHOWN]}, licence: {licence_of(model)}"
        where = f"{matcher.session.provider}, {self.threads} thread(s) a frame"
        words = "network: %s; told by %s; %s; runs on %s"
        _log.info(words, result.layout, decided_by, file, where)
        return matcher

    def _settled(self, model: OnnxModel) -> tuple[TrialResult, str]:
        """The complete layout, and what told it."""
        from pseudolidar.stereo.networks.probe import not_recognised
        from pseudolidar.stereo.networks.trial import TrialRequest, tried

        beside = layout_beside(model)
        known = self.layout.filled(beside)
        expected, family = expected_layout(model, known), family_of(model)
        open_fields = set(known.unknown) - {"pad", "channel"}
        probe = self.probe and bool(open_fields)
        if not self.probe and set(known.filled(expected).unknown) - {"pad", "channel"}:
            raise not_recognised(model, None, 0)
        request = TrialRequest(known, expected, probe, self.iterations)
        result = tried(model, request, seconds=self.trial_seconds, memory_mb=self.trial_memory_mb)
        told = ["flags"] * (self.layout != NetworkLayout())
        told += ["its file"] * (beside != NetworkLayout())
        told += [f"names ({family.name if family else 'no known family'})"] * bool(open_fields)
        if result.found is not None:
            told.append(f"a probe ({result.found:.0%} of a known scene found)")
        return result, ", ".join(told) + (", cached" if result.cached else "")


@dataclass(eq=False)
class NetworkMatcher:
    """A loaded `Onnx`; one session for all threads, made anew where it was pickled to."""

    settings: Onnx
    model: OnnxModel
    layout: NetworkLayout
    min_depth_m: float
    _session: NetworkSession | None = field(default=None, repr=False)
    _making: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        kept = ("settings", "model", "layout", "min_depth_m")
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _session=None, _making=threading.Lock())

    @property
    def session(self) -> NetworkSession:
        """The network, ready to run."""
        with self._making:
            if self._session is None:
                s = self.settings
                self._session = NetworkSession(self.model, s.provider, s.threads)
            return self._session

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image with sigma.

        Raises:
            ModelOutput: the network's answer means nothing.
            ModelError: it does not take the frame.
            StereoConfig: tiles are too small for the range.
        """
        from pseudolidar.stereo.networks.evidence import with_evidence

        s = self.settings
        # Only tiles must know how far matches may lie.
        range_px = disparity_range(frame.rig, self.min_depth_m) if s.tile is not None else 0
        left, right = rgb8_pair(frame.left, frame.right)
        try:
            disparity = self.disparity(left, right, range_px)
            of_right = self._of_right(left, right, range_px) if s.consistency else None
        except PseudolidarError as error:
            raise error.located(self.model.path, f"frame {frame.id}") from None
        grey_left, grey_right = grey8_pair(frame.left, frame.right)
        return with_evidence(
            grey_left,
            grey_right,
            disparity,
            of_right=of_right,
            agreement_px=s.agreement_px,
            largest_px=s.max_disparity or float(frame.size_px[0]),
            sigma_scale=s.sigma_scale,
        )

    def describe(self) -> dict[str, Any]:
        """What ran, plain JSON values: file, hash, licence, layout, provider."""
        return {
            "file": self.model.path.name,
            "sha256": self.model.sha256(),
            "licence": licence_of(self.model),
            "signature": self.model.signature,
            "layout": self.layout.as_dict(),
            "provider": self.session.provider,
        }

    def disparity(self, left: UInt8, right: UInt8, range_px: int) -> Float32:
        """(H, W) px as the network has it, at the size of the pictures."""
        from pseudolidar.stereo.networks.probe import network_size

        own = network_size(self.model, self.layout.roles)
        own_size = None if own is None else ImageSize(*own)
        if (tile := self.settings.tile) is not None:
            if own_size is not None and tile != own_size:
                raise StereoConfig(
                    f"tiles of {tile}", want=f"{own_size}, the network's own size", where="tile"
                )
            if left.shape[0] >= tile.height and left.shape[1] >= tile.width:
                return tiled(self._fitted, left, right, tile, range_px)
        return self._fitted(left, right)

    def _of_right(self, left: UInt8, right: UInt8, range_px: int) -> Float32:
        """(H, W) px of the right image: the mirrored pair has its eyes exchanged."""
        pair = [np.ascontiguousarray(image[:, ::-1]) for image in (right, left)]
        return np.ascontiguousarray(self.disparity(pair[0], pair[1], range_px)[:, ::-1])

    def _fitted(self, left: UInt8, right: UInt8) -> Float32:
        from pseudolidar.stereo.networks.probe import network_size

        own = network_size(self.model, self.layout.roles)
        size = self.settings.size if own is None else ImageSize(*own)
        if size is not None:
            return resized(self._padded, left, right, size)
        return self._padded(left, right)

    def _padded(self, left: UInt8, right: UInt8) -> Float32:
        return padded(self._run, left, right, self.layout.pad or 1)

    def _run(self, left: UInt8, right: UInt8) -> Float32:
        from pseudolidar.stereo.networks.feed import tensors
        from pseudolidar.stereo.networks.reading import chosen_map, disparity_px, output_maps

        given = tensors(self.model, self.layout, left, right, iterations=self.settings.iterations)
        maps = output_maps(self.session.outputs, self.session(given))
        height, width = left.shape[:2]
        return disparity_px(chosen_map(maps, self.layout), self.layout, (width, height))


def rgb8_pair(left: Image, right: Image) -> tuple[UInt8, UInt8]:
    """Both images as (H, W, 3) uint8, those of 16 bits by one shift for both."""
    shift = shift_to_8_bits(left, right)
    return rgb8(left, shift), rgb8(right, shift)
