"""Errors a user can act on: what was found, where, what was wanted, what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Self

# Process status of a run without an error: all frames done, or some skipped and reported.
ALL_DONE, SOME_SKIPPED = 0, 4


class PseudolidarError(Exception):
    """Base of all errors this package raises on purpose.

    Args:
        got: what was found, in words or as a value.
        want: what was expected.
        fix: what the user can do about it.
        path: file or folder concerned.
        where: place in it: a line, byte offset, field or frame.

    `code` is the class name, a stable identifier; `exit_code` is the process status the command
    line ends with; `advice` is what to do where nothing more particular is said.
    """

    exit_code: ClassVar[int] = 3
    advice: ClassVar[str] = ""

    def __init__(
        self,
        got: str,
        *,
        want: str = "",
        fix: str = "",
        path: str | Path | None = None,
        where: str = "",
    ) -> None:
        super().__init__(got)
        self.got, self.want, self.fix, self.where = got, want, fix or self.advice, where
        self.path = None if path is None else str(path)

    @property
    def code(self) -> str:
        """Stable identifier of the kind of error."""
        return type(self).__name__

    def located(self, path: str | Path, where: str = "") -> Self:
        """The same error with the file (and place) filled in where it was not known yet."""
        if self.path is None:
            self.path = str(path)
        self.where = self.where or where
        return self

    def as_dict(self) -> dict[str, Any]:
        """The fields of the `--json` error object."""
        fields = ("path", "where", "got", "want", "fix", "code", "exit_code")
        return {name: getattr(self, name) for name in fields}

    def __str__(self) -> str:
        place = ": ".join(printable(part) for part in (self.path, self.where) if part)
        text = f"{self.code}: " + (f"{place}: " if place else "") + self.got
        if self.want:
            text += f"; wanted {self.want}"
        return text + (f". {self.fix}" if self.fix else "")

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.got, self.want, self.fix, self.path, self.where)


def _rebuild(
    kind: type[PseudolidarError], got: str, want: str, fix: str, path: str | None, where: str
) -> PseudolidarError:
    return kind(got, want=want, fix=fix, path=path, where=where)


def printable(text: str) -> str:
    """Text safe to print on one line: control characters and undecodable bytes escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )


# --- usage (2) -----------------------------------------------------------------------------


class UsageError(PseudolidarError):
    """The command was called in a way that cannot be meant."""

    exit_code = 2


class OutputSettings(UsageError):
    """The output folder holds a run with other settings or of another version."""


# --- input refused (3) ---------------------------------------------------------------------


class LimitError(PseudolidarError):
    """An input claims to be larger than the configured cap."""

    advice = "Check the file; if it really is that large, raise the cap."


class ImageMissing(PseudolidarError):
    """An image file that the sequence names is not there."""

    advice = "Copy the file, or leave its frame out with --exclude."


class ImageUnreadable(PseudolidarError):
    """An image file cannot be decoded."""

    advice = "Copy or make the file again, or leave its frame out with --exclude."


class ImageTruncated(ImageUnreadable):
    """An image file ends early; a decoder would invent its lower part."""


class ImageFormat(PseudolidarError):
    """An image has a pixel layout that has no meaning here."""

    advice = "Save the picture again, as grey or colour of 8 or 16 bits."


class VideoUnreadable(PseudolidarError):
    """A video file cannot be opened, or holds no frame."""

    advice = "Copy the video again, or write it anew with another program."


class VideoDamaged(PseudolidarError):
    """A frame of a video is not there whole; a decoder would invent the rest."""

    advice = "Copy the video again."


class PairMismatch(PseudolidarError):
    """Left and right images differ in size or depth."""

    advice = "Check that both pictures are of one pair, or leave it out with --exclude."


class PairIdentical(PseudolidarError):
    """Left and right are the same image."""

    advice = "Check that both folders are not the same."


class PairSwapped(PseudolidarError):
    """The left picture is the right eye's."""

    advice = "Pass --swap, or store the pictures the other way round."


class NotRectified(PseudolidarError):
    """Rows of the pair are not aligned."""

    advice = "Rectify the pictures first."


