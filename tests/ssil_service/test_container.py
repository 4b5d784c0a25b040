"""The image as far as no engine is needed: what is copied exists, what runs has no rights."""

import re

from support.demonstrations import ROOT

IMAGE = (ROOT / "service" / "Dockerfile").read_text()
LINES = IMAGE.replace("\\\n", " ").splitlines()


def test_what_is_copied_exists_and_nothing_else_is_sent_to_the_builder():
    copies = [line.split()[1:-1] for line in LINES if re.match(r"COPY (?!--from)", line)]
    copied = {name for names in copies for name in names}
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    assert "*" in ignored
    assert {line[1:] for line in ignored if line.startswith("!")} == copied
    assert all((ROOT / name).exists() for name in copied)


def test_the_image_runs_as_a_user_without_rights_and_holds_no_key():
    last = IMAGE.split("FROM ")[-1]
    (user,) = re.findall(r"^USER (\w+)$", last, re.MULTILINE)
    assert f"useradd --system --uid 10001 --no-create-home {user}" in last
    assert last.index("USER") > last.rindex("RUN")
    assert not re.search(r"(ENV|ARG).*KEY", IMAGE.split("# keys come")[0])
    assert 'ENTRYPOINT ["ssil-data", "serve"]' in last
