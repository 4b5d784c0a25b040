"""Tracks: what is one, what is refused with its row, and the family that comes with the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_trainers.envs.rc_lidar.crossings import find_crossings, intersect_lines
from ssil_trainers.envs.rc_lidar.track import Track, load_track, save_track
from ssil_trainers.envs.rc_lidar.tracks import (
    COLLECTION_TRACK,
    LAP,
    NAMED,
    TEST_TRACKS,
    TRAINING_TRACK,
    Shape,
    find_track,
    generate_track,
)


def ring(radius: float, width: float, points: int = 60, *, name: str = "ring") -> Track:
    """A circle driven counterclockwise, `width` meters to either side."""
    angles = 2 * np.pi * np.arange(points) / points
    half = np.full(points, width)
    return Track(name, radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), half, half)


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


SQUARE = "# x_m, y_m, w_tr_right_m, w_tr_left_m\n0,0,1,1\n9,0,1,1\n9,9,1,1\n0,9,1,1\n"


def test_walls_stand_at_their_widths_on_their_sides() -> None:
    track = ring(10, 1, points=400)
    np.testing.assert_allclose(np.linalg.norm(track.left_wall, axis=1), 9, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(track.right_wall, axis=1), 11, atol=1e-9)
    assert track.length == pytest.approx(2 * np.pi * 10, rel=1e-4)


@pytest.mark.parametrize("points", [4, 5, 8, 20, 60])
def test_walls_of_a_coarse_line_are_as_far_away_as_the_widths_say(points: int) -> None:
    """Between two points of a polygon the walls run beside its side, no nearer than 1 % less."""
    track = ring(10, 1, points=points)
    side = 10 * np.cos(np.pi / points)
    for wall, aside in ((track.left_wall, -1), (track.right_wall, 1)):
        middle = (wall + np.roll(wall, -1, axis=0)) / 2
        assert np.linalg.norm(middle, axis=1) == pytest.approx(side + aside, abs=0.01)


def test_a_square_has_square_walls() -> None:
    line, one = np.array([[0, 0], [9, 0], [9, 9], [0, 9]]), np.ones(4)
    track = Track("square", line, one, one)
    np.testing.assert_allclose(track.left_wall, [[1, 1], [8, 1], [8, 8], [1, 8]], atol=1e-12)
    np.testing.assert_allclose(track.right_wall, [[-1, -1], [10, -1], [10, 10], [-1, 10]])


def test_fine_lines_are_not_mitered() -> None:
    """The committed demonstrations were driven between such walls."""
    np.testing.assert_allclose(np.linalg.norm(ring(10, 1, points=25).left_wall, axis=1), 9)
    np.testing.assert_allclose(
        np.linalg.norm(ring(10, 1, points=23).left_wall, axis=1), 10 - 1 / np.cos(np.pi / 23)
    )


def test_places_lie_evenly_on_the_line_and_look_along_it() -> None:
    places = ring(10, 1, points=400).sample_poses(0.5)
    np.testing.assert_allclose(np.linalg.norm(places[:, :2], axis=1), 10, atol=1e-2)
    turned = np.angle(np.exp(1j * (places[:, 2] - np.arctan2(places[:, 1], places[:, 0]))))
    np.testing.assert_allclose(turned, np.pi / 2, atol=1e-2)
    gaps = np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(gaps, 0.5, rtol=0.01)


def test_a_file_reads_back_number_by_number(tmp_path: Path) -> None:
    track = generate_track(Shape(seed=9))
    save_track(track, tmp_path / "seed-9.csv")
    back = load_track(tmp_path / "seed-9.csv")
    for field in ("center", "right", "left"):
        np.testing.assert_array_equal(getattr(back, field), getattr(track, field))
    assert back.name == "seed-9"


@pytest.mark.parametrize(
    ("old", "new", "row", "expected"),
    [
        ("9,9,1,1", "9,nan,1,1", 2, "finite x, y"),
        ("9,9,1,1", "inf,9,1,1", 2, "finite x, y"),
        ("9,0,1,1", "9,0,-1,1", 1, "positive width on the right, found -1"),
        ("9,0,1,1", "9,0,1,nan", 1, "positive width on the left, found nan"),
        ("9,0,1,1", "9,0,1,0", 1, "positive width on the left, found 0"),
        ("9,0,1,1", "9,0,1", 1, "four numbers"),
        ("9,0,1,1", "9,0,1,1,5", 1, "four numbers"),
        ("9,0,1,1", "9,left,1,1", 1, "four numbers"),
        ("9,0,1,1", "9,1_0,1,1", 1, "four numbers"),
        ("9,0,1,1", "9,1e200,1,1", 1, "finite x, y in meters"),
        ("9,0,1,1", "9,0,1e200,1", 1, "a width on the right in meters"),
        ("0,9,1,1\n", "", 3, "at least four points"),
        ("9,9,1,1\n", "9,0,1,1\n", 2, "another point than the one before"),
        ("0,9,1,1\n", "0,9,1,1\n0,0,1,1\n", 4, "not the first"),
        ("0,9,1,1\n", "0,9,1,1\n0,0.001,1,1\n", 4, "not the first"),
        ("0,9,1,1\n", "0,9,1,1\n1e-7,1e-7,1,1\n", 4, "not the first"),
        ("9,9,1,1\n", "5,0.5,1,1\n9,9,1,1\n", 1, "at most 120° in one point, found 173°"),
        ("9,9,1,1\n0,9,1,1\n", "0,9,1,1\n9,9,1,1\n", 1, "does not cross itself"),
        ("0,9,1,1\n", "4.5,9,1,1\n4.5,0,1,1\n", 0, "does not cross itself"),
    ],
)
def test_an_invalid_track_is_refused_with_its_row(
    tmp_path: Path, old: str, new: str, row: int, expected: str
) -> None:
    assert old in SQUARE
    path = write(tmp_path / "square.csv", SQUARE.replace(old, new))
    with pytest.raises(InvalidInputError, match=f"square.*, row {row}: expected .*{expected}"):
        load_track(path)


def test_a_file_may_begin_with_the_mark_of_its_encoding(tmp_path: Path) -> None:
    (tmp_path / "marked.csv").write_bytes(b"\xef\xbb\xbf" + SQUARE.encode())
    (tmp_path / "bare.csv").write_bytes(b"\xef\xbb\xbf" + SQUARE.split("\n", 1)[1].encode())
    for name in ("marked", "bare"):
        assert len(load_track(tmp_path / f"{name}.csv").center) == 4


def test_an_open_line_is_refused_with_its_last_row(tmp_path: Path) -> None:
    rows = "".join(f"{x},{np.sin(x)},0.4,0.4\n" for x in range(30))
    with pytest.raises(InvalidInputError, match="open, row 29: expected a closed line"):
        load_track(write(tmp_path / "open.csv", rows))


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    for name in ("none.csv", "binary.csv"):
        with pytest.raises(InvalidInputError, match=f"{name}: cannot read the CSV file"):
            load_track(tmp_path / name)


@pytest.mark.parametrize("radius", [0.3, 0.5, 0.8, 0.99])
def test_a_ring_whose_inner_wall_would_turn_inside_out_is_refused(radius: float) -> None:
    with pytest.raises(InvalidInputError, match=r"ring, row \d+: expected a corner wide enough"):
        ring(radius, 1.0)


def test_neighboring_stretches_whose_walls_overlap_are_refused(tmp_path: Path) -> None:
    long = "0,0,1,1\n10,0,1,1\n20,0,1,1\n20,1.5,1,1\n10,1.5,1,1\n0,1.5,1,1\n"
    with pytest.raises(InvalidInputError, match=r"flat, row \d+: expected"):
        load_track(write(tmp_path / "flat.csv", long))


def test_a_tight_corner_gets_a_wall_without_a_loop() -> None:
    """A square with corners of radius .5 and walls 1 m aside: the inner wall is a plain square."""
    side, radius, arc = 10.0, 0.5, np.linspace(0, np.pi / 2, 12)[:-1]
    corner = radius * np.stack([np.sin(arc), 1 - np.cos(arc)], axis=1)
    line = []
    for turn in range(4):
        cos, sin = np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)
        piece = np.concatenate(
            [
                [[x, 0.0] for x in np.linspace(-side / 2 + 0.5, side / 2 - 0.6, 20)],
                corner + np.array([4.5, 0.0]),
            ]
        ) - [0, side / 2]
        line.append(piece @ np.array([[cos, sin], [-sin, cos]]))
    center = np.concatenate(line)
    width = np.ones(len(center))
    wall = Track("tight", center, width, width).left_wall
    inner = np.max(np.abs(wall), axis=1)
    np.testing.assert_allclose(inner, 4.0, atol=0.05)
    assert np.abs(wall).max(axis=0) == pytest.approx([4.0, 4.0], abs=0.05)


@pytest.mark.parametrize("seed", range(12))
def test_every_generated_track_is_a_lap_long_and_no_tighter_than_its_shape(
    seed: int,
) -> None:
    shape = Shape(seed=seed, tightest=1.3)
    track = generate_track(shape)
    assert track.length == pytest.approx(LAP, abs=1e-3)
    a, b, c = (np.roll(track.center, -shift, axis=0) for shift in (0, 3, 6))
    sides = [np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    radius = np.prod(sides, axis=0) / np.maximum(2 * np.abs(ux * vy - uy * vx), 1e-12)
    assert radius.min() > 0.93 * shape.tightest
    again = generate_track(shape)
    np.testing.assert_array_equal(track.center, again.center)


def test_other_seeds_give_other_tracks() -> None:
    assert not np.allclose(generate_track(Shape(1)).center, generate_track(Shape(2)).center)


def test_collection_training_and_test_tracks_are_different_tracks() -> None:
    names = [COLLECTION_TRACK, TRAINING_TRACK, *TEST_TRACKS]
    assert sorted(names) == sorted(NAMED)
    lines = [find_track(name).center for name in names]
    assert all(not np.allclose(a, b) for i, a in enumerate(lines) for b in lines[:i])


def test_a_track_is_named_by_its_name_its_seed_or_its_file(tmp_path: Path) -> None:
    np.testing.assert_array_equal(find_track("seed-3").center, generate_track(Shape(3)).center)
    assert find_track("hall").name == "hall"
    assert find_track(str(write(tmp_path / "mine.csv", SQUARE))).name == "mine"
    with pytest.raises(NotFoundError, match=r"yard, .*seed-N or a .csv file, found 'moon'"):
        find_track("moon")


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1},
        {"corners": 2},
        {"rough": 1.0},
        {"width": 3.0},
        {"width": 0.0},
        {"tightest": -1},
    ],
)
def test_a_shape_that_no_curve_has_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(
        InvalidInputError, match=f"^{'width' if 'tightest' in wrong else next(iter(wrong))}"
    ):
        Shape(**{"seed": 0, **wrong})


@given(st.lists(st.tuples(*[st.integers(0, 6)] * 4), min_size=2, max_size=12))
@settings(max_examples=60, deadline=None)
def test_crossings_are_those_of_an_exact_pairwise_search(rows: list[tuple[int, ...]]) -> None:
    pieces = np.array(rows, dtype=float)
    found = {tuple(pair) for pair in find_crossings(pieces).tolist()}
    for one in range(len(rows)):
        for two in range(one + 1, len(rows)):
            if properly_cross(rows[one], rows[two]):
                assert (one, two) in found
            elif not share_a_point(rows[one], rows[two]):
                assert (one, two) not in found


def properly_cross(one: tuple[int, ...], two: tuple[int, ...]) -> bool:
    """Integer arithmetic: the ends of each lie strictly on both sides of the other."""
    return all(
        side(p[:2], p[2:], q[:2]) * side(p[:2], p[2:], q[2:]) < 0
        for p, q in ((one, two), (two, one))
    )


def share_a_point(one: tuple[int, ...], two: tuple[int, ...]) -> bool:
    ends = [(one, two[:2]), (one, two[2:]), (two, one[:2]), (two, one[2:])]
    return properly_cross(one, two) or any(
        side(p[:2], p[2:], q) == 0
        and min(p[0], p[2]) <= q[0] <= max(p[0], p[2])
        and min(p[1], p[3]) <= q[1] <= max(p[1], p[3])
        for p, q in ends
    )


def side(a: tuple[int, ...], b: tuple[int, ...], c: tuple[int, ...]) -> int:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def test_pieces_meet_where_their_lines_cross() -> None:
    one, two = np.array([0.0, 0, 2, 2]), np.array([0.0, 2, 2, 0])
    np.testing.assert_allclose(intersect_lines(one, two), [1, 1])


@pytest.mark.parametrize(("name", "length"), [("Spielberg", 343.3), ("IMS", 293.1)])
def test_real_center_lines_load(shared_data: Path, name: str, length: float) -> None:
    track = load_track(shared_data / "tracks" / f"{name}_centerline.csv")
    assert track.length == pytest.approx(length, abs=0.1)


def test_a_real_track_that_comes_too_close_to_itself_is_refused(shared_data: Path) -> None:
    """Montreal's stretches lie 1.9 m apart where the widths ask for 2.2."""
    with pytest.raises(InvalidInputError, match="row 510: expected walls that do not cross"):
        load_track(shared_data / "tracks" / "Montreal_centerline.csv")


@pytest.mark.parametrize("width", [50.0, 500.0])
def test_widths_that_leave_no_wall_inside_are_refused(shared_data: Path, width: float) -> None:
    real = load_track(shared_data / "tracks" / "Spielberg_centerline.csv")
    wide = np.full(len(real.center), width)
    with pytest.raises(InvalidInputError, match=f"leave a wall on the right, found {width:g} m"):
        Track("wide", real.center, wide, wide)
