"""Conventions of the code that can be counted, and how they are counted."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from support.demonstrations import ROOT

PACKAGES = [ROOT / "ssil_data", ROOT / "service/ssil_service", ROOT / "trainers/ssil_trainers"]
IRREGULAR = frozenset(
    [
        "asked",
        "begun",
        "built",
        "done",
        "drawn",
        "found",
        "given",
        "gone",
        "held",
        "kept",
        "known",
        "left",
        "made",
        "meant",
        "said",
        "seen",
        "sent",
        "shown",
        "spread",
        "taken",
        "told",
        "written",
    ]
)
"""Past participles without -ed; `read`, `set`, `put`, `cut` and `split` are imperatives too."""
NO_PARTICIPLES = frozenset(["embed", "feed", "seed", "speed", "string"])
BRITISH = re.compile(
    r"\b\w*(standardis|normalis|centre|catalogue|colour|behaviour|neighbour|metres\b|labelled|"
    r"initialis|summaris|recognis|minimis|maximis|vectoris|favour|analys(?:e|ing)\b)\w*",
    re.IGNORECASE,
)
STORED = frozenset(["standardiser", "centred"])
"""Names in archives and checkpoints of before, which go on being read."""


def sources() -> Iterator[tuple[Path, str]]:
    for package in PACKAGES:
        for file in sorted(package.rglob("*.py")):
            yield file, file.read_text()


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    for file, text in sources():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{file.relative_to(ROOT)}:{node.lineno} {node.name}", node


def is_participle(name: str) -> bool:
    """Tell whether the first word of a function's name is a past or present participle."""
    first = name.strip("_").split("_")[0]
    ends = first.endswith(("ed", "ing")) and first not in NO_PARTICIPLES
    return first in IRREGULAR or ends


def test_at_most_one_function_name_in_a_hundred_is_a_participle():
    found = list(functions())
    odd = [where for where, node in found if is_participle(node.name)]
    assert len(odd) <= len(found) / 100, "\n".join(odd)


def test_assignments_are_one_a_line():
    lines = 0
    packed: list[str] = []
    for file, text in sources():
        lines += len(text.splitlines())
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
                continue
            if any(isinstance(target, ast.Tuple) for target in node.targets):
                packed.append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert len(packed) <= 0.1 * lines / 100, "\n".join(packed)


def test_public_functions_explain_their_parameters():
    """Of public functions and methods with a docstring and a parameter, 95 % have a section."""
    count = 0
    missing: list[str] = []
    for where, node in functions():
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        named = [each.arg for each in arguments if each.arg not in ("self", "cls")]
        text = ast.get_docstring(node)
        if node.name.startswith("_") or not named or not text:
            continue
        count += 1
        if "Parameters\n---" not in text:
            missing.append(where)
    assert len(missing) <= 0.05 * count, "\n".join(missing)


def test_spelling_is_american():
    odd = [
        f"{file.relative_to(ROOT)}:{number} {word.group()}"
        for file, text in sources()
        for number, line in enumerate(text.splitlines(), start=1)
        for word in BRITISH.finditer(line)
        if word.group().lower() not in STORED
    ]
    assert not odd, "\n".join(odd)


def test_no_import_hides_in_a_string_path_that_is_gone():
    """Module paths in strings, as of lazily imported commands, name modules that exist."""
    known = {
        ".".join(file.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")
        for package in PACKAGES
        for file in package.rglob("*.py")
    }
    path = re.compile(r"""["'](ssil_(?:data|service|trainers)(?:\.\w+)+):\w+["']""")
    odd = [
        f"{file.relative_to(ROOT)}: {found}"
        for file, text in sources()
        for found in path.findall(text)
        if found not in known
    ]
    assert not odd, "\n".join(odd)