class LowTexture(PseudolidarError):
    """Almost no pixel of the pair can be matched."""

    advice = "Leave the frame out with --exclude."


class CloudEmpty(PseudolidarError):
    """No point is left of a pair that could be matched."""

    advice = "Leave the frame out with --exclude."


class MapEmpty(PseudolidarError):
    """A depth or disparity map holds no value."""

    advice = "Make the map again, or leave its frame out with --exclude."


class MapScale(PseudolidarError):
    """A map that somebody else made is in another unit than it is read in."""

    advice = "Say the unit with --map-scale."


class StereoConfig(PseudolidarError):
    """A matcher setting is outside its legal values."""

    advice = "Change the setting."


class ModelError(PseudolidarError):
    """A network file cannot be used: damaged, unsafe, or of a layout nobody could tell."""

    advice = "Export the network again, or take another one."


class ModelOutput(PseudolidarError):
    """A network's answer for a frame means nothing: not a number, or the same everywhere."""

    advice = "Check the layout of the network, or take another one."


class CalibrationMissing(PseudolidarError):
    """A source has no calibration."""

    advice = "Pass the calibration with --rig."


class CalibrationField(PseudolidarError):
    """A calibration file lacks a field, or holds it twice."""

    advice = "Mend the file, or pass another calibration with --rig."


class CalibrationSyntax(PseudolidarError):
    """A calibration file cannot be parsed: wrong count or form of numbers."""

    advice = "Mend the file there, or pass another calibration with --rig."


class CalibrationValue(PseudolidarError):
    """A calibration value is impossible."""

    advice = "Mend the file, or pass another calibration with --rig."


class CalibrationUnits(PseudolidarError):
    """A calibration does not say its unit of length, and metres cannot be meant."""

    advice = "Say the unit with --rig-unit."


class CalibrationSizeMismatch(PseudolidarError):
    """Images have another size than the calibration is for."""

    advice = "Pass --scale-calibration if the pictures were resized, or the right rig."


class MotionInsufficient(PseudolidarError):
    """The motion of a sequence does not carry the estimate that is asked of it."""

    advice = "Take a longer part of the drive, with turns in it."


class BoardNotFound(PseudolidarError):
    """A calibration board is seen in too few pictures, or by one eye only."""

    advice = "Check --board and --square, and that both eyes see the board."


class OverlapInsufficient(PseudolidarError):
    """The pairs of a body see too little in common to tell where they stand to each other."""

    advice = "Take frames with walls and things that neighbouring pairs see, at several distances."


class InputChanged(PseudolidarError):
    """A file was written to while it was read."""

    advice = "Wait until it is complete, and run the same command again."


class PointFileMissing(PseudolidarError):
    """A point file is not there."""

    advice = "Check the path."


class PointFileTruncated(PseudolidarError):
    """A point file holds fewer bytes than it claims, or a fraction of a point."""

    advice = "Copy or make the file again: it ends early."


class PointFileCorrupt(PseudolidarError):
    """A point file contradicts itself."""

    advice = "Make the file again with the program that wrote it."


class PointFileHeader(PointFileCorrupt):
    """A point file's header is not legal."""


class PointFileField(PseudolidarError):
    """A point file lacks x, y or z."""

    advice = "Check that the file holds points."


class MeshIndex(PointFileCorrupt):
    """A face of a mesh names a vertex that is not there."""

    advice = "Make the file again, or save its points alone."


class LabelError(PseudolidarError):
    """A label file line is not legal."""

    advice = "Mend the line, or leave its frame out with --exclude."


class PoseFileError(PseudolidarError):
    """A pose file row is not a rigid transform, or rows are missing."""

    advice = "Mend the file, or remove it to go without poses."


class PoseMissing(PseudolidarError):
    """Nothing is known of where a frame was taken, and something needs it."""

    advice = "Take a source that has poses."


class SequenceTime(PseudolidarError):
    """Time stamps are not increasing or not plausible."""

    advice = "Mend the times, or pass --source.synthetic-times where the source has it."


class OdometryLost(PseudolidarError):
    """A path ends: too many frames in a row tell nothing, or nothing joins what is seen next."""

    advice = "Leave those frames out with --exclude, or see what report.html says of each."


