"""Steps of a joint one after the other."""

import numpy as np

from sysid.joint import integrator
from sysid.joint.integrator import BLOCK, Rollout, build_stepper
from sysid.joint.structure import structure_of


def test_a_joint_that_friction_holds_for_good_is_not_stepped_on(monkeypatch):
    """Friction of 1.5 N*m holds a spring of 30 N*m/rad within 0.05 rad; the same motion as if every step were made."""
    blocks = []

    class Counted(integrator.Buffered):
        def __init__(self, function):
            super().__init__(function)
            run = self.run
            self.run = lambda: (blocks.append(1), run())[1]

    monkeypatch.setattr(integrator, "Buffered", Counted)
    structure = structure_of(["coulomb"])
    stepper = build_stepper(structure, free_states=False, sensitivities=True)
    law = np.array([0.03, 30.0, 0.02, 0.0, 1.5])
    start = np.asarray(stepper.initial(law, [0.4, 0.0], 1.0)).ravel()
    given, steps = np.append(law, 0.01), 60 * BLOCK
    seen = Rollout(stepper, steps)(start, given)
    made, one, state = len(blocks), Counted(stepper.step), start
    assert made < steps // BLOCK // 2
    for row in seen.reshape(steps, -1):
        one.inputs[0][:], one.inputs[1][:] = state, given
        one.run()
        np.testing.assert_allclose(row, one.outputs[1], rtol=1e-9, atol=1e-12)
        state = one.outputs[0].copy()
