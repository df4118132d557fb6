"""`metadata.yaml`: what makes a folder with recordings of the ROS 2 profile a bag.

Source: rosbag2, metadata of version 8.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Statistics

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.mcap.ros2 import CDR, QOS

VERSION = 8


def write_bag_metadata(path: Path, recordings: Sequence[Path]) -> None:
    """Describe complete recordings that lie beside `path`.

    Raises:
        OutputError: it cannot be written.
    """
    channels: dict[str, tuple[Channel, str]] = {}
    counts: Counter[str] = Counter()
    statistics = []
    for recording in recordings:
        with recording.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        statistics.append(summary.statistics)
        for number, count in summary.statistics.channel_message_counts.items():
            channel = summary.channels[number]
            channels[channel.topic] = channel, summary.schemas[channel.schema_id].name
            counts[channel.topic] += count
    names = [recording.name for recording in recordings]
    text = _text(names, statistics, channels, counts)
    write_atomic(path, text.encode())


def _text(
    names: Sequence[str],
    statistics: Sequence[Statistics],
    channels: dict[str, tuple[Channel, str]],
    counts: Counter[str],
) -> str:
    known = [s for s in statistics if s.message_count]
    start = min((s.message_start_time for s in known), default=0)
    end = max((s.message_end_time for s in known), default=0)
    lines = [
        "rosbag2_bagfile_information:",
        f"  version: {VERSION}",
        "  storage_identifier: mcap",
        f"  duration:\n    nanoseconds: {end - start}",
        f"  starting_time:\n    nanoseconds_since_epoch: {start}",
        f"  message_count: {counts.total()}",
        "  topics_with_message_count:" + ("" if channels else " []"),
    ]
    for topic in sorted(channels):
        channel, schema = channels[topic]
        qos = channel.metadata.get(QOS, "").replace("\n", "\\n")
        lines += [
            "    - topic_metadata:",
            f'        name: "{topic}"',
            f"        type: {schema}",
            f"        serialization_format: {CDR}",
            f'        offered_qos_profiles: "{qos}"',
            '        type_description_hash: ""',
            f"      message_count: {counts[topic]}",
        ]
    lines += ['  compression_format: ""', '  compression_mode: ""', "  relative_file_paths:"]
    lines += [f'    - "{name}"' for name in names]
    lines.append("  files:")
    for name, of_file in zip(names, statistics, strict=True):
        lasts = of_file.message_end_time - of_file.message_start_time
        lines += [
            f'    - path: "{name}"',
            f"      starting_time:\n        nanoseconds_since_epoch: {of_file.message_start_time}",
            f"      duration:\n        nanoseconds: {lasts}",
            f"      message_count: {of_file.message_count}",
        ]
    return "\n".join([*lines, "  custom_data: ~", "  ros_distro: humble"]) + "\n"
