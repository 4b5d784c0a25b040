"""The road's arrays against highway-env's own lanes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from highway_env.road.lane import SineLane
from highway_env.road.road import RoadNetwork

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.racetrack.env import HIGHWAY_IDS, RacetrackEnv, TrackName
from ssil_trainers.envs.racetrack.road import Road
from ssil_trainers.envs.racetrack.state import RAY_DEGREES, SIGHT

REACH = 60.0
STEP = 0.5


def on_road(network: RoadNetwork, point: np.ndarray) -> bool:
    """Ask highway-env whether a point is on the lane that is closest to it."""
    return bool(network.get_lane(network.get_closest_lane_index(point)).on_lane(point))


def march(network: RoadNetwork, start: np.ndarray, angle: float) -> float:
    """Walk along a ray until the point is off the road, then bisect: the slow reference."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    inside = 0.0
    while on_road(network, start + (inside + STEP) * direction):
        inside += STEP
        if inside > REACH:
            return REACH
    outside = inside + STEP
    while outside - inside > 1e-3:
        middle = (inside + outside) / 2
        if on_road(network, start + middle * direction):
            inside = middle
        else:
            outside = middle
    return inside


@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_rays_end_where_marching_leaves_the_road(track: TrackName) -> None:
    env = RacetrackEnv(track)
    network, rng = env._simulator.road.network, np.random.default_rng(1)
    differences = []
    for seed in range(8):
        env.reset(seed=seed)
        car = env.car
        turned = rng.uniform(-0.3, 0.3)
        angles = car.heading + turned + np.deg2rad(RAY_DEGREES[::3])
        measured = env.road.ray_distances(car.x, car.y, angles, REACH)
        slow = [march(network, np.array([car.x, car.y]), angle) for angle in angles]
        differences.append(np.abs(measured - slow) / np.maximum(slow, 1.0))
    # highway-env's sections overlap or miss each other by a few centimeters where they meet.
    assert np.median(differences) < 1e-3
    assert np.mean(np.array(differences) < 0.02) > 0.95


def slow_ray(road: Road, x: float, y: float, cos: float, sin: float) -> float:
    """One ray against one piece of the edge after the other, in Python's own numbers."""
    nearest = REACH
    for start_x, start_y, end_x, end_y in road.edges.segments.tolist():
        to_x, to_y, along_x, along_y = start_x - x, start_y - y, end_x - start_x, end_y - start_y
        across = cos * along_y - sin * along_x
        if across and -1e-9 <= (to_x * sin - to_y * cos) / across <= 1 + 1e-9:
            distance = (to_x * along_y - to_y * along_x) / across
            nearest = min(nearest, distance) if distance >= 0 else nearest
    for center_x, center_y, radius, middle_x, middle_y, opening in road.edges.arcs.tolist():
        away_x, away_y = x - center_x, y - center_y
        to_middle = -(cos * away_x + sin * away_y)
        square = to_middle * to_middle - (away_x * away_x + away_y * away_y - radius * radius)
        for half_chord in (-math.sqrt(square), math.sqrt(square)) if square >= 0 else ():
            distance = to_middle + half_chord
            seen_x, seen_y = away_x + distance * cos, away_y + distance * sin
            if distance >= 0 and (seen_x * middle_x + seen_y * middle_y) / radius >= opening - 1e-9:
                nearest = min(nearest, distance)
    return nearest


@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_compiled_rays_are_the_slow_ones_to_the_last_bit(track: TrackName) -> None:
    env, rng = RacetrackEnv(track), np.random.default_rng(4)
    for seed in range(30):
        env.reset(seed=seed)
        car, aside = env.car, rng.normal(scale=2.0, size=3) * (seed % 2)
        # From the very middle of a lane, every other time: such rays may just touch an edge.
        x, y, angles = car.x + aside[0], car.y + aside[1], car.heading + aside[2] + SIGHT.rays
        slow = [
            slow_ray(env.road, x, y, cos, sin)
            for cos, sin in zip(np.cos(angles).tolist(), np.sin(angles).tolist(), strict=True)
        ]
        np.testing.assert_array_equal(env.road.ray_distances(x, y, angles, REACH), slow)


@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_no_ray_from_the_road_escapes(track: TrackName) -> None:
    env = RacetrackEnv(track)
    around = np.linspace(0.0, 2 * np.pi, 721)
    for seed in range(40):
        env.reset(seed=seed)
        distances = env.road.ray_distances(env.car.x, env.car.y, around, np.inf)
        assert np.isfinite(distances).all()


def test_rays_across_a_straight_measure_its_width() -> None:
    road = RacetrackEnv().road
    across = np.array([-np.pi / 2, np.pi / 2, -np.pi / 4])
    # The first straight runs from (42, 0) to (100, 0); its edges are y = -2.5 and y = 7.5.
    np.testing.assert_allclose(
        road.ray_distances(70.0, 1.0, across, REACH), [3.5, 6.5, 3.5 * np.sqrt(2)], rtol=1e-12
    )


def test_rays_in_a_turn_measure_its_circles() -> None:
    road = RacetrackEnv().road
    # The first turn goes round (100, -20) between radius 17.5 and 27.5.
    out = np.deg2rad(30.0)
    x, y = 100 + 20 * np.cos(out), -20 + 20 * np.sin(out)
    np.testing.assert_allclose(
        road.ray_distances(x, y, np.array([out, out + np.pi]), REACH), [7.5, 2.5], rtol=1e-12
    )


@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_every_lane_continues_where_it_ends(track: TrackName) -> None:
    env = RacetrackEnv(track)
    network, road = env._simulator.road.network, env.road
    lanes = [network.get_lane(index) for index in road.number]
    for row, lane in enumerate(lanes):
        onward = lanes[road.lanes.following[row]]
        gap = np.linalg.norm(lane.position(lane.length, 0.0) - onward.position(0.0, 0.0))
        assert gap < 3.0


def test_a_lane_that_is_neither_straight_nor_circular_is_refused() -> None:
    network = RacetrackEnv()._simulator.road.network
    network.graph["a"]["b"][1] = SineLane([42, 5], [100, 5], amplitude=1, pulsation=1, phase=0)
    with pytest.raises(InvalidInputError, match=r"\('a', 'b', 1\): .* found SineLane"):
        Road.from_network(network)


def test_curvature_ahead_walks_round_the_lap() -> None:
    road = RacetrackEnv().road
    lap = road.lanes.length[::2].sum()
    for lane in (0, 4, 8):
        for meters in (0.0, 5.0, 22.0):
            once = road.curvature_ahead(lane, 1.0, meters)
            assert road.curvature_ahead(lane, 1.0, meters + lap) == once
    assert road.curvature_ahead(0, 0.0, 59.0) == pytest.approx(-1 / 20)
    assert road.curvature_ahead(0, 0.0, 57.0) == 0.0
