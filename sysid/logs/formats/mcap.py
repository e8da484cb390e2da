"""MCAP recordings of ROS 2 (and of anything that writes JSON messages)."""

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from sysid.errors import SysidError
from sysid.logs.formats.messages import tables_of
from sysid.logs.formats.registry import Format
from sysid.logs.formats.tables import SensorTables


def open_mcap(path: Path) -> SensorTables:
    """Open an MCAP recording with ROS 2 or JSON messages; every number in every message becomes a column.

    A folder is a ROS 2 recording if it holds one such file.

    Raises:
        SysidError: The reader is not installed, the file is damaged, or no message can be decoded.
    """
    path = _recording(path)
    try:
        import zstandard
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise SysidError(
            f"{path}: reading MCAP needs an extra: pip install 'husky-sysid[mcap]' (missing: {error.name})."
        ) from error
    skipped: set[str] = set()

    def messages(file: BinaryIO) -> Iterator[tuple[str, float, Any]]:
        decoders: dict[int, Any] = {}
        factory = DecoderFactory()
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = (
                    json.loads
                    if channel.message_encoding == "json"
                    else factory.decoder_for(channel.message_encoding, schema)
                )
            decode = decoders[channel.id]
            if decode is None:
                skipped.add(channel.message_encoding)
            else:
                yield channel.topic, message.log_time * 1e-9, decode(message.data)

    try:
        with path.open("rb") as file:
            return tables_of(path, "MCAP recording", messages(file))
    except SysidError as error:
        found = f" Encodings {', '.join(sorted(skipped))} are not read." if skipped else ""
        raise SysidError(f"{error}{found}") from error
    except (
        *(McapError, zstandard.ZstdError, struct.error, ValueError, LookupError, EOFError, OSError),
        *(AssertionError, RuntimeError, TypeError, OverflowError, MemoryError),
    ) as error:
        raise SysidError(
            f"{path}: damaged MCAP file ({type(error).__name__}: {str(error)[:100]})."
        ) from error


def _recording(path: Path) -> Path:
    return next(path.glob("*.mcap")) if path.is_dir() else path


def _sniff(path: Path, head: bytes) -> bool:
    return head.startswith(b"\x89MCAP") or (path.is_dir() and len(list(path.glob("*.mcap"))) == 1)


FORMAT = Format(name="MCAP", order=2, sniff=_sniff, open=open_mcap)
