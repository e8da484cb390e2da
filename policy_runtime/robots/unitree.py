# pyright: reportMissingImports=false
# (cyclonedds is optional.)
"""The Unitree G1 over its network interface: low-level commands and states through CycloneDDS.

The motors close the servo loop. This side sends targets and gains 500 times a second and takes the robot's last
message as its state. Only the 23 joints of the policy are driven; the wrists are led slowly to
where the policy's model has them fixed. Before the first command the robot must be in its damping mode with the
factory's motion service off (as for every low-level program).
"""

import socket
import time
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from policy_runtime.robots import PD_PERIOD, JointCommand, RobotState
from sim.skate.robot.g1 import JOINTS, MOTORS
from sysid.errors import SysidError, needs_extra
from sysid.roll import Array

POLICY_MOTORS = tuple(MOTORS.index(joint) for joint in JOINTS)
"""Motor slots of the 23 joints in policy order."""
WRIST_MOTORS = tuple(i for i in range(len(MOTORS)) if i not in POLICY_MOTORS)
WRIST_STIFFNESS, WRIST_DAMPING = 20.0, 1.0
"""Gains that hold the wrists [N*m/rad], [N*m*s/rad]."""
WRIST_SPEED = 0.5
"""Speed of the wrist joints on their way to 0, where the policy's model has them fixed [rad/s]."""
PITCH_ROLL = 0
"""Mode in which ankles and waist take pitch and roll instead of the two motors of their linkage."""
CONNECT_TIMEOUT = 3.0
"""Longest time to wait for the robot's first message [s]."""


class UnitreeG1:
    """A G1 that is driven over the network."""

    def __init__(
        self, interface: str | None = None, domain: int = 0, timeout: float = CONNECT_TIMEOUT
    ) -> None:
        """Connect and wait for the first state.

        Args:
            interface: Network interface towards the robot, e.g. 'eth0'; CycloneDDS chooses one if None.
        """
        self._messages = load_messages()
        self._participant, self._writer, self._reader = open_topics(interface, domain)
        self._command: Any = None
        self._state: Any = None
        self._received = -np.inf
        self._wrists: Array | None = None
        self._sent = 0.0
        self._next = time.monotonic()
        end = time.monotonic() + timeout
        while self._state is None:
            if time.monotonic() > end:
                raise SysidError(
                    f"no G1 answers on {interface or 'any interface'}, DDS domain {domain}. Is the robot on, the cable "
                    "in, and the computer in the robot's network (192.168.123.x)?"
                )
            self._receive()
            time.sleep(PD_PERIOD)

    def read(self) -> RobotState:
        """Return the latest state; its age says how long ago it came."""
        self._receive()
        state, motors = self._state, self._state.motor_state
        return RobotState(
            time=state.tick * 1e-3,
            age=time.monotonic() - self._received,
            quaternion=np.array(state.imu_state.quaternion, dtype=np.float64),
            angular_velocity=np.array(state.imu_state.gyroscope, dtype=np.float64),
            joint_position=np.array([motors[i].q for i in POLICY_MOTORS], dtype=np.float64),
            joint_velocity=np.array([motors[i].dq for i in POLICY_MOTORS], dtype=np.float64),
            joint_torque=np.array([motors[i].tau_est for i in POLICY_MOTORS], dtype=np.float64),
            buttons=self._messages.pressed_buttons(state.wireless_remote),
        )

    def send(self, command: JointCommand) -> None:
        """Make this the command that is sent from now on."""
        message = self._messages.empty_command()
        message.mode_pr, message.mode_machine = PITCH_ROLL, self._state.mode_machine
        asked = np.column_stack([command.position, command.stiffness, command.damping]).tolist()
        for slot, values in zip(POLICY_MOTORS, asked, strict=True):
            motor = message.motor_cmd[slot]
            motor.mode, (motor.q, motor.kp, motor.kd) = 1, values
        braking = not np.any(command.stiffness)
        wrists = self._lead_wrists(braking)
        for slot, angle in zip(WRIST_MOTORS, wrists, strict=True):
            motor = message.motor_cmd[slot]
            motor.mode, motor.q = 1, float(angle)
            motor.kp, motor.kd = 0.0 if braking else WRIST_STIFFNESS, WRIST_DAMPING
        message.crc = self._messages.command_crc(message)
        self._command = message

    def _lead_wrists(self, braking: bool) -> Array:
        """Return the wrists' next targets [rad], shape (6,): slowly from their angles to the wanted ones."""
        now = time.monotonic()
        if braking or self._wrists is None:
            self._wrists = np.array([self._state.motor_state[slot].q for slot in WRIST_MOTORS])
        else:
            step = WRIST_SPEED * (now - self._sent)
            self._wrists = self._wrists + np.clip(-self._wrists, -step, step)
        self._sent = now
        return self._wrists

    def step(self) -> None:
        """Send the command once and wait for the next servo period."""
        if self._command is not None:
            self._writer.write(self._command)
        self._next = max(self._next + PD_PERIOD, time.monotonic())
        time.sleep(max(0.0, self._next - time.monotonic()))

    def close(self) -> None:
        """Leave the network."""
        del self._reader, self._writer, self._participant

    def _receive(self) -> None:
        """Read all messages; the newest with the right check sum counts."""
        for state in reversed(self._reader.take(N=50)):
            if not isinstance(state, self._messages.LowState):
                continue  # the writer went away: not a state
            if state.crc in (0, self._messages.state_crc(state)):  # 0: a firmware that does not sum
                self._state, self._received = state, time.monotonic()
                return


def load_messages() -> Any:
    """Return the module of message types."""
    with needs_extra("robot", "talking to a G1"):
        from policy_runtime.robots import unitree_messages
    return unitree_messages


def open_topics(interface: str | None, domain: int, *, as_robot: bool = False) -> tuple[Any, Any, Any]:
    """Return a DDS participant on one network interface, its writer of commands and its reader of states; of a robot, the reverse."""
    from cyclonedds.core import DDSException
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    known = sorted(name for _, name in socket.if_nameindex())
    if interface not in (None, *known):
        raise SysidError(f"no network interface '{interface}'. This computer has: {', '.join(known)}.")
    try:
        if interface is not None and (domain, interface) not in _DOMAINS:
            network = f'<NetworkInterface name="{escape(interface)}" priority="default" multicast="default"/>'
            _DOMAINS[domain, interface] = Domain(
                domain,
                f"<CycloneDDS><Domain><General><Interfaces>{network}</Interfaces></General></Domain></CycloneDDS>",
            )
        participant = DomainParticipant(domain)
    except DDSException as error:
        raise SysidError(
            f"CycloneDDS cannot use {interface or 'any interface'}, domain {domain} ({error})."
        ) from error
    messages = load_messages()
    topics = [
        Topic(participant, messages.COMMAND_TOPIC, messages.LowCmd),
        Topic(participant, messages.STATE_TOPIC, messages.LowState),
    ]
    written, read = reversed(topics) if as_robot else topics
    return participant, DataWriter(participant, written), DataReader(participant, read)


_DOMAINS: dict[tuple[int, str], Any] = {}
"""Domains configured so far: CycloneDDS forgets a configuration when its object goes."""
