import os
import pty

import pytest
from hypothesis import given
from hypothesis import strategies as st

from policy_runtime.loop.commands import (
    DOWN,
    LEFT,
    RIGHT,
    SPEED_RANGE,
    TURN_RANGE,
    UP,
    Command,
    Keyboard,
    load_script,
    pressed,
)
from sysid.errors import SysidError


def test_arrow_keys_change_speed_and_turn():
    command = Command(0.5, 0.0)
    assert pressed(command, UP) == Command(0.6, 0.0)
    assert pressed(command, DOWN) == Command(0.4, 0.0)
    assert pressed(command, LEFT) == Command(0.5, 0.1)  # left is positive
    assert pressed(command, RIGHT) == Command(0.5, -0.1)
    assert pressed(Command(0.5, 0.3), b"0") == Command(0.5, 0.0)
    assert pressed(command, b" ") == Command(0.0, 0.0)
    assert pressed(command, b"x") == command
    assert pressed(command, b"q") is None


@given(st.lists(st.sampled_from([UP, DOWN, LEFT, RIGHT, b" ", b"0", b"z"]), max_size=60))
def test_no_sequence_of_keys_leaves_the_trained_range(keys):
    command = Command(0.8, 0.0)
    for key in keys:
        command = pressed(command, key)
    assert SPEED_RANGE[0] <= command.speed <= SPEED_RANGE[1]
    assert TURN_RANGE[0] - 1e-6 <= command.turn <= TURN_RANGE[1] + 1e-6


def test_keyboard_reads_a_terminal_and_gives_it_back():
    import termios

    leader, follower = pty.openpty()
    try:
        before = termios.tcgetattr(follower)
        keyboard = Keyboard(Command(0.5, 0.0), follower)
        assert keyboard.at(0.0) == Command(0.5, 0.0)
        os.write(leader, UP + UP + LEFT)
        assert keyboard.at(0.02) == Command(0.7, 0.1)
        os.write(leader, b"q" + UP)
        assert keyboard.at(0.04) is None
        keyboard.close()
        assert termios.tcgetattr(follower) == before
    finally:
        os.close(leader)
        os.close(follower)


def test_keyboard_without_a_terminal_is_refused_in_words(tmp_path):
    with (tmp_path / "file").open("w") as file, pytest.raises(SysidError, match="need a terminal"):
        Keyboard(Command(0.5, 0.0), file.fileno())


def script(tmp_path, text):
    path = tmp_path / "commands.csv"
    path.write_text(text)
    return path


def test_script_holds_each_command_until_the_next(tmp_path):
    commands = load_script(script(tmp_path, "time_s,speed_m_s,turn_rad\n0,0.5,0\n2,1.0,0.3\n4.5,0,0\n"))
    assert commands.at(0.0) == Command(0.5, 0.0)
    assert commands.at(1.99) == Command(0.5, 0.0)
    assert commands.at(2.0) == Command(1.0, 0.3)
    assert commands.at(100.0) == Command(0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,speed_m_s,turn_rad\n", "at least one row"),
        ("time_s,speed_m_s\n0,1\n", "expected columns .*turn_rad.* found time_s, speed_m_s"),
        ("time_s,speed_m_s,turn_rad\n0,fast,0\n", "line 2: .*'fast'"),
        ("time_s,speed_m_s,turn_rad\n0,2.5,0\n", "speed 2.5 is outside the trained range, 0 to 1.5"),
        ("time_s,speed_m_s,turn_rad\n1,1,0\n", "must start at 0"),
        ("time_s,speed_m_s,turn_rad\n0,1,0\n0,1,0\n", "and increase"),
    ],
)
def test_bad_scripts_are_refused_in_words(tmp_path, text, message):
    with pytest.raises(SysidError, match=message):
        load_script(script(tmp_path, text))
