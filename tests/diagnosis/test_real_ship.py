"""A ship's roll decay: drag and softening, by a log that is far less noisy than any model is exact."""

import pytest

from sysid.board import load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.files import shipped_data
from sysid.logs import read_roll
from sysid.releases import find_releases


@pytest.mark.slow
def test_a_stop_that_found_its_own_noise_does_not_stand_in_for_a_ships_drag_and_softening(real_logs):
    """Soft stops beside a hanging body leave the least; what they leave was taken for noise, which excused how soft they are."""
    releases = find_releases(read_roll(real_logs / "kvlcc2_roll_decay" / "run_21337.csv"))
    verdict = diagnose(releases, load_board(shipped_data() / "boards" / "pink.toml")).verdict
    assert (verdict.status, verdict.effects) == ("missing", ("cubic-damping", "cubic-stiffness"))
