"""The beginning of a recording: who wrote it, with which settings and calibration."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from mcap.records import Attachment, AttachmentIndex, Header, Metadata, MetadataIndex

from pseudolidar.formats.mcap.content import DEFAULT_CONTENT, McapContent
from pseudolidar.formats.mcap.profiles import profile_of
from pseudolidar.formats.mcap.records import MAGIC, record_bytes
from pseudolidar.formats.mcap.summary import SummaryBuilder
from pseudolidar.structures.disparity import RADIUS_95_PER_SIGMA

LIBRARY = "pseudolidar"


@dataclass(frozen=True)
class McapProlog:
    """What a recording says about itself; nothing that changes from run to run.

    Args:
        metadata: stored as the metadata record `pseudolidar`.
        attachments: texts by file name, such as `calibration.json`.
        profile: as the header names it: `ros2`, or empty.
    """

    metadata: Mapping[str, str]
    attachments: Mapping[str, str] = field(default_factory=dict)
    profile: str = ""


def describe_recording(
    *,
    version: str,
    settings: str,
    calibration: str,
    matcher: str,
    source: str,
    time: str = "recorded",
    poses: str = "of the source",
    content: McapContent = DEFAULT_CONTENT,
) -> McapProlog:
    """The prologue of a recording of this package.

    Args:
        version: of the package.
        settings: resolved settings as text.
        calibration: of the cameras as JSON text; attached.
        matcher: name and settings of the matcher.
        source: kind and name of the source; no path.
        time: `recorded`, or `synthetic` where the source has no times.
        poses: where they come from, or `none: map, odom and base_link coincide`.
        content: what frames hold.
    """
    metadata = {
        "version": version,
        "settings": settings,
        "settings_sha256": hashlib.sha256(settings.encode()).hexdigest(),
        "calibration_sha256": hashlib.sha256(calibration.encode()).hexdigest(),
        "matcher": matcher,
        "source": source,
        "time": time,
        "poses": poses,
        "units": "points m, disparity px, depth image mm, time ns",
        "sigma_m": "one standard deviation (68 %) of a point along its ray, m",
        "radius_95_per_sigma": f"{RADIUS_95_PER_SIGMA}",
        "points_per_message": _points_text(content.max_points),
    }
    header = profile_of(content).header
    return McapProlog(metadata, {"calibration.json": calibration}, header)


def _points_text(most: int) -> str:
    if not most:
        return "all"
    return (
        f"at most {most}; of larger clouds each point stays with a chance in proportion to "
        "range^2 and to its certainty, up to 1: the log has the counts"
    )


def prolog_bytes(prolog: McapProlog, builder: SummaryBuilder) -> bytes:
    """The file up to the first frame; `builder` notes where its records stand."""
    metadata = Metadata(name=LIBRARY, metadata=dict(prolog.metadata))
    data = MAGIC + record_bytes(Header(profile=prolog.profile, library=LIBRARY))
    record = record_bytes(metadata)
    builder.add_metadata(MetadataIndex(offset=len(data), length=len(record), name=LIBRARY))
    data += record
    for name, text in prolog.attachments.items():
        content, kind = (
            text.encode(),
            "application/json" if name.endswith(".json") else "text/plain",
        )
        record = record_bytes(
            Attachment(create_time=0, log_time=0, name=name, media_type=kind, data=content)
        )
        builder.add_attachment(
            AttachmentIndex(
                offset=len(data),
                length=len(record),
                log_time=0,
                create_time=0,
                data_size=len(content),
                name=name,
                media_type=kind,
            )
        )
        data += record
    return data
