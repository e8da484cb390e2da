# %% [markdown]
# # A hidden effect, found and corrected
#
# A joint of a robot model swings differently from the real one. This notebook measures it, names the effect that the
# model is missing, fits it, and writes a corrected MJCF that moves as measured. Everything happens in Python.
#
# The log is synthetic, so the truth is known: dry friction of 0.05 N·m that the model lacks.

# %%
from pathlib import Path

import sysid
from sysid.synth import SynthOptions, synthesise

ARM = """<mujoco model="arm">
  <!-- an arm as it came from its maker: nobody measured the joint -->
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody><body name="link" pos="0 0 1">
    <joint name="knee" axis="0 1 0" stiffness="3" damping="0.02" range="-150 150"/>
    <geom type="capsule" fromto="0 0 0 0.02 0 -0.2" size="0.02" mass="0.4"/>
  </body></worldbody>
</mujoco>"""
Path("arm.xml").write_text(ARM)
joint = sysid.Joint.from_mjcf("arm.xml", "knee")
joint

# %% [markdown]
# ## The log
#
# Time and angle are arrays, as a driver or a notebook has them. Hold, let go, leave it alone: three releases.

# %%
options = SynthOptions(angles=(0.5, -0.4, 0.3), rate=400.0, duration=3.0)
recorded = synthesise(joint, {"coulomb": (0.05,)}, options)
time, angle = recorded.time, recorded.channels[:, 0]
log = sysid.Recording.from_arrays(time, angle=angle, name="swing")
log

# %% [markdown]
# ## Compare: does the model move as measured?

# %%
sysid.compare(log, joint)

# %% [markdown]
# ## Diagnose: what is missing?

# %%
found = sysid.diagnose(log, joint)
print(found.status, *found.effects)

# %% [markdown]
# ## Fit it

# %%
fit = sysid.fit(log, joint, found.effects)
fit

# %% [markdown]
# ## Check, and hand over
#
# `check` lets the joint go in MuJoCo itself. The copy of the model keeps comments and order; only the joint changes.

# %%
better = sysid.Joint.of(fit.board)
(model,) = better.to_mjcf("arm_fitted.xml")
sysid.Joint.from_mjcf(model, "knee").check(log)

# %%
print("\n".join(line for line in model.read_text().splitlines() if "knee" in line))

# %% [markdown]
# ## Report
#
# One HTML file with sliders, for a desk or a phone.

# %%
sysid.report(better, log, "arm.html")
