"""Makes pages of our own in threads, so that none of them holds up the others."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, defaultdict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from urllib.parse import parse_qsl

from pseudolidar.viewer.answers import Answer, Page, status_alone

_log = logging.getLogger(__name__)

# Parts of a query.
MOST_PARTS = 32
# Of one page so many are made at the same time, so many more may wait, and all have these threads.
AT_ONCE, MOST_WAITING, THREADS = 2, 64, 16


class Answering:
    """Answers what is asked of pages.

    One that takes long to make (a file of a large cloud) cannot take all threads, and one that is
    asked for without end is refused.

    Args:
        pages: by path, added to at any time.
    """

    def __init__(self, pages: Mapping[str, Page]) -> None:
        self._pages = pages
        self._turns: dict[str, asyncio.Semaphore] = defaultdict(lambda: asyncio.Semaphore(AT_ONCE))
        self._asked: Counter[str] = Counter()
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix="viewer-pages")

    async def answer(self, target: str) -> Answer:
        """What a page says; a page that fails, or that is none, says only that.

        Args:
            target: path and query as they were sent.
        """
        path, _, text = target.partition("?")
        page = self._pages.get(path)
        if page is None:
            return status_alone(HTTPStatus.NOT_FOUND)
        try:
            query = dict(parse_qsl(text, keep_blank_values=True, max_num_fields=MOST_PARTS))
        except ValueError:
            return status_alone(HTTPStatus.BAD_REQUEST)
        if self._asked[path] >= AT_ONCE + MOST_WAITING:
            return status_alone(HTTPStatus.SERVICE_UNAVAILABLE)
        self._asked[path] += 1
        try:
            async with self._turns[path]:
                loop = asyncio.get_running_loop()
                return await loop.run_in_executor(self._threads, page, query)
        except Exception as error:  # a page that fails fails alone
            _log.warning("%s cannot be made: %s", path, type(error).__name__)
            return status_alone(HTTPStatus.INTERNAL_SERVER_ERROR)
        finally:
            self._asked[path] -= 1
