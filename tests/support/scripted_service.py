"""A store whose service gives fixed answers, in turn."""

import httpx

from ssil_data.client import RemoteStore, RetryPolicy, connect

QUICK = RetryPolicy(first=0.001, longest=0.01, total=1.0)


LISTED = {"datasets": [{"dataset": "drives"}]}


BUSY = {"status": 503, "title": "Busy", "detail": "busy"}


def scripted_store(*answers: httpx.Response | Exception) -> tuple[RemoteStore, list[httpx.Request]]:
    """A store whose service gives these answers in turn."""
    seen: list[httpx.Request] = []
    left = iter(answers)

    def answer(request: httpx.Request) -> httpx.Response:
        seen.append(request)
        found = next(left)
        if isinstance(found, Exception):
            raise found
        return found

    transport = httpx.MockTransport(answer)
    return connect("http://service", "the key", retry=QUICK, transport=transport), seen
