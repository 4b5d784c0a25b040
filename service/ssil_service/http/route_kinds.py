"""What the middleware must know of a request before the router has seen it: one table.

Limits depend on what a request is for: an upload may be larger than a query, an event stream may
last for hours, a refused change may or may not have been made. A new route is entered here if it
is a query (POST that changes nothing), an upload, an event stream or a health check; a test
compares the table with the OpenAPI document.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from ssil_service.security.hosts import SAFE

QUERIES = ("/lcor", "/cor", "/score", "/infer")
"""Ends of the paths at which a POST is a query and changes nothing."""
UPLOADS = ("/episodes",)
"""Ends of the paths at which a POST uploads episodes; every PUT uploads a dataset."""
EVENT_STREAMS = re.compile(r"/v1/jobs/[^/]*/events")
"""Paths whose answers last as long as the job that they follow."""
HEALTH_CHECKS = ("/healthz", "/readyz", "/v2/health/live", "/v2/health/ready")
"""Paths that are answered however many requests are in flight."""


class RouteKind(NamedTuple):
    """How a request is limited, by its method and path.

    Attributes
    ----------
    read_only
        It changes neither the store nor a job, so that it may be repeated after any refusal.
    upload
        Its body goes to the disk as it arrives, and may be as long as `--upload-bytes`.
    event_stream
        Its answer goes on as long as a job; counted apart from other requests.
    health_check
        It is answered even when there are too many requests.
    """

    read_only: bool
    upload: bool
    event_stream: bool
    health_check: bool

    @classmethod
    def of(cls, method: str, path: str) -> RouteKind:
        """Find the kind of a request.

        Parameters
        ----------
        method
            HTTP method in upper case.
        path
            Decoded path, without the query.

        Returns
        -------
        RouteKind
            Also for paths that no route has: the router answers 404 later.
        """
        posts = method == "POST"
        return cls(
            read_only=method in SAFE or (posts and path.endswith(QUERIES)),
            upload=method == "PUT" or (posts and path.endswith(UPLOADS)),
            event_stream=EVENT_STREAMS.fullmatch(path) is not None,
            health_check=path in HEALTH_CHECKS,
        )
