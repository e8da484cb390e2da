"""Make `lying_scene.xml`: a board that looks right on paper and swings like no board at all.

It holds the faults that are easily made in a training scene, all at once: steering servos on the
trucks that nobody mentions, a soft straight-line coupling between tilt and trucks, the deck's inertia
on the fixed body and again on the tilting one, and truck limits that stop the deck early. Spring and
damper are the board's own, to the last digit.

    python docs/examples/make_lying_scene.py
"""

import math
from pathlib import Path

from sysid.board import Board, load_board
from sysid.workspace import shipped_data

TRUCK = """
      <body name="{end}_truck" pos="{x} 0 {axle}">
        <inertial pos="0 0 0" mass="{mass}" diaginertia="4e-4 4e-5 4e-4"/>
        <joint name="{end}_truck_joint" axis="0 0 {turn}" range="-0.1 0.1"/>
        <body name="{end}_left_wheel" pos="0 {y} 0">
          <inertial pos="0 0 0" mass="{wheel}" diaginertia="1e-5 1e-5 1e-5"/>
          <joint name="{end}_left_wheel_joint" axis="0 1 0"/>
          <geom type="cylinder" size="{radius} 0.02" zaxis="0 1 0" condim="6" friction="1 0.01 0.001" priority="1"/>
        </body>
        <body name="{end}_right_wheel" pos="0 -{y} 0">
          <inertial pos="0 0 0" mass="{wheel}" diaginertia="1e-5 1e-5 1e-5"/>
          <joint name="{end}_right_wheel_joint" axis="0 1 0"/>
          <geom type="cylinder" size="{radius} 0.02" zaxis="0 1 0" condim="6" friction="1 0.01 0.001" priority="1"/>
        </body>
      </body>"""

SCENE = """<mujoco model="lying_scene">
  <!-- Made by make_lying_scene.py, to be found out by `husky-sysid check`. -->
  <compiler angle="radian"/>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <geom name="ground" type="plane" size="5 5 0.1"/>
    <body name="board" pos="0 0 {height}">
      <inertial pos="0 0 0" mass="{deck}" diaginertia="{inertia}"/>
      <freejoint name="board_free_joint"/>
      <body name="deck">
        <joint name="board_tilt_joint" axis="1 0 0" range="-{tilt} {tilt}" stiffness="{stiffness}" damping="{damping}"/>
        <geom name="deck_collision" type="box" size="{box}"/>
      </body>{trucks}
    </body>
  </worldbody>
  <equality>
    <joint joint1="board_tilt_joint" joint2="front_truck_joint" polycoef="0 {ratio} 0 0 0"/>
    <joint joint1="board_tilt_joint" joint2="rear_truck_joint" polycoef="0 {ratio} 0 0 0"/>
  </equality>
  <actuator>
    <position joint="front_truck_joint" kp="10" kv="0.5"/>
    <position joint="rear_truck_joint" kp="10" kv="0.5"/>
  </actuator>
</mujoco>
"""


def lying_scene(board: Board) -> str:
    """Return the MJCF of the scene for a board."""
    size = {key: quantity.value for key, quantity in board.geometry.items()}
    mass = {key: quantity.value for key, quantity in board.mass.items()}
    trucks = "".join(
        TRUCK.format(
            end=end,
            x=sign * size["wheelbase"] / 2,
            axle=-size["truck_height"],
            turn=-sign,
            y=size["track"] / 2,
            radius=size["wheel_radius"],
            mass=mass["truck"],
            wheel=mass["wheel"],
        )
        for end, sign in (("front", 1), ("rear", -1))
    )
    length, width, thickness = size["length"], size["width"], size["thickness"]
    squares = (width**2 + thickness**2, length**2 + thickness**2, length**2 + width**2)
    return SCENE.format(
        height=size["wheel_radius"] + size["truck_height"],
        deck=mass["deck"],
        inertia=" ".join(f"{mass['deck'] * square / 12:.6g}" for square in squares),
        box=f"{length / 2} {width / 2} {thickness / 2}",
        tilt=board.tilt["range"].value,
        stiffness=board.stiffness,
        damping=board.damping,
        ratio=f"{1 / math.tan(size['rake']):.4g}",
        trucks=trucks,
    )


if __name__ == "__main__":
    pink = load_board(shipped_data() / "boards" / "pink.toml")
    Path(__file__).with_name("lying_scene.xml").write_text(lying_scene(pink), encoding="utf-8")
