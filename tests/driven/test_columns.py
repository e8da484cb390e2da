"""Columns of common loggers, joint by joint."""

import json

import pytest

from sysid.driven.columns import columns_of_joints, listed_names, require_columns
from sysid.errors import SysidError

JOINTS = ["hip_joint", "knee_joint"]


@pytest.mark.parametrize(
    ("names", "prefix", "found"),
    [
        (["t", "q_hip", "q_knee"], "q", {"hip_joint": "q_hip", "knee_joint": "q_knee"}),
        (["hip_pos", "knee_pos"], "pos", {"hip_joint": "hip_pos", "knee_joint": "knee_pos"}),
        (["q_1", "q_0", "dq_0", "dq_1"], "q", {"hip_joint": "q_0", "knee_joint": "q_1"}),
        (
            ["observation.state.0", "observation.state.1"],
            "observation.state",
            {"hip_joint": "observation.state.0", "knee_joint": "observation.state.1"},
        ),
        (
            ["observation.state.hip.pos", "observation.state.knee.pos", "action.hip.pos"],
            "observation.state",
            {"hip_joint": "observation.state.hip.pos", "knee_joint": "observation.state.knee.pos"},
        ),
        (["q_hip_rad", "q_knee_rad"], "q", {"hip_joint": "q_hip_rad", "knee_joint": "q_knee_rad"}),
        (["q_hip", "q_ankle"], "q", {}),
    ],
)
def test_columns_by_name_or_order(names, prefix, found):
    assert columns_of_joints(names, JOINTS, (prefix,)) == found


def test_a_list_beside_the_log_gives_the_order(tmp_path):
    (tmp_path / "info.json").write_text(
        json.dumps({"features": {"action": {"names": ["knee.pos", "hip.pos"]}}})
    )
    listed = listed_names(tmp_path / "episode.csv")
    assert listed == ["knee", "hip"]
    found = columns_of_joints(["action_0", "action_1"], JOINTS, ("action",), listed)
    assert found == {"hip_joint": "action_1", "knee_joint": "action_0"}


def test_columns_that_are_missing_are_named():
    with pytest.raises(SysidError, match=r"q_ankle.*--column PREFIX"):
        require_columns({}, JOINTS, "positions", ["q_ankle"], "--column")
