# pyright: reportMissingImports=false
# (cyclonedds is optional.)
"""A simulated G1 that speaks the robot's own messages: to rehearse a run without a robot."""

import threading
import time
from typing import Any

import numpy as np

from policy_runtime.robots import ARM, BEGIN, PD_PERIOD, JointCommand
from policy_runtime.robots.simulated import SimulatedRobot
from policy_runtime.robots.unitree import POLICY_MOTORS, WRIST_MOTORS, load_messages, open_topics

LOOPBACK = "lo"
"""The network interface on which a computer talks to itself."""


class SimulatedG1:
    """Steps a simulated robot in real time, publishes its state and obeys the commands that come.

    Use it as a context manager. Until the first command the servos only brake, as the real robot's
    damping mode does.
    """

    def __init__(
        self, robot: SimulatedRobot, *, interface: str | None = None, domain: int = 0, hoisted: bool = False
    ) -> None:
        """Join the network.

        Args:
            interface: Network interface; CycloneDDS chooses one if None.
            hoisted: Hang on a hoist over the board: pelvis and board stay where they are, the joints move.
        """
        self._messages = load_messages()
        self._participant, self._writer, self._reader = open_topics(interface, domain, as_robot=True)
        self._robot = robot
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.pressed: frozenset[str] = frozenset()
        """Buttons of the handset that are held down."""
        self.hoisted = hoisted
        self.wrists = np.zeros(len(WRIST_MOTORS))
        """[rad], shape (6,). Massless: they reach their targets as soon as their servos hold."""

    def __enter__(self) -> "SimulatedG1":
        """Start to move."""
        self._robot.send(JointCommand.brake())
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop."""
        self._stop.set()
        self._thread.join()
        del self._reader, self._writer, self._participant

    def assist(self, kind: str) -> None:
        """Act like people beside a real robot at an event of its run: arm it, let it down, begin, step back."""
        presses = {"wait": ARM, "ready": BEGIN}
        self.pressed = frozenset({presses[kind]} if kind in presses else ())
        self.hoisted = self.hoisted and kind not in ("ready", "start")

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            self._obey()
            self._robot.step()
            if self.hoisted:
                self._robot.hang()
            self.publish()
            due = max(due + PD_PERIOD, time.monotonic() - 0.1)  # do not race after a long pause
            time.sleep(max(0.0, due - time.monotonic()))

    def publish(self) -> None:
        """Send the state."""
        self._writer.write(self._state())

    def _obey(self) -> None:
        newest = next(
            (c for c in reversed(self._reader.take(N=50)) if isinstance(c, self._messages.LowCmd)), None
        )
        if newest is None or newest.crc != self._messages.command_crc(newest):
            return
        if all(newest.motor_cmd[slot].kp > 0 for slot in WRIST_MOTORS):
            self.wrists = np.array([newest.motor_cmd[slot].q for slot in WRIST_MOTORS])
        motors = [newest.motor_cmd[slot] for slot in POLICY_MOTORS]
        on = np.array([motor.mode == 1 for motor in motors], dtype=np.float64)
        self._robot.send(
            JointCommand(
                position=np.array([motor.q for motor in motors]),
                stiffness=on * np.array([motor.kp for motor in motors]),
                damping=on * np.array([motor.kd for motor in motors]),
            )
        )

    def _state(self) -> Any:
        own, message = self._robot.read(), self._messages.empty_state()
        message.tick = round(own.time * 1e3)
        message.imu_state.quaternion = own.quaternion.tolist()
        message.imu_state.gyroscope = own.angular_velocity.tolist()
        measured = np.column_stack([own.joint_position, own.joint_velocity, own.joint_torque]).tolist()
        for slot, values in zip(POLICY_MOTORS, measured, strict=True):
            motor = message.motor_state[slot]
            motor.mode, (motor.q, motor.dq, motor.tau_est) = 1, values
        for slot, angle in zip(WRIST_MOTORS, self.wrists.tolist(), strict=True):
            message.motor_state[slot].q = angle
        message.wireless_remote = self._messages.handset_bytes(self.pressed)
        # The sum runs over single precision, as the message travels.
        message.crc = self._messages.state_crc(message)
        return message
