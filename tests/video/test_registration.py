"""The whole body laid onto pictures: seen at a slant, it turns as it would from straight behind."""

import cv2
import numpy as np
import pytest
from frames import frame_of

from sysid.video.film.shake import still
from sysid.video.film.track import Track
from sysid.video.pose.rectify import project, rectify, upright
from sysid.video.registration import picture_of_body

MATRIX = np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]])
DIRECTION = np.append(np.radians([12.0, -9.0]), 0.0)
"""Yaw and pitch of the axis [rad], and no other focal length."""
TURNS = np.radians(np.concatenate([np.linspace(-20, 20, 21), np.full(9, 4.0)]))
MIDDLE, VANISHING = np.array([300.0, 250.0]), MATRIX[:2, 2]


@pytest.fixture(scope="module")
def film():
    """A board of texture that turns: its end, with four points on it, and its far part, which is smaller in the picture."""
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (480, 640)), (0, 0), 2.5)
    texture = np.clip(128 + 4 * (texture - 128), 0, 255).astype(np.uint8)
    slanted = np.linalg.inv(upright(MATRIX, DIRECTION))
    points = np.array([[210.0, 265], [400, 265], [400, 295], [210, 295]])
    frames, places = [], []
    for number, turn in enumerate(TURNS):
        picture = np.full((480, 640), 40, np.uint8)
        for corner, other, depth in (((200, 180), (410, 250), 0.8), ((190, 255), (420, 305), 1.0)):
            plate = cv2.rectangle(np.zeros_like(texture), corner, other, 1, -1)
            # A point of the axis, seen at another depth, is nearer to where the axis vanishes.
            hub = (VANISHING + depth * (MIDDLE - VANISHING)).tolist()
            rotate = np.vstack([cv2.getRotationMatrix2D(hub, -np.degrees(turn), 1.0), [0, 0, 1]])
            shown, where = (
                cv2.warpPerspective(one, slanted @ rotate, (640, 480)) for one in (texture, plate)
            )
            picture[where > 0] = shown[where > 0]
        frames.append(frame_of(number, number / 60, picture))
        places.append(project(slanted @ rotate, points))
    count = len(frames)
    track = Track(np.arange(count) / 60, np.float32(places), still(count, 900.0, 0j), np.arange(count), 0)
    return frames, track


def error(film, homography):
    """Largest error of the angle that the body's points turn by, from frame to frame [deg]."""
    frames, track = film
    body = picture_of_body(frames, (0, 0, 640, 480), track, homography)
    assert body is not None
    found = np.array([body.seen(*one) for one in zip(frames, track.points, strict=True)])
    z = rectify(found.astype(np.float64), MATRIX, DIRECTION)
    z = z - z.mean(axis=1, keepdims=True)
    angle = np.angle((z * z[10].conj()).sum(axis=1))
    off = np.degrees(angle - TURNS)
    return np.abs(off - off[10]).max()


def test_the_body_turns_as_from_straight_behind(film):
    straight = error(film, upright(MATRIX, DIRECTION))
    assert straight < 0.15
    assert straight < 0.95 * error(film, np.eye(3))


def test_light_that_falls_unevenly_turns_no_body(film):
    """A lamp that flickers from one side brightens that side more: the body is where it was."""
    frames, track = film
    body = picture_of_body(frames, (0, 0, 640, 480), track, upright(MATRIX, DIRECTION))
    assert body is not None
    down, across = np.mgrid[-1:1:480j, -1:1:640j]
    light = (0.8 + 0.15 * across + 0.15 * down) * frames[10].picture
    lit = frame_of(10, frames[10].time, np.clip(light, 0, 255).astype(np.uint8))
    off = body.seen(lit, track.points[10]) - body.seen(frames[10], track.points[10])
    assert np.abs(off).max() < 0.1  # px; 0.2 where gain and offset are the same all over
