"""A model as OpenUSD, by the public converter `mujoco-usd-converter` (extra `usd`), if USD can hold all of its physics."""

import shutil
import tempfile
from pathlib import Path

import mujoco
import numpy as np

from sysid.errors import SysidError, needs_extra
from sysid.files import atomic_path

SUFFIXES = (".usd", ".usda", ".usdc")


def lost_in_usd(spec: mujoco.MjSpec) -> list[str]:
    """Return the physics of a model that the converter drops without an error (its version 0.8).

    MjcPhysics has one number for a stiffness and a damping, so a polynomial would silently become linear.
    """
    lost = [
        f"{kind} polynomial of '{part.name}'"
        for part in (*spec.joints, *spec.tendons)
        for kind in ("stiffness", "damping")
        if np.any(np.atleast_1d(getattr(part, kind))[1:])
    ]
    lost += [
        f"motor '{part.name}' with inner states"
        for part in spec.actuators
        if part.dyntype == getattr(mujoco.mjtDyn, "mjDYN_DCMOTOR", None)
    ]
    lost += [f"custom numbers '{part.name}' of a learned torque" for part in spec.numerics]
    if spec.option.integrator == getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", None):
        lost.append("integrator discrete")
    return lost


def write_usd(output: Path, xml: str) -> None:
    """Write a model, given as MJCF text, as one USD file.

    Raises:
        SysidError: USD cannot hold all of its physics, the converter is missing, or the file cannot be written.
    """
    if output.suffix.lower() not in SUFFIXES:
        raise SysidError(f"--output {output}: a USD file ends in {', '.join(SUFFIXES)}.")
    spec = mujoco.MjSpec.from_string(xml)
    if lost := lost_in_usd(spec):
        raise SysidError(
            f"{output}: not written, for USD cannot hold {' and '.join(lost)}: the joint would silently become another one. Write "
            "MJCF (without --usd), or fit the joint without these effects (fit --plain)."
        )
    with needs_extra("usd", "USD files"):
        import mujoco_usd_converter  # pyright: ignore[reportMissingImports]
        import usdex.core  # pyright: ignore[reportMissingImports]
        from pxr import Usd  # pyright: ignore[reportMissingImports]
    usdex.core.activateDiagnosticsDelegate()
    usdex.core.setDiagnosticsLevel(usdex.core.DiagnosticsLevel.eError)  # lights are left out
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "model.xml"
        source.write_text(xml, encoding="utf-8")
        converter = mujoco_usd_converter.Converter(layer_structure=False)
        made = converter.convert(str(source), str(Path(folder) / "usd")).path
        with atomic_path(output) as temporary:
            if output.suffix.lower() == ".usda":
                stage = Usd.Stage.Open(made)  # kept until it is written, for its layer dies with it
                stage.GetRootLayer().Export(str(temporary))
            else:
                shutil.copyfile(made, temporary)
