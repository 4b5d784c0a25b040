"""Pictures of the RC world: a car among its beams, and a whole drive colored by a value.

Everything is drawn three times as large and scaled down, which smooths every edge.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar.car import Fleet
from ssil_trainers.envs.rc_lidar.track import Track

Color = tuple[int, int, int]
FLOOR = (229, 231, 228)
ROAD = (250, 250, 248)
WALL = (74, 80, 88)
CENTER = (214, 216, 212)
BEAM = (214, 84, 64)
BODY = (38, 104, 176)
TIRE = (28, 30, 34)
INK = (60, 64, 70)
_VIRIDIS = np.array(
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], dtype=float
)
_LARGER = 3
_PANEL = 176
"""Pixels of the strip with the map, the step and the steering."""


class Canvas:
    """A picture of a piece of the world; x to the right and y up, in meters.

    Parameters
    ----------
    size:
        Width and height in pixels.
    middle:
        x, y in the middle of the picture [m].
    scale:
        Pixels to a meter.
    color:
        Of the background.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.rendering import BEAM, Canvas
    >>> canvas = Canvas((40, 20), middle=(0.0, 0.0), scale=10)
    >>> canvas.dot((0.0, 0.0), 5, BEAM)
    >>> canvas.image.getpixel((20, 10))
    (214, 84, 64)
    """

    def __init__(
        self, size: tuple[int, int], middle: ArrayLike, scale: float, color: Color = FLOOR
    ) -> None:
        """Begin with an empty picture."""
        self.size = size
        self.scale = scale * _LARGER
        self._image = Image.new("RGB", (size[0] * _LARGER, size[1] * _LARGER), color)
        self._draw = ImageDraw.Draw(self._image, "RGBA")
        self._middle = np.asarray(middle, dtype=float)
        self._center = np.array(size, dtype=float) * _LARGER / 2

    def _pixels(self, points: ArrayLike) -> list[tuple[float, float]]:
        """Return where points (n, 2) of the world are in the enlarged picture."""
        away = (np.asarray(points, dtype=float) - self._middle) * [self.scale, -self.scale]
        return [(float(x), float(y)) for x, y in away + self._center]

    def area(self, points: ArrayLike, color: tuple[int, ...]) -> None:
        """Fill a polygon.

        Parameters
        ----------
        points:
            Its corners [m] (n, 2).
        color:
            Red, green, blue, and perhaps opacity, from 0 to 255.
        """
        self._draw.polygon(self._pixels(points), fill=color)

    def line(self, points: ArrayLike, color: tuple[int, ...], width: float) -> None:
        """Draw a line.

        Parameters
        ----------
        points:
            Its points [m] (n, 2).
        color:
            As for `area`.
        width:
            In pixels.
        """
        self._draw.line(
            self._pixels(points), fill=color, width=max(1, round(width * _LARGER)), joint="curve"
        )

    def dot(self, point: ArrayLike, radius: float, color: tuple[int, ...]) -> None:
        """Draw a dot.

        Parameters
        ----------
        point:
            Its middle [m] (2,).
        radius:
            In pixels.
        color:
            As for `area`.
        """
        ((x, y),) = self._pixels(np.reshape(np.asarray(point), (1, 2)))
        r = radius * _LARGER
        self._draw.ellipse((x - r, y - r, x + r, y + r), fill=color)

    def text(self, x: float, y: float, text: str, *, size: int = 13, anchor: str = "la") -> None:
        """Write a line of text.

        Parameters
        ----------
        x, y:
            Pixels from the upper left corner.
        text:
            What is written.
        size:
            Height of the font in pixels.
        anchor:
            Which point of the text is there, as Pillow names it.
        """
        self._draw.text(
            (x * _LARGER, y * _LARGER),
            text,
            fill=INK,
            font=ImageFont.load_default(size * _LARGER),
            anchor=anchor,
        )

    def bar(self, x: float, y: float, width: float, height: float, color: Color) -> None:
        """Fill a rectangle.

        Parameters
        ----------
        x, y:
            Pixels from the upper left corner of the picture to that of the rectangle.
        width, height:
            In pixels.
        color:
            Red, green, blue from 0 to 255.
        """
        self._draw.rectangle([c * _LARGER for c in (x, y, x + width, y + height)], fill=color)

    def road(self, track: Track, wall: float) -> None:
        """Draw a track between its walls.

        Parameters
        ----------
        track:
            The track.
        wall:
            Width of a wall in pixels.
        """
        inner, outer = sorted((track.left_wall, track.right_wall), key=_area)
        self.area(outer, ROAD)
        self.area(inner, FLOOR)
        self.line(_loop(track.center), CENTER, wall / 2)
        for side in (outer, inner):
            self.line(_loop(side), WALL, wall)

    def inset(self, other: Canvas, x: int, y: int) -> None:
        """Put another picture on top.

        Parameters
        ----------
        other:
            The other picture.
        x, y:
            Pixels from the upper left corner to that of the other picture.
        """
        self._image.paste(other._image, (x * _LARGER, y * _LARGER))

    @property
    def image(self) -> Image.Image:
        """The finished picture."""
        return self._image.resize(self.size, Image.Resampling.LANCZOS)


def render_car(fleet: Fleet, car: int, *, size: tuple[int, int] = (720, 480)) -> NDArray[np.uint8]:
    """Return one car from above among its beams, beside a map of the track.

    Parameters
    ----------
    fleet:
        All cars.
    car:
        Row of the car.
    size:
        Width and height in pixels.

    Returns
    -------
    ndarray of uint8
        Red, green and blue (height, width, 3).

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.car import Fleet, RCCar
    >>> from ssil_trainers.envs.rc_lidar.rendering import render_car
    >>> from ssil_trainers.envs.rc_lidar.tracks import find_track
    >>> fleet = Fleet(RCCar(), find_track("hall"), 1)
    >>> fleet.begin(np.array([True]))
    >>> render_car(fleet, 0, size=(360, 240)).shape
    (240, 360, 3)
    """
    x, y, heading = fleet.cars.pose[car]
    world = fleet.world
    track = fleet.track
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    here = np.array([x, y])
    canvas = Canvas((size[0] - _PANEL, size[1]), here + 1.2 * ahead, size[1] / 6.5)
    canvas.road(track, wall=5)
    lidar = here + world.lidar * ahead
    ends = [
        lidar + far * fleet.car.reach * (cos * ahead + sin * left)
        for far, (cos, sin) in zip(fleet.ranges(car), world.beams.directions, strict=True)
    ]
    canvas.area([lidar, *ends], (*BEAM, 22))
    for end in ends:
        canvas.line([lidar, end], (*BEAM, 120), 1.2)
        canvas.dot(end, 3, BEAM)
    _car(canvas, fleet, car, here, ahead, left)
    canvas.dot(lidar, 4, ROAD)
    page = Canvas(size, (0, 0), 1, ROAD)
    page.inset(canvas, _PANEL, 0)
    page.inset(_overview(track, here, side=_PANEL - 24), 12, 12)
    page.text(_PANEL / 2, _PANEL + 8, track.name, size=16, anchor="ma")
    page.text(_PANEL / 2, size[1] - 100, f"step {fleet.cars.steps[car]}", anchor="ma")
    page.text(_PANEL / 2, size[1] - 58, "steering", anchor="ma")
    page.bar(24, size[1] - 28, _PANEL - 48, 4, CENTER)
    steering = float(fleet.cars.steering[car])
    page.bar(_PANEL / 2 - (_PANEL / 2 - 24) * steering - 2, size[1] - 33, 4, 14, BODY)
    return np.asarray(page.image)


def draw_drive(
    track: Track,
    positions: ArrayLike,
    values: ArrayLike,
    *,
    title: str = "",
    label: str = "leverage",
    size: int = 900,
) -> Image.Image:
    """Draw a drive on its track, colored by a value of each position.

    Several drives may follow each other: where the car jumps by more than two meters, a new one
    begins.

    Parameters
    ----------
    track:
        The track.
    positions:
        x, y of the car [m] (t, 2).
    values:
        From 0 (violet) to 1 (yellow), such as leverage (t,).
    title:
        Written above.
    label:
        What the values are.
    size:
        Width of the picture in pixels.

    Returns
    -------
    PIL.Image.Image
        The picture.

    Raises
    ------
    InvalidInputError
        Unless there is one value for each position.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.rendering import draw_drive
    >>> from ssil_trainers.envs.rc_lidar.tracks import find_track
    >>> hall = find_track("hall")
    >>> draw_drive(hall, hall.sample_poses(2.0)[:, :2], np.linspace(0, 1, 80), size=300).width
    300
    """
    path = np.asarray(positions, dtype=float)
    shade = np.asarray(values, dtype=float)
    if path.shape != (len(shade), 2) or not len(path):
        raise InvalidInputError(
            f"values: expected one for each position, found {shade.shape} for {path.shape}"
        )
    low = track.center.min(axis=0)
    high = track.center.max(axis=0)
    scale = (size - 60) / (high - low + 2).max()
    height = round((high - low + 2)[1] * scale) + 130
    canvas = Canvas((size, height), (low + high) / 2 + [0, 35 / scale], scale)
    canvas.road(track, wall=2)
    for begin, end, value in zip(path[:-1], path[1:], shade[:-1], strict=True):
        if np.hypot(*(end - begin)) < 2.0:
            canvas.line([begin, end], color_for(value), 6)
            canvas.dot(end, 3, color_for(value))
    canvas.text(24, 18, title, size=18)
    for pixel in range(200):
        canvas.bar(size - 260 + pixel, 22, 1, 12, color_for(pixel / 199))
    for value in (0, 0.5, 1):
        canvas.text(size - 260 + 200 * value, 38, f"{value:g}", size=12, anchor="ma")
    canvas.text(size - 270, 20, label, size=14, anchor="ra")
    return canvas.image


def color_for(value: float) -> Color:
    """Return the color of a value.

    Parameters
    ----------
    value:
        From 0 (violet) to 1 (yellow); what is beyond is clipped.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.rendering import color_for
    >>> color_for(1.0)
    (253, 231, 37)
    """
    place = float(np.clip(value, 0.0, 1.0)) * (len(_VIRIDIS) - 1)
    r, g, b = (np.interp(place, range(len(_VIRIDIS)), _VIRIDIS[:, c]) for c in range(3))
    return round(float(r)), round(float(g)), round(float(b))


def _car(canvas: Canvas, fleet: Fleet, car: int, here: Any, ahead: Any, left: Any) -> None:
    """Draw the car's body and its wheels, the front ones turned."""
    settings = fleet.car
    angle = fleet.cars.wheels[car]
    turned = np.cos(angle) * ahead + np.sin(angle) * left
    half = settings.width / 2
    for axle, way in ((0.0, ahead), (settings.wheelbase, turned)):
        for side in (-1, 1):
            hub = here + axle * ahead + side * (half - 0.02) * left
            canvas.area(_box(hub, way, 0.055, 0.03), TIRE)
    middle = here + settings.wheelbase / 2 * ahead
    length = settings.wheelbase / 2 + settings.overhang
    canvas.area(_box(middle, ahead, length, half - 0.02), BODY)
    canvas.area(_box(middle + 0.06 * ahead, ahead, 0.09, half - 0.05), (226, 236, 246))


def _overview(track: Track, here: NDArray[np.float64], *, side: int) -> Canvas:
    """Return a small map of the track with a dot where the car is."""
    low = track.center.min(axis=0)
    high = track.center.max(axis=0)
    canvas = Canvas((side, side), (low + high) / 2, (side - 16) / (high - low).max(), ROAD)
    canvas.line(_loop(track.center), WALL, 2)
    canvas.dot(here, 5, BEAM)
    return canvas


def _box(middle: Any, way: Any, length: float, half: float) -> list[Any]:
    """Return the corners of a rectangle around its middle, from its half sides."""
    aside = np.array([-way[1], way[0]])
    corners: Iterable[tuple[int, int]] = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return [middle + a * length * way + b * half * aside for a, b in corners]


def _loop(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a closed line with its first points again at the end, so that its joint is round."""
    return np.concatenate([points, points[:2]])


def _area(points: NDArray[np.float64]) -> float:
    """Return the area of a polygon."""
    x = points[:, 0]
    y = points[:, 1]
    return abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2
