# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""A ride as a strip of rendered pictures."""

from pathlib import Path

import mujoco
import numpy as np

from sysid.errors import SysidError
from sysid.files import write_figure
from sysid.progress import steps
from sysid.roll import Array

WIDTH, HEIGHT = 360, 420
"""Of one moment's picture [px]."""


def film_strip(model: mujoco.MjModel, qpos: Array, times: Array, path: Path, *, columns: int = 5) -> None:
    """Render moments of a ride side by side into a PNG file; the camera rides along.

    Args:
        model: The scene, with the robot's meshes.
        qpos: Configurations of the whole scene, shape (t, nq).
        times: Time of each [s], shape (t,).
        columns: Pictures in a row; two rows are drawn.

    Raises:
        SysidError: This machine cannot render, or the folder cannot be written to.
    """
    from matplotlib.figure import Figure

    chosen = np.unique(np.linspace(0, len(qpos) - 1, 2 * columns).astype(int))
    images = render(model, qpos[chosen])
    rows = -(-len(images) // columns)
    figure = Figure(figsize=(2.2 * columns, 2.7 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for axes, image, index in zip(grid.flat, images, chosen, strict=False):
        axes.imshow(image)
        axes.set_title(f"{times[index]:.2f} s", fontsize=9)
    write_figure(path, figure, dpi=110)


def render(model: mujoco.MjModel, qpos: Array) -> list[Array]:
    """Return one picture for each configuration, seen from ahead on the left, shape (height, width, 3).

    Raises:
        SysidError: This machine cannot render.
    """
    data = mujoco.MjData(model)
    base = model.joint("robot/floating_base_joint").qposadr[0]
    try:
        renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    except Exception as error:
        raise SysidError(
            f"this machine cannot render ({error}). Try MUJOCO_GL=egl or MUJOCO_GL=osmesa."
        ) from error
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = 2.3, 220.0, -12.0
    images: list[Array] = []
    with renderer:
        for row in steps(list(qpos)):
            data.qpos[:] = row
            mujoco.mj_forward(model, data)
            camera.lookat[:] = [row[base], row[base + 1], 0.6]
            renderer.update_scene(data, camera)
            images.append(renderer.render().copy())
    return images
