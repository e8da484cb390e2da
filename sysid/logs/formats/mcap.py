"""MCAP recordings of ROS 2 (and of anything that writes JSON messages)."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from sysid.errors import SysidError, needs_extra
from sysid.logs.formats.messages import tables_of
from sysid.logs.formats.registry import Format, undamaged
from sysid.logs.table.file import LogFile


def open_mcap(path: Path) -> LogFile:
    """Open an MCAP recording with ROS 2 or JSON messages; every number in every message becomes a column.

    A folder is a ROS 2 recording if it holds one such file.

    Raises:
        SysidError: The reader is not installed, the file is damaged, or no message can be decoded.
    """
    path = next(path.glob("*.mcap")) if path.is_dir() else path
    with needs_extra("mcap", f"{path}: reading MCAP"):
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
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
        with undamaged(path, "MCAP file"), path.open("rb") as file:
            return tables_of(path, "MCAP recording", messages(file))
    except SysidError as error:
        found = f" Encodings {', '.join(sorted(skipped))} are not read." if skipped else ""
        raise SysidError(f"{error}{found}") from error


FORMAT = Format(
    name="MCAP", order=2, open=open_mcap,
    sniff=lambda path, head: head.startswith(b"\x89MCAP") or (path.is_dir() and len(list(path.glob("*.mcap"))) == 1),
)  # fmt: skip
