"""Rays against hand-made rooms, a brute-force reference and other people's simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar.lidar import Walls
from ssil_trainers.envs.rc_lidar.occupancy import load_map, outline_pixels
from ssil_trainers.envs.rc_lidar.track import load_track

ROOM = [[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]]
BEAMS = np.deg2rad(np.arange(-90, 91, 10))


def brute_force(
    walls: np.ndarray, x: float, y: float, angle: float, reach: float
) -> tuple[float, bool]:
    """The nearest of all walls, one by one; and whether the ray grazes an end of one."""
    nearest, grazes = reach, False
    direction = np.array([np.cos(angle), np.sin(angle)])
    for x0, y0, x1, y1 in walls:
        along = np.array([x1 - x0, y1 - y0])
        matrix = np.stack([direction, -along], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-7:
            grazes |= bool(np.hypot(*along) > 0)
            continue
        distance, share = np.linalg.solve(matrix, [x0 - x, y0 - y])
        grazes |= bool(min(abs(share), abs(share - 1), abs(distance)) < 1e-6)
        if 0 <= distance < nearest and 0 <= share <= 1:
            nearest = float(distance)
    return nearest, grazes


def test_ranges_in_a_room_are_those_of_a_ruler() -> None:
    ranges = Walls.from_segments(ROOM).scan([1, 1, 0], np.deg2rad([-90, 0, 45, 90, 180]), reach=10)
    np.testing.assert_allclose(ranges, [[1, 3, 2 * np.sqrt(2), 2, 1]], atol=1e-9)


def test_left_is_positive_and_the_heading_turns_the_fan() -> None:
    walls = Walls.from_segments(ROOM)
    np.testing.assert_allclose(
        walls.scan([1, 1, np.pi / 2], [-np.pi / 2, 0, np.pi / 2], reach=10), [[3, 2, 1]]
    )


def test_nothing_is_farther_than_the_reach() -> None:
    assert Walls.from_segments(ROOM).scan([1, 1, 0], [0.0], reach=2.5).item() == 2.5


def test_no_ray_slips_through_the_joints_of_a_closed_line() -> None:
    angles = np.linspace(0, 2 * np.pi, 41)
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    walls = Walls.from_segments(np.hstack([corners[:-1], corners[1:]]), cell=0.13)
    ranges = walls.scan([0, 0, 0], np.concatenate([angles, np.linspace(0, 7, 2_000)]), reach=10)
    assert ranges.max() <= 1 + 1e-9
    assert ranges.min() >= np.cos(np.pi / 40) - 1e-9


@given(st.integers(0, 10_000), st.integers(1, 25), st.sampled_from([0.05, 0.3, 1.0, 7.0]))
@settings(max_examples=40, deadline=None)
def test_rays_end_where_a_search_of_all_walls_says(seed: int, count: int, cell: float) -> None:
    rng = np.random.default_rng(seed)
    pieces = rng.uniform(-3, 3, (count, 4))
    pieces[0] = [-3.5, -3.5, 3.5, 3.5]  # so that the rectangle around the walls holds the poses
    walls = Walls.from_segments(pieces, cell=cell)
    poses = np.column_stack([rng.uniform(-3, 3, (4, 2)), rng.uniform(-4, 4, 4)])
    ranges = walls.scan(poses, BEAMS, reach=5.0)
    for (x, y, heading), row in zip(poses, ranges, strict=True):
        for beam, found in zip(BEAMS, row, strict=True):
            expected, grazes = brute_force(pieces, x, y, heading + beam, 5.0)
            assert grazes or found == pytest.approx(expected, abs=1e-7)


def test_a_pose_outside_of_all_walls_sees_none() -> None:
    assert (Walls.from_segments(ROOM).scan([9, 9, np.pi], BEAMS, reach=6) == 6).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"poses": [[0, 0]]}, r"poses: expected shape \(n, 3\), found \(1, 2\)"),
        ({"poses": [1.0]}, r"poses: expected shape \(n, 3\), found \(1,\)"),
        ({"poses": np.zeros((2, 2, 3))}, r"poses: expected shape \(n, 3\), found \(2, 2, 3\)"),
        ({"poses": [1, np.nan, 0]}, "poses: expected finite numbers, found nan"),
        ({"poses": [1, 1, np.inf]}, "poses: expected finite numbers, found inf"),
        ({"poses": [[1, 1, 0], [1, 1]]}, "poses: expected numbers, found"),
        ({"beams": 0.0}, r"beams: expected shape \(b,\), found \(\)"),
        ({"beams": [[0.0]]}, r"beams: expected shape \(b,\), found \(1, 1\)"),
        ({"beams": [np.nan]}, "beams: expected finite numbers, found nan"),
        ({"reach": 0}, "reach: expected a length above 0, found 0"),
        ({"reach": -1.0}, "reach: expected a length above 0, found -1"),
        ({"reach": np.nan}, "reach: expected a length above 0, found nan"),
    ],
)
def test_invalid_scans_are_refused(wrong: dict[str, Any], message: str) -> None:
    valid: dict[str, Any] = {"poses": [1, 1, 0], "beams": BEAMS, "reach": 9.0}
    with pytest.raises(InvalidInputError, match=message):
        Walls.from_segments(ROOM).scan(**{**valid, **wrong})


def test_many_poses_no_pose_and_an_endless_reach_are_scans() -> None:
    walls = Walls.from_segments(ROOM)
    assert walls.scan(np.empty((0, 3)), BEAMS, reach=1).shape == (0, len(BEAMS))
    assert walls.scan([[1, 1, 0], [9, 9, 0]], [0.0], reach=np.inf).tolist() == [[3.0], [np.inf]]


@pytest.mark.parametrize(
    ("walls", "message"),
    [
        (np.empty((0, 4)), r"expected shape \(n, 4\), found \(0, 4\)"),
        ([[0, 0, 1]], r"expected shape \(n, 4\), found \(1, 3\)"),
        ([[0, 0, 1, 1], [0, 0, np.nan, 1]], "expected finite numbers, found .* at row 1"),
        ([[0, 0, 1e6, 1e6]], "expected at most 50,000,000 cells"),
        ([[0, 0, 1e200, 1e200]], "expected at most 50,000,000 cells"),
    ],
)
def test_invalid_walls_are_refused(walls: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Walls.from_segments(walls)


def test_a_pixels_outline_runs_between_its_border_and_its_middle() -> None:
    pixels = np.zeros((9, 9), dtype=bool)
    pixels[4, 6] = True
    walls = outline_pixels(pixels, resolution=0.5, origin=(10.0, 20.0))
    borders = np.array([13 + 0.125, 13.5 - 0.125, 22 + 0.125, 22.5 - 0.125])
    drawn = walls.segments
    found = [
        *drawn[:, [0, 2]].ravel()[[0]],
        drawn[:, [0, 2]].max(),
        drawn[:, 1].min(),
        drawn[:, 3].max(),
    ]
    np.testing.assert_allclose(found, borders, atol=1e-9)


@pytest.mark.parametrize("flip", [False, True])
def test_no_ray_slips_between_diagonal_pixels(flip: bool) -> None:
    pixels = np.eye(12, dtype=bool)
    pixels = pixels[:, ::-1] if flip else pixels
    walls = outline_pixels(pixels, resolution=1.0, origin=(0.0, 0.0))
    x, heading = (8.0, 3 * np.pi / 4) if not flip else (4.0, np.pi / 4)
    ranges = walls.scan([x, 4.0, heading], np.linspace(-0.7, 0.7, 999), reach=30)
    assert ranges.max() < 30


def test_a_map_is_read_with_its_lowest_row_at_the_origin(tmp_path: Path) -> None:
    pixels = np.full((40, 60), 254, dtype=np.uint8)
    pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1] = 0, 0, 0, 0
    pixels[30:32, 20] = 100  # merely unknown
    Image.fromarray(pixels).save(tmp_path / "room.png")
    yaml = (
        "image: room.png\nresolution: 0.1\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (tmp_path / "room.yaml").write_text(yaml, encoding="utf-8")
    scan = load_map(tmp_path / "room.yaml").scan([0, 0, 0], np.deg2rad([-90, 0, 90, 180]), reach=99)
    np.testing.assert_allclose(scan, [[1.925, 4.925, 1.925, 0.925]], atol=1e-9)
    for wrong, message in (
        (yaml.replace("0.1\n", "-0.1\n"), "positive resolution"),
        (yaml.replace("0.0]", "0.5]"), "angle 0"),
        (yaml.replace("negate: 0\n", ""), r"the keys \['negate'\] are missing"),
        (yaml.replace("0.65", "dark"), "expected a number for occupied_thresh, found 'dark'"),
        (yaml.replace("room.png", "none.png"), "none.png: cannot read the map's image"),
    ):
        (tmp_path / "wrong.yaml").write_text(wrong, encoding="utf-8")
        with pytest.raises(InvalidInputError, match=message):
            load_map(tmp_path / "wrong.yaml")


def test_a_map_without_obstacles_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="map: no pixel is occupied"):
        outline_pixels(np.zeros((5, 5)), resolution=1, origin=(0, 0))


def test_ranges_agree_with_f1tenth_gyms_own_scans(shared_data: Path) -> None:
    """Ten poses at the origin, the LiDAR .275 m ahead; 1,080 beams over 4.7 rad."""
    walls = load_map(shared_data / "maps" / "skirk.yaml")
    theirs = np.load(shared_data / "maps" / "legacy_scan.npz")["skirk"]
    heading = np.linspace(-1, 1, 10)
    poses = np.stack([0.275 * np.cos(heading), 0.275 * np.sin(heading), heading], axis=1)
    ours = walls.scan(poses, np.linspace(-2.35, 2.35, 1_080), reach=30)
    assert np.median(np.abs(ours - theirs)) <= 0.02
    assert np.mean((ours - theirs) ** 2) <= 0.1


def test_ranges_on_a_real_track_agree_with_its_map(shared_data: Path) -> None:
    folder = shared_data / "tracks"
    reference = np.genfromtxt(
        folder / "Spielberg_png_lidar19_ref.csv", delimiter=",", skip_header=1
    )
    poses, theirs = reference[:, 1:4], reference[:, 4:]
    for walls in (
        load_track(folder / "Spielberg_centerline.csv").walls,
        load_map(folder / "Spielberg_map.yaml"),
    ):
        ours = walls.scan(poses, BEAMS, reach=10)
        assert np.median(np.abs(ours - theirs)) <= 0.06
