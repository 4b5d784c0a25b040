"""The paper's published numbers (Lee et al.), shown beside ours; nothing is judged by them.

Table I: mean and deviation over three seeds on TORCS, by labeled pairs; Table II: mean leverage by
quality tier; Table III: maximum score and deviation on the RC car.
"""

from __future__ import annotations

from collections.abc import Mapping

_KEYS = ("gail-mixed", "gail", "mixgail", "ssil-gpr", "ssil-mdn", "ssil-vae", "ssil-windowvae")
_TABLE_I = {
    100: ".564/.077 .263/.057 .049/.002 .051/.044 .102/.008 .055/.017 .325/.161",
    300: ".564/.077 .370/.169 .598/.125 .514/.021 .609/.085 .605/.125 .525/.071",
    600: ".564/.077 .637/.129 .586/.008 .643/.118 .614/.102 .795/.054 .763/.002",
    1_200: ".564/.077 .768/.095 .886/.003 .880/.020 .873/.014 .871/.013 .887/.022",
}
_TABLE_III = {
    "gail": ".679/.086",
    "mixgail": ".721/.051",
    "ssil-mdn": ".813/.089",
    "ssil-vae": ".786/.050",
    "ssil-windowvae": ".808/.051",
}


def _number(text: str) -> tuple[float, float]:
    """Read "mean/deviation"."""
    mean, deviation = text.split("/")
    return float(mean), float(deviation)


SCORES: Mapping[tuple[str, int | None, str], tuple[float, float]] = {
    **{
        ("racetrack", labels, key): _number(text)
        for labels, line in _TABLE_I.items()
        for key, text in zip(_KEYS, line.split(), strict=True)
    },
    **{
        ("coverage", here, key): _number(text)
        for here, line in zip((8, 23, 47, 94), _TABLE_I.values(), strict=True)
        for key, text in zip(_KEYS, line.split(), strict=True)
    },
    **{("rc-lidar", None, key): _number(text) for key, text in _TABLE_III.items()},
}
"""Mean and deviation by table, labels and row."""

REMARKS: Mapping[str, str] = {
    "rc-lidar": "The paper's scores are maxima over training on the training track: to be compared "
    "with the line of the most where trained, not with the final scores on tracks never seen.",
    "coverage": "The paper's numbers are those of its 100, 300, 600 and 1,200 labels, which cover "
    "as much of a lap.",
}
"""How the paper's numbers of a table differ in kind from ours."""

LEVERAGE: Mapping[str, tuple[float, ...]] = {
    "vae": (0.7236, 0.8474, 0.8586, 0.9776),
    "windowvae": (0.6959, 0.7333, 0.7550, 0.9554),
}
"""Mean leverage by tier, worst first, of each estimator in the paper's table."""
