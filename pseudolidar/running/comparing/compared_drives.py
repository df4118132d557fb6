"""Every drive of a folder compared by itself, then the points of all together."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

from pseudolidar.errors import EnvironmentFault, PseudolidarError, SourceUnknown, UsageError
from pseudolidar.evaluation.comparison.bins import DepthBins
from pseudolidar.evaluation.comparison.pooled import PointPool
from pseudolidar.running.comparing.drives import FoundDrive
from pseudolidar.running.reports.comparison_report import ComparisonReport
from pseudolidar.running.reports.drives_report import DrivesReport
from pseudolidar.sources.recognise import Source

_log = logging.getLogger(__name__)


def compared_drives(
    drives: Iterable[FoundDrive],
    compare: Callable[[str, Source], ComparisonReport],
    bins: DepthBins,
    *,
    most: int,
) -> DrivesReport:
    """Compare drive after drive; those that cannot be compared are left out, with the reason.

    Args:
        drives: by name.
        compare: a drive's name and settings to its report.
        bins: of depth, m.
        most: points that are kept of all drives together.

    Raises:
        PseudolidarError: that of the first drive, where none can be compared.
        EnvironmentFault, UsageError: what would stop the next drive as well.
    """
    pool = PointPool(bins, most=most)
    reports, failed = dict[str, ComparisonReport](), dict[str, PseudolidarError]()
    for drive in drives:
        _log.info("drive: %s", drive.name)
        try:
            if drive.source is None:
                raise drive.error or SourceUnknown(drive.name)
            report = compare(drive.name, drive.source)
            pool.add(report.comparison)
            reports[drive.name] = report.without_points()
        except (EnvironmentFault, UsageError):
            raise
        except PseudolidarError as error:
            failed[drive.name] = error
    if not reports:
        raise next(iter(failed.values()))
    return DrivesReport(reports, failed, pool.figures())
