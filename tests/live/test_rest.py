"""Numbers come within a second of the end of a release, by the phone's own clock: seconds of a busy machine say nothing."""

from recorded_phone import export_of_two_releases, recorded_phone

from sysid.errors import SysidError
from sysid.live.phyphox import Phone
from sysid.live.rest import REST_TIMES, Rest
from sysid.live.session import Session
from sysid.recording import Recording

EVERY = 0.2


def shown(export, folder, board, count):
    """When each of some releases had its numbers, and how often the log was read [s of the phone]."""
    session, rest, times, reads = Session(board), Rest(), [], 0
    with recorded_phone(export, step=EVERY) as (served, address):
        phone = Phone(address, folder)
        phone.connect()
        while len(session.releases) < count and served.now < 60:
            if not rest.has_come(phone.poll()):
                continue
            reads += 1
            try:
                ended = session.take([Recording.read(folder)])
            except SysidError:  # nothing was let go yet
                continue
            times += [served.now] if ended else []
    return times, reads


def test_numbers_come_within_a_second_and_the_log_is_seldom_read(tmp_path, pink):
    times, reads = shown(export_of_two_releases(tmp_path), tmp_path / "log", pink, 2)
    ends = (2.06, 5.16)  # the deck is still then: releases at 1.7 and 4.8 s
    assert all(0 < seen - end < 1.0 for seen, end in zip(times, ends, strict=True))
    assert reads <= 5 * len(REST_TIMES)  # where it begins, is tilted, held, let go, tilted again
