# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUntypedClassDecorator=false
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportCallIssue=false
# (cyclonedds is optional, and its types are made when they are declared.)
"""The low-level messages of Unitree's humanoids (`unitree_hg`), for CycloneDDS.

Field names, order and sizes are Unitree's published interface (unitree_sdk2, BSD-3-Clause); both sides must
agree on all of them.
"""

import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import array, float32, int16, uint8, uint32

COMMAND_TOPIC, STATE_TOPIC = "rt/lowcmd", "rt/lowstate"
MOTORS = 35
"""Motor slots in a message; the G1 uses the first 29."""

BUTTONS = (
    *("R1", "L1", "start", "select", "R2", "L2", "F1", "F2"),
    *("A", "B", "X", "Y", "up", "right", "down", "left"),
)
"""Of the handset, in the order of their bits: bytes 2 and 3 of `LowState.wireless_remote`, lowest bit first."""


@dataclass
@final
@autoid("sequential")
class MotorCmd(IdlStruct, typename="unitree_hg.msg.dds_.MotorCmd_"):
    """Command to one motor: torque = tau + kp (q - measured) + kd (dq - measured)."""

    mode: uint8
    q: float32
    dq: float32
    tau: float32
    kp: float32
    kd: float32
    reserve: uint32


@dataclass
@final
@autoid("sequential")
class LowCmd(IdlStruct, typename="unitree_hg.msg.dds_.LowCmd_"):
    """One command to all motors."""

    mode_pr: uint8
    mode_machine: uint8
    motor_cmd: array[MotorCmd, MOTORS]
    reserve: array[uint32, 4]
    crc: uint32

    def serialize(
        self, buffer: Any = None, endianness: Any = None, use_version_2: bool | None = None
    ) -> bytes:
        """Return the message as it travels; by one call where CycloneDDS's own way takes hundreds."""
        if buffer is not None or endianness is not None or use_version_2:
            return super().serialize(buffer, endianness, use_version_2)
        return _HEADER + _COMMAND_WIRE.pack(*_command_values(self), self.crc)


@dataclass
@final
@autoid("sequential")
class IMUState(IdlStruct, typename="unitree_hg.msg.dds_.IMUState_"):
    """The IMU in the pelvis."""

    quaternion: array[float32, 4]
    gyroscope: array[float32, 3]
    accelerometer: array[float32, 3]
    rpy: array[float32, 3]
    temperature: int16


@dataclass
@final
@autoid("sequential")
class MotorState(IdlStruct, typename="unitree_hg.msg.dds_.MotorState_"):
    """Measurements of one motor."""

    mode: uint8
    q: float32
    dq: float32
    ddq: float32
    tau_est: float32
    temperature: array[int16, 2]
    vol: float32
    sensor: array[uint32, 2]
    motorstate: uint32
    reserve: array[uint32, 4]


@dataclass
@final
@autoid("sequential")
class LowState(IdlStruct, typename="unitree_hg.msg.dds_.LowState_"):
    """One state of the whole robot."""

    version: array[uint32, 2]
    mode_pr: uint8
    mode_machine: uint8
    tick: uint32
    imu_state: IMUState
    motor_state: array[MotorState, MOTORS]
    wireless_remote: array[uint8, 40]
    reserve: array[uint32, 4]
    crc: uint32

    def serialize(
        self, buffer: Any = None, endianness: Any = None, use_version_2: bool | None = None
    ) -> bytes:
        """Return the message as it travels; see `LowCmd.serialize`."""
        if buffer is not None or endianness is not None or use_version_2:
            return super().serialize(buffer, endianness, use_version_2)
        return _HEADER + _STATE_WIRE.pack(*_state_values(self), self.crc)

    @classmethod
    def deserialize(
        cls, data: bytes, has_header: bool = True, use_version_2: bool | None = None
    ) -> "LowState":
        """Decode a message."""
        if not has_header or data[:2] != _HEADER[:2] or len(data) < 4 + _STATE_WIRE.size:
            return super().deserialize(data, has_header, use_version_2)
        return _state_of(_STATE_WIRE.unpack_from(data, 4))


def empty_command() -> LowCmd:
    """Return an empty command."""
    motors = [MotorCmd(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0) for _ in range(MOTORS)]
    return LowCmd(0, 0, motors, [0] * 4, 0)


