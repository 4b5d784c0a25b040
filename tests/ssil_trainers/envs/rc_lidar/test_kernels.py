"""The RC world's inner loops one by one: touching, turning, noise, joints of walls."""

from __future__ import annotations

import numpy as np
import pytest

from ssil_trainers.envs.rc_lidar import kernels
from ssil_trainers.envs.rc_lidar.car import RCCar
from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
from ssil_trainers.envs.rc_lidar.lidar import Walls
from ssil_trainers.envs.rc_lidar.tracks import find_track
from ssil_trainers.envs.rc_lidar.vector_env import RCLidarVectorEnv

ROOM = [[-5, -5, 5, -5], [5, -5, 5, 5], [5, 5, -5, 5], [-5, 5, -5, -5]]
"""Far from the car, whose rectangle runs from -.09 to .42 m and .135 m to either side."""


@pytest.mark.parametrize(
    ("wall", "hit"),
    [
        ([0.41, 0.0, 1.0, 0.0], True),  # a spike through the front bumper alone
        ([0.43, 0.0, 1.0, 0.0], False),
        ([-0.08, 0.0, -1.0, 0.0], True),  # through the rear bumper
        ([-0.1, 0.0, -1.0, 0.0], False),
        ([0.2, 0.13, 0.2, 1.0], True),  # through the left side
        ([0.2, 0.14, 0.2, 1.0], False),
        ([0.2, -0.13, 0.2, -1.0], True),  # through the right side
        ([0.2, -0.14, 0.2, -1.0], False),
    ],
)
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_spike_through_any_side_of_the_car_touches_it(
    wall: list[float], hit: bool, heading: float
) -> None:
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    turned = (np.reshape(wall, (2, 2)) @ turn.T).ravel()
    grid = Walls.from_segments([*ROOM, turned]).grid
    world = RCCar().build_world(find_track("hall"))._replace(grid=grid)
    assert kernels.touches_wall(world, 0.0, 0.0, heading) is hit


@pytest.mark.parametrize(
    ("walls", "row"),
    [
        ([], -1),
        ([[3.2, 0.13, 3.2, 1.0]], 1),  # a spike through the left side, seen by no corner
        ([[3.3, -0.5, 3.3, 0.5]], 1),  # a wall across the whole car
        ([[-0.5, -0.25, 0.5, -0.25]], 0),  # nearer than a start aside on the right
        ([[-0.5, -0.13, 0.5, -0.13], [-0.5, -0.12, 0.5, -0.12]], 0),
    ],
)
def test_a_start_is_blocked_by_a_wall_through_the_car(walls: list[list[float]], row: int) -> None:
    starts = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    world = RCCar().build_world(find_track("hall"))
    aside = 0.0 if row == 1 else 0.15
    world = world._replace(
        grid=Walls.from_segments([*ROOM, *walls]).grid, starts=starts, aside=aside
    )
    assert kernels.find_blocked_start(world, np.zeros(1)) == row


def test_constant_steering_turns_the_car_along_its_circle() -> None:
    car = RCCar(steering_lag=0.0, substeps=200)
    env = RCLidarEnv("yard", car=car)
    env.reset(seed=0)
    x, y, heading = env.pose
    assert not env.step(np.array([0.5], dtype=np.float32))[2]
    radius = car.wheelbase / np.tan(np.deg2rad(0.5 * car.steering_degrees))
    turned = 0.1 * car.speed / radius
    ahead, left = radius * np.sin(turned), radius * (1 - np.cos(turned))
    moved = np.array(
        [
            x + ahead * np.cos(heading) - left * np.sin(heading),
            y + ahead * np.sin(heading) + left * np.cos(heading),
            np.angle(np.exp(1j * (heading + turned))),
        ]
    )
    np.testing.assert_allclose(env.pose, moved, atol=1e-6)


def errors(noisy: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """The noise (n, 19) of the beams, as a share of what they should read."""
    return noisy[:, :-1] / clear[:, :-1] - 1


def test_noise_is_new_in_every_step_and_in_every_episode() -> None:
    noisy, clear = (RCLidarVectorEnv(300, "yard", car=RCCar(noise=n)) for n in (0.02, 0.0))
    still = np.zeros((300, 1), dtype=np.float32)
    found = [errors(noisy.reset(seed=0)[0], clear.reset(seed=0)[0])]
    found += [errors(noisy.step(still)[0], clear.step(still)[0])]
    found += [errors(noisy.reset()[0], clear.reset()[0])]
    for one, other in ((0, 1), (0, 2), (1, 2)):
        both = (np.abs(found[one]) > 1e-6) & (np.abs(found[other]) > 1e-6)
        assert both.sum() > 3_000
        assert np.corrcoef(found[one][both], found[other][both])[0, 1] == pytest.approx(0, abs=0.1)


def star(seed: int, corners: int) -> np.ndarray:
    """A closed line around the origin, between 1 and 2 m from it."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
    far = rng.uniform(1, 2, corners)
    return np.stack([far * np.cos(angles), far * np.sin(angles)], axis=1)


@pytest.mark.parametrize("cell", [0.07, 0.5, 3.0])
def test_no_ray_slips_through_a_joint_that_it_is_aimed_at(cell: float) -> None:
    corners = star(0, 400)
    walls = Walls.from_segments(np.hstack([corners, np.roll(corners, -1, axis=0)]), cell=cell)
    poses = np.random.default_rng(1).uniform(-0.3, 0.3, (60, 2))
    for x, y in poses:
        away = corners - [x, y]
        aims = np.arctan2(away[:, 1], away[:, 0])
        ranges = walls.scan([x, y, 0.0], aims, reach=99.0)[0]
        assert (ranges <= np.hypot(*away.T) + 1e-6).all()


def test_walls_on_the_borders_of_cells_are_seen_from_both_sides() -> None:
    cell, at = 0.5, 0.5 * np.arange(9) - 1e-3  # the grid begins 1 mm before the lowest corner
    low, high = 0.0, 4.0
    for place in at[1:]:
        for along in (0, 1):
            wall = [place, low, place, high] if along else [low, place, high, place]
            walls = Walls.from_segments(
                [[low, low, low, high], [low, high, high, high], wall], cell=cell
            )
            across = np.array([place, 1.3]) if along else np.array([1.3, place])
            for side in (-1, 1):
                pose = across + side * (np.array([0.4, 0]) if along else np.array([0, 0.4]))
                heading = {(-1, 1): 0, (1, 1): np.pi, (-1, 0): np.pi / 2, (1, 0): -np.pi / 2}
                if (pose < 0).any() or (pose > 4).any():
                    continue
                found = walls.scan([*pose, heading[side, along]], [-0.3, 0.0, 0.3], reach=9.0)[0]
                expected = 0.4 / np.cos([-0.3, 0.0, 0.3])
                np.testing.assert_allclose(found, expected, atol=1e-9)
