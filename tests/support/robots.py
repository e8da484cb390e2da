"""MuJoCo models as strangers write them: defaults, includes, degrees, comments, a keyframe, a loop, a slide."""

from pathlib import Path

from sysid.board import Board
from sysid.quantity import Quantity

ARM = """<mujoco model="arm">
  <!-- a pendulum behind a gear; angles in degrees, as is MuJoCo's habit -->
  <compiler angle="degree"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <joint damping="0.02"/>
    <default class="geared"><joint armature="0.001" frictionloss="0.01"/></default>
  </default>
  <include file="parts/link.xml"/>
  <actuator>
    <motor name="motor" joint="knee" gear="50"/> <!-- off while it swings -->
  </actuator>
  <keyframe><key name="bent" qpos="0 0.5"/></keyframe>
</mujoco>
"""
LINK = """<mujocoinclude>
  <worldbody>
    <body name="link" pos="0 0 1">
      <!-- the joint -->
      <joint name="knee" class="geared" axis="0 1 0"
             range="-150 150"/>
      <geom type="capsule" fromto="0 0 0 0.02 0 -0.2" size="0.02" mass="0.4"/>
      <site name="tip" pos="0 0 -0.2"/>
      <body name="foot" pos="0 0 -0.2">
        <joint name="ankle" axis="0 1 0"/>
        <geom type="sphere" size="0.03" mass="0.2" pos="0 0 -0.1"/>
      </body>
    </body>
  </worldbody>
</mujocoinclude>
"""
LEG = """<mujoco model="leg">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001"/>
  <default><equality solref="0.002 1"/></default>
  <worldbody>
    <body name="thigh" pos="0 0 1">
      <joint name="hip" axis="0 1 0" range="-0.6 0.6"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.8"/>
      <body name="shank" pos="0 0 -0.3">
        <joint name="knee" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 -0.3" size="0.015" mass="0.4"/>
      </body>
    </body>
    <body name="rod" pos="0.15 0 1">
      <joint name="crank" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.34" size="0.01" mass="0.1"/>
    </body>
  </worldbody>
  <equality><connect body1="shank" body2="rod" anchor="0.15 0 -0.04"/></equality>
</mujoco>
"""
SLIDER = """<mujoco model="slider">
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body name="cart" pos="0 0 1">
      <joint name="lift" type="slide" axis="0 0 1" stiffness="200" springref="0.03" damping="0.8" range="-0.2 0.2" limited="true"/>
      <geom type="box" size="0.05 0.05 0.05" mass="1.5"/>
    </body>
  </worldbody>
</mujoco>
"""


def write(folder: Path) -> dict[str, Path]:
    """Write the models into a folder and return their files by name."""
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    (folder / "parts" / "link.xml").write_text(LINK)
    files = {"arm": ARM, "leg": LEG, "slider": SLIDER}
    for name, text in files.items():
        (folder / f"{name}.xml").write_text(text)
    return {name: folder / f"{name}.xml" for name in files}


def plain(inertia: float, stiffness: float, damping: float, rest: float = 0.0) -> Board:
    """Return a record that the synthetic truth is made from; it never sees the model."""
    return Board(
        name="truth", description="", source="", geometry={}, mass={}, inertia=Quantity(inertia, 0.0, "kg*m^2"),
        tilt={
            "stiffness": Quantity(stiffness, 0.0, "N*m/rad"), "damping": Quantity(damping, 0.0, "N*m*s/rad"),
            "rest_angle": Quantity(rest, 0.0, "rad"), "range": Quantity(3.0, 0.0, "rad"),
        },
    )  # fmt: skip


def assert_near(found: dict[str, dict[str, list[float]]], truth: dict[str, float]) -> None:
    """Each value of a result file lies within four standard deviations of the truth."""
    for name, value in truth.items():
        low, high = found[name]["ci95"]
        assert low - (high - low) / 2 < value < high + (high - low) / 2, name
