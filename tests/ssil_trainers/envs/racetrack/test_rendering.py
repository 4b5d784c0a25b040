"""The map of a drive: its edges are where rays end, and every position has its color."""

from __future__ import annotations

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.racetrack.env import HIGHWAY_IDS, RacetrackEnv, TrackName
from ssil_trainers.envs.racetrack.rendering import draw_drives, to_png

POSITIONS = np.array([[50.0, 0.0], [60.0, 2.5], [70.0, 5.0]])
LEVERAGE = np.array([0.2, 0.5, 1.0])


@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_the_edges_that_are_drawn_are_where_rays_end(track: TrackName) -> None:
    env = RacetrackEnv(track)
    spec = draw_drives(env.road, {"a drive": (POSITIONS, LEVERAGE)}).to_dict()
    sides = spec["concat"][0]["layer"][0]["data"]["values"]
    starts = np.array([[side["x"], side["y"]] for side in sides])
    ends = np.array([[side["x2"], side["y2"]] for side in sides])
    for seed in range(5):
        env.reset(seed=seed)
        angles = np.linspace(0.0, 2 * np.pi, 24)
        far = env.road.ray_distances(env.car.x, env.car.y, angles, np.inf)
        points = np.stack([env.car.x + far * np.cos(angles), env.car.y + far * np.sin(angles)], 1)
        for point in points:
            along = ends - starts
            share = ((point - starts) * along).sum(1) / np.maximum((along**2).sum(1), 1e-12)
            nearest = starts + np.clip(share, 0, 1)[:, None] * along
            assert np.linalg.norm(nearest - point, axis=1).min() < 0.05


def test_a_drive_becomes_a_picture_with_a_circle_for_every_position() -> None:
    chart = draw_drives(RacetrackEnv().road, {"one": (POSITIONS, LEVERAGE)})
    trail = chart.to_dict()["concat"][0]["layer"][1]["data"]["values"]
    assert [point["leverage"] for point in trail] == LEVERAGE.tolist()
    assert [(point["x"], point["y"]) for point in trail] == [tuple(at) for at in POSITIONS.tolist()]
    assert to_png(chart).startswith(b"\x89PNG")


def test_positions_without_their_leverage_are_refused() -> None:
    with pytest.raises(
        InvalidInputError, match=r"one: expected positions \(2, 2\), found \(3, 2\)"
    ):
        draw_drives(RacetrackEnv().road, {"one": (POSITIONS, LEVERAGE[:2])})
