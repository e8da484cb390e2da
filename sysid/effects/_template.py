"""Template of a user's own effect, ready to run."""

from collections.abc import Sequence

FIFTH_POWER = (("coefficient", "N*m/rad^5", "s.stiffness / s.amplitude**4", 4000.0),)
"""Parameters of the law of a new file: name, unit, size and example."""


def effect_file(
    name: str,
    *,
    title: str = "a spring like x⁵",
    does: str = "Wide swings are faster.",
    law: str = '-parameters["coefficient"] * x**5',
    text: str = "τ = -c x⁵",
    source: str = "say where the law comes from",
    parameters: Sequence[tuple[str, str, str, float]] = FIFTH_POWER,
) -> str:
    """Return the Python source of an effect.

    Args:
        name: Name for `--effect`.
        does: Its effect on a decay, in one sentence.
        law: The torque as an expression in x, v, parameters and m.
        parameters: Name, unit, size (an expression in s) and example of each.
    """
    table = "\n".join(
        f'        Parameter(name="{key}", unit="{unit}", size=lambda s: {size}, low={low}, high=20.0, starts={starts}),'
        for key, unit, size, _ in parameters
        for low, starts in (("0.05", "(1.0,)") if key.startswith("width") else ("-20.0", "(0.1, 1.0, -0.1)"),)
    )
    example = "".join(f"{value:.6g}, " for *_, value in parameters).rstrip()
    return f'''"""{title[0].upper()}{title[1:]}."""

from sysid.effects import AS_TABLE, Parameter, TorqueEffect, as_table


def torque(m, motion, parameters, states):
    """Return the torque on the deck [N*m], zero at rest. m has sin, cos, exp, abs, minimum, maximum and where."""
    x, v = motion.tilt, motion.rate  # from the rest angle [rad], and [rad/s]
    return {law}


EFFECT = TorqueEffect(
    name="{name}",
    title="{title}",
    family="hardening",  # or friction, drag, asymmetry, stop, freeplay, ...
    # Sizes are made of s.stiffness, s.amplitude, s.rate and s.torque of the joint. Bounds and starts are in units of the size.
    parameters=(
{table}
    ),
    law="{text}",
    source="{source}",
    does="{does}",
    look_alikes=(),
    experiment="Release from {{3°}}, {{7°}} and {{12°}}, to both sides.",
    mujoco=AS_TABLE,
    to_mjcf=as_table(torque),
    example=({example}),
    torque=torque,
)
'''