def empty_state() -> LowState:
    """Return a state of zeros, upright."""
    imu = IMUState([1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, [0.0] * 3, 0)
    motors = [MotorState(0, 0.0, 0.0, 0.0, 0.0, [0, 0], 0.0, [0, 0], 0, [0] * 4) for _ in range(MOTORS)]
    return LowState([0, 0], 0, 0, 0, imu, motors, [0] * 40, [0] * 4, 0)


def pressed_buttons(remote: Any) -> frozenset[str]:
    """Return which buttons the 40 bytes of the handset say are pressed."""
    bits = int(remote[2]) | int(remote[3]) << 8
    return frozenset(name for i, name in enumerate(BUTTONS) if bits >> i & 1)


def handset_bytes(buttons: frozenset[str]) -> list[int]:
    """Return the 40 bytes of a handset with these buttons pressed and its sticks at rest."""
    bits = sum(1 << BUTTONS.index(name) for name in buttons)
    return [0, 0, bits & 0xFF, bits >> 8, *[0] * 36]


# The check sum runs over the message as a C struct lays it out, little-endian and padded to four bytes.
_COMMAND_LAYOUT = struct.Struct("<2B2x" + "B3x5fI" * MOTORS + "4I")
_STATE_LAYOUT = struct.Struct("<2I2B2xI" + "13fh2x" + "B3x4f2hf2II4I" * MOTORS + "40B4I")


# On the wire a motor follows the field before it without padding.
_COMMAND_WIRE = struct.Struct("<2B" + "Bx5fI" + "B3x5fI" * (MOTORS - 1) + "4II")
_STATE_WIRE = struct.Struct("<2I2B2xI" + "13fh" + "Bx4f2hf2II4I" + "B3x4f2hf2II4I" * (MOTORS - 1) + "40B4II")
_HEADER = b"\x00\x01\x00\x00"
"""Header of plain little-endian data in the first encoding of DDS."""


def command_crc(command: LowCmd) -> int:
    """Return the check sum that the robot expects of a command."""
    return crc32(_COMMAND_LAYOUT.pack(*_command_values(command)))


def state_crc(state: LowState) -> int:
    """Return the check sum of a state."""
    return crc32(_STATE_LAYOUT.pack(*_state_values(state)))


def _command_values(command: LowCmd) -> list[Any]:
    """Return all numbers of a command but its sum, in order."""
    values: list[Any] = [command.mode_pr, command.mode_machine]
    for motor in command.motor_cmd:
        values += [motor.mode, motor.q, motor.dq, motor.tau, motor.kp, motor.kd, motor.reserve]
    return [*values, *command.reserve]


def _state_values(state: LowState) -> list[Any]:
    """Return all numbers of a state but its sum, in order."""
    imu = state.imu_state
    values: list[Any] = [*state.version, state.mode_pr, state.mode_machine, state.tick]
    values += [*imu.quaternion, *imu.gyroscope, *imu.accelerometer, *imu.rpy, imu.temperature]
    for motor in state.motor_state:
        values += [motor.mode, motor.q, motor.dq, motor.ddq, motor.tau_est, *motor.temperature, motor.vol]
        values += [*motor.sensor, motor.motorstate, *motor.reserve]
    return [*values, *state.wireless_remote, *state.reserve]


def _state_of(numbers: tuple[Any, ...]) -> LowState:
    """Return the state of all its numbers, in order."""
    v = list(numbers)
    imu = IMUState(v[5:9], v[9:12], v[12:15], v[15:18], v[18])
    motors = [
        MotorState(v[i], v[i + 1], v[i + 2], v[i + 3], v[i + 4], v[i + 5 : i + 7], v[i + 7],
                   v[i + 8 : i + 10], v[i + 10], v[i + 11 : i + 15])
        for i in range(19, 19 + 15 * MOTORS, 15)
    ]  # fmt: skip
    end = 19 + 15 * MOTORS
    return LowState(
        v[:2], v[2], v[3], v[4], imu, motors, bytes(v[end : end + 40]), v[end + 40 : end + 44], v[end + 44]
    )


def crc32(data: bytes) -> int:
    """Return the CRC-32/MPEG-2 of 32-bit little-endian words, each taken from its highest bit down.

    Polynomial 0x04C11DB7, start 0xFFFFFFFF, no final inversion. It is the common CRC-32 with every bit
    order reversed, and that one is fast.
    """
    words = np.frombuffer(data, dtype="<u4").byteswap().tobytes()
    return int(f"{zlib.crc32(words.translate(_REVERSED)) ^ 0xFFFFFFFF:032b}"[::-1], 2)


_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Every byte with its bits in reverse order."""
