"""Pages of what a run says, and answers that the client has already."""

import httpx


def test_an_unchanged_answer_is_304(http: httpx.Client):
    for path in (
        "v1/datasets",
        "v1/datasets/drives",
        "v1/datasets/drives/episodes",
        "v1/datasets/drives/pairs",
        "v1/datasets/drives/runs",
        "v1/datasets/drives/runs/vae",
        "v1/datasets/drives/runs/vae/leverage",
    ):
        tag = http.get(path).headers["etag"]
        again = http.get(path, headers={"If-None-Match": f'"other", {tag}'})
        assert (again.status_code, again.content) == (304, b"")
        assert http.get(path, headers={"If-None-Match": '"other"'}).status_code == 200
        assert http.get(path, headers={"If-None-Match": "*"}).status_code == 304
        assert http.get(path, headers={"If-None-Match": '"*"'}).status_code == 200
        assert http.head(path, headers={"If-None-Match": tag}).status_code == 304


def test_leverage_is_filtered_by_episode_and_steps_and_paged(http: httpx.Client):
    path = "v1/datasets/drives/runs/vae/leverage"
    some = http.get(path, params={"episode": 3, "first_step": 5, "last_step": 8}).json()
    assert (some["episode"], some["step"]) == ([3] * 4, [5, 6, 7, 8])
    answer = http.get(path, params={"limit": 100, "columns": "leverage"})
    assert answer.headers["x-total-count"] == "420"
    following = answer.headers["link"].split(">")[0].removeprefix("<")
    assert "offset=100" in following
    page = http.get(following).json()
    assert (page["offset"], len(page["leverage"]), "step" in page) == (100, 100, False)


def test_headers_on_several_lines_are_one_list(http: httpx.Client):
    path = "v1/datasets/drives"
    tag = http.get(path).headers["etag"]
    tags = [("If-None-Match", tag), ("If-None-Match", '"other"')]
    assert http.get(path, headers=tags).status_code == 304
    assert http.get(path, headers=tags[::-1]).status_code == 304
    kinds = [("Accept", "text/html"), ("Accept", "application/json")]
    assert http.get(path, headers=kinds).status_code == 200
    assert http.get(path, headers=kinds[::-1]).status_code == 200
    del http.headers["Accept"]
    assert http.get(path, headers=kinds[:1]).status_code == 406


def test_rows_of_an_unknown_episode_are_404(http: httpx.Client):
    for path in ("v1/datasets/drives/pairs", "v1/datasets/drives/runs/vae/leverage"):
        assert http.get(path, params={"episode": 99_999}).status_code == 404