class SourceUnknown(PseudolidarError):
    """What a path is could not be recognised."""

    advice = "Check the path."


class SourceEmpty(PseudolidarError):
    """A source has no usable frame."""

    advice = "Check the path, --frames and --exclude."


class NoPairs(PseudolidarError):
    """A source has no rectified pairs where only they will do."""

    advice = "Take a source of rectified pairs."


class NoClouds(PseudolidarError):
    """A source has no ready-made clouds where only they will do."""

    advice = "Take a source of clouds, or make clouds of the pairs with convert."


class RecordingError(PseudolidarError):
    """A recording (MCAP) is broken or contradicts itself."""

    advice = "Record or copy the file again; recover saves what is whole of it."


class ScanMissing(PseudolidarError):
    """A LiDAR scan is needed where there is none."""

    advice = "Take a source with Velodyne scans."


class ReferenceMissing(PseudolidarError):
    """An evaluation was asked for where there is no ground truth."""

    advice = "Take a source with ground truth, or name it with --reference."


class EyesApart(PseudolidarError):
    """Two cameras take their pictures at different moments."""

    advice = "Let one camera trigger the other, or allow more by --camera.tolerance-s."


class CaptureEnded(PseudolidarError):
    """There are no more pairs: files are played, a limit is reached, or somebody said stop."""

    advice = "Run the same command again to go on."


class TooManyBadFrames(PseudolidarError):
    """So many frames failed that the run stopped."""

    advice = "See report.json for each of them; leave them out with --exclude."


class FrameError(PseudolidarError):
    """Wrapper: an unexpected failure while one frame was processed."""

    advice = "Run with --debug to see where, and tell the authors."


class FrameTimeout(PseudolidarError):
    """A frame did not end in time."""

    advice = "Raise --timeout, or leave the frame out with --exclude."


class MemoryLimit(PseudolidarError):
    """A frame needs more memory than there is, or than its worker may have."""

    advice = "Raise --memory-limit, or leave the frame out with --exclude."


class NativeCrash(PseudolidarError):
    """A library crashed on a frame, and took the frame's process with it."""

    advice = "Leave the frame out with --exclude."


class StructureError(PseudolidarError):
    """An array or value handed to a noun has the wrong shape, dtype or meaning."""


# --- environment (5) -----------------------------------------------------------------------


class EnvironmentFault(PseudolidarError):
    """The environment stopped the run; it can be resumed."""

    exit_code = 5


class OutputError(EnvironmentFault):
    """Writing failed: disk full, read-only, no permission."""

    advice = "Choose another output folder."


class OutputLocked(EnvironmentFault):
    """Another run is writing to the same folder."""

    advice = "Wait for the other run, or choose another output folder."


class CameraFault(EnvironmentFault):
    """A camera does not give pictures; what was made of the earlier ones is whole."""

    advice = "Check its cable and power, then run the same command again: it adds to what is there."


class CameraUnavailable(CameraFault):
    """A camera is not there, cannot be opened, or is taken by another program."""

    advice = "Check which cameras there are: v4l2-ctl --list-devices."


class CameraLost(CameraFault):
    """A camera that gave pictures is gone."""


class CameraStalled(CameraFault):
    """A camera gives no pictures any more, without saying why."""


class CameraChanged(CameraFault):
    """A camera gives pictures of another size than before."""

    advice = "Fix the size with --camera.size."


class ServeError(EnvironmentFault):
    """The viewer cannot be served: its port is taken, or its host is none of this machine."""

    advice = "Choose another with --port (0 for any that is free) and --host."


class MissingDependency(EnvironmentFault):
    """A library or system component is absent or does not load."""

    advice = "Run pseudolidar doctor."


# --- workers (6) -----------------------------------------------------------------------------


class WorkerFault(PseudolidarError):
    """Workers cannot do anything; the run can be resumed once they can."""

    exit_code = 6
    advice = "Run the same command again: it continues where it stopped."


# --- interrupted (130) ---------------------------------------------------------------------


class Interrupted(PseudolidarError):
    """The run was interrupted by a signal; it can be resumed."""

    exit_code = 130
