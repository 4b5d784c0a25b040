"""The page `/docs` works without any other host."""

import re
from html.parser import HTMLParser
from urllib.parse import urljoin

import httpx

from ssil_service.routes import documentation


class References(HTMLParser):
    """Collects what a page loads."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if name in ("src", "href") and value]


def loads(page: str) -> list[str]:
    parser = References()
    parser.feed(page)
    return parser.found


def test_the_page_loads_its_own_files_only(http: httpx.Client):
    answer = http.get("docs")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/html")
    assert "://" not in answer.text and 'src="//' not in answer.text
    files = [each for each in loads(answer.text) if not each.startswith("data:")]
    assert len(files) == 3
    kinds = {".js": "text/javascript", ".css": "text/css"}
    for file in files:
        found = http.get(urljoin(str(answer.url), file))
        assert found.status_code == 200 and len(found.content) > 50, file
        kind = kinds[re.search(r"\.\w+$", file).group()]
        assert found.headers["content-type"].startswith(kind)


def test_the_browser_may_load_nothing_from_elsewhere(http: httpx.Client):
    policy = http.get("docs").headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert not re.search(r"https?:|\*|'unsafe-eval'", policy)
    assert re.search(r"script-src 'self'(;|$)", policy)


def test_the_page_shows_the_services_own_document(http: httpx.Client):
    start = http.get("docs/start.js").text
    (url,) = re.findall(r'url: "([^"]+)"', start)
    document = http.get(urljoin(str(http.get("docs").url), url)).json()
    assert "/v1/datasets" in document["paths"]
    assert "validatorUrl: null" in start  # else a badge is fetched from another host


def test_only_the_pages_files_are_served(http: httpx.Client):
    for name in ("README.md", "..%2Fdocumentation.py", "LICENSE", "no.js"):
        assert http.get(f"docs/{name}").status_code in (404, 422)


def test_the_license_lies_beside_the_files():
    folder = documentation.FOLDER
    assert "Apache License" in (folder / "LICENSE").read_text()
    assert "SmartBear" in (folder / "NOTICE").read_text()
    assert re.search(r"Swagger UI \d+\.\d+\.\d+", (folder / "README.md").read_text())
