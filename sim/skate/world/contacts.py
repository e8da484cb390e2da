# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Contact sensors of the skating scene in mjlab.

They are few and broad, because each costs time in every physics step. Contacts of other parts are all contacts
less those of the feet.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjlab.sensor import ContactSensorCfg

FORCE_THRESHOLD = 5.0
"""Force above which a foot counts as loaded [N]."""
WHEEL_FORCE_THRESHOLD = 1.0
"""Force above which a wheel counts as touching the ground [N]."""

FEET_GROUND, FEET_DECK = "feet_ground", "feet_deck"
ROBOT_GROUND, ROBOT_BOARD, SELF = "robot_ground", "robot_board", "self_contact"
WHEELS_GROUND = "wheels_ground"


def contact_sensors() -> "tuple[ContactSensorCfg, ...]":
    """Return the sensors; feet are ordered left, right, wheels front left, front right, rear left, rear right."""
    from mjlab.sensor import ContactMatch, ContactSensorCfg

    from sim.board.scene import WHEELS

    feet = ContactMatch(
        mode="subtree", pattern=("left_ankle_roll_link", "right_ankle_roll_link"), entity="robot"
    )
    robot = ContactMatch(mode="subtree", pattern="pelvis", entity="robot")
    ground = ContactMatch(mode="body", pattern="terrain")
    deck = ContactMatch(mode="body", pattern="deck", entity="board")
    board = ContactMatch(mode="subtree", pattern="board", entity="board")
    wheels = ContactMatch(mode="body", pattern=tuple(f"{w}_wheel" for w in WHEELS), entity="board")
    both = ("found", "force")
    return (
        ContactSensorCfg(name=FEET_GROUND, primary=feet, secondary=ground, fields=both, reduce="netforce"),
        ContactSensorCfg(name=FEET_DECK, primary=feet, secondary=deck, fields=both, reduce="netforce"),
        ContactSensorCfg(
            name=ROBOT_GROUND, primary=robot, secondary=ground, fields=("found",), reduce="netforce"
        ),
        ContactSensorCfg(
            name=ROBOT_BOARD, primary=robot, secondary=board, fields=("found",), reduce="netforce"
        ),
        ContactSensorCfg(name=SELF, primary=robot, secondary=robot, fields=("found",), reduce="netforce"),
        ContactSensorCfg(
            name=WHEELS_GROUND, primary=wheels, secondary=ground, fields=("force",), reduce="netforce"
        ),
    )
