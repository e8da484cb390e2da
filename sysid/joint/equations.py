"""The equations of motion of a joint, written in CasADi, and one integration step of them.

A step is RK4. Dry friction and sliders change their branch where the rate passes through zero. Such a step is cut there:
friction keeps its sign up to the turning point. Then the joint sticks or returns for the rest of the step. Friction
therefore sticks and dissipates exactly.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

from sysid.effects._algebra import casadi_algebra
from sysid.effects._base import JointState, LinearJoint, SupportEffect, TorqueEffect
from sysid.joint.structure import LINEAR, Structure

_STILL = 1e-9
"""Rate below which the joint counts as standing [rad/s]."""


class EquationsOfMotion:
    """The equations of one structure for given symbolic parameters."""

    def __init__(self, structure: Structure, parameters: Any) -> None:
        """Split the parameter vector, shape (p,), among the effects."""
        import casadi

        self._ca: Any = casadi
        self._structure, self._parameters = structure, parameters
        self.m = casadi_algebra()
        joint = LinearJoint(*(parameters[i] for i in range(len(LINEAR))))
        self.layout = [
            (part, part.named(items_of(parameters, where)), states)
            for part, where, states in structure.layout()
        ]
        for part, values, _ in self.layout:
            if isinstance(part, TorqueEffect) and part.modifies is not None:
                joint = part.modifies(joint, values)
        self.joint = joint
        self.support = next((s for part, _, s in self.layout if isinstance(part, SupportEffect)), None)

    def motion(self, y: Any) -> JointState:
        """Return where the joint is in state y."""
        roll, rate = y[0], y[1]
        tilt = roll - self.joint.rest_angle
        if self.support is not None:
            where = self.support.start
            tilt, rate = tilt - y[where], rate - y[where + 1]
        return JointState(tilt, rate, roll, self.joint.stiffness)

    def torques(self, y: Any) -> tuple[Any, Any]:
        """Return (torque of the joint, torque on the deck alone) without dry friction [N*m]."""
        motion = self.motion(y)
        joint = -self.joint.stiffness * motion.tilt - self.joint.damping * motion.rate
        deck: Any = 0.0
        for part, values, states in self.layout:
            if not isinstance(part, TorqueEffect):
                continue
            torque = part.torque(self.m, motion, values, items_of(y, states))
            if part.grounded:
                deck = deck + torque
            else:
                joint = joint + torque
        return joint, deck

    def inertia(self, roll: Any) -> tuple[Any, Any]:
        """Return the inertia at a roll [kg*m^2], and its derivative; zero unless an effect changes it along the way."""
        inertia, by_roll = self.joint.inertia, 0.0
        for part, values, _ in self.layout:
            if isinstance(part, TorqueEffect) and part.changing is not None:
                more, slope = part.changing(self.m, roll, values)
                inertia, by_roll = inertia + more, by_roll + slope
        return inertia, by_roll

    def friction(self, tilt: Any, speed: Any) -> Any:
        """Return the dry friction of all effects at that tilt and speed [N*m]."""
        levels = [
            part.friction(self.m, tilt, speed, values)
            for part, values, _ in self.layout
            if isinstance(part, TorqueEffect) and part.friction is not None
        ]
        return sum(levels[1:], levels[0]) if levels else 0.0

    def derivative(self, y: Any, slide: Any) -> Any:
        """Return ẏ with dry friction against the sliding direction `slide`; 0 sticks, None is smooth."""
        motion = self.motion(y)
        joint, deck = self.torques(y)
        if slide is not None:
            joint = joint - slide * self.friction(motion.tilt, self.m.abs(motion.rate))
        moving: Any = 1.0 if slide is None else slide * slide
        inertia, by_roll = self.inertia(motion.roll)
        rates = [y[1] * moving, (joint + deck - by_roll * y[1] * y[1] / 2) / inertia * moving]
        for part, values, states in self.layout:
            if isinstance(part, SupportEffect):
                s, w = items_of(y, states)
                rates += [w, part.acceleration(self.m, s, w, joint, values)]
                continue
            own = items_of(y, states)
            rates += [s.rate(self.m, motion, own, values) if s.rate else 0.0 for s in part.states]
        return self._ca.vertcat(*rates)

    def slipped(self, y: Any, tilt_before: Any) -> Any:
        """Return y with its sliders carried along from `tilt_before` to the tilt of y."""
        moved = self.motion(y).tilt - tilt_before
        items = items_of(y, slice(0, y.shape[0]))
        for part, values, states in self.layout:
            for index, state in zip(range(states.start, states.stop), part.states, strict=True):
                if state.return_map is not None:
                    items[index] = state.return_map(self.m, items[index], moved, values)
        return self._ca.vertcat(*items)

    def rk4(self, y: Any, h: Any, slide: Any) -> Any:
        """Return the state after one RK4 step."""
        before = self.motion(y).tilt

        def rate(stage: Any) -> Any:
            return self._rate(stage, before, slide)

        return self.slipped(runge_kutta(rate, y, h), before)

    def _rate(self, stage: Any, before: Any, slide: Any) -> Any:
        """Return the derivative at a stage of a step that began at tilt `before`."""
        if slide is None:
            return self.derivative(self.slipped(stage, before), slide)
        return self._slipped_derivative(stage, before, slide, self._parameters)

    @cached_property
    def _slipped_derivative(self) -> Any:
        """(State, tilt before, direction of sliding, parameters) → derivative: built once for the twelve stages of a cut step."""
        ca = self._ca
        parameters = ca.SX.sym("parameters", *self._parameters.shape)
        own = EquationsOfMotion(self._structure, parameters)
        y, before, slide = (
            ca.SX.sym("y", 2 + len(self._structure.states)),
            ca.SX.sym("before"),
            ca.SX.sym("slide"),
        )
        rates = own.derivative(own.slipped(y, before), slide)
        return ca.Function("slipped_derivative", [y, before, slide, parameters], [rates])

    def direction(self, y: Any) -> Any:
        """Return where a joint that stands starts to slide: -1, +1, or 0 if friction holds it."""
        joint, deck = self.torques(y)
        torque = joint + deck
        holds = self.friction(self.motion(y).tilt, 0.0)
        return self._ca.if_else(self._ca.fabs(torque) > holds, self._ca.sign(torque), 0.0)

    def sliding(self, y: Any) -> Any:
        """Return in which direction the joint slides in state y: -1, +1, or 0 if friction holds it."""
        rate = self.motion(y).rate
        return self._ca.if_else(self._ca.fabs(rate) > _STILL, self._ca.sign(rate), self.direction(y))

    def turned(self, y: Any, whole: Any, slide: Any) -> Any:
        """Return whether the joint turned round in a step, from the states at its ends and the direction in which it slid."""
        moved = self._ca.fabs(self.motion(y).rate) > _STILL
        return self._ca.logic_and(slide * self.motion(whole).rate < 0, moved)

    def turning_share(self, y: Any, whole: Any, h: Any) -> Any:
        """Return the share of a step after which the rate passes through zero, from the states at its ends."""
        ca, motion = self._ca, self.motion(y)
        start = self._rate(y, motion.tilt, self.sliding(y))
        slope = start[1] if self.support is None else start[1] - start[self.support.start + 1]
        rate, after = motion.rate, self.motion(whole).rate
        slide = ca.sign(rate)
        # Root of the parabola through the rates at both ends with the starting acceleration, as a share of h.
        slope = h * slope
        bend = after - rate - slope
        root = ca.sqrt(ca.fmax(slope**2 - 4 * bend * rate, 1e-300))
        below = -slope * slide + root
        return ca.fmin(ca.fmax(2 * rate * slide / ca.if_else(below > 1e-30, below, 1.0), 0.0), 1.0)

    def halted(self, y: Any) -> Any:
        """Return a state with the joint at rest."""
        items = items_of(y, slice(0, y.shape[0]))
        items[1] = items[1] - self.motion(y).rate
        return self._ca.vertcat(*items)

    def event_step(self, y: Any, h: Any) -> Any:
        """Return the state after a step that is cut where the rate passes through zero."""
        share = self.turning_share(y, self.rk4(y, h, self.sliding(y)), h)
        top = self.halted(self.rk4(y, share * h, self._ca.sign(self.motion(y).rate)))
        return self.rk4(top, (1 - share) * h, self.direction(top))


def runge_kutta(rate: Callable[[Any], Any], y: Any, h: Any) -> Any:
    """Return the state after one step of RK4."""
    k1 = rate(y)
    k2 = rate(y + h / 2 * k1)
    k3 = rate(y + h / 2 * k2)
    k4 = rate(y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def items_of(vector: Any, where: slice) -> list[Any]:
    """Return the entries of a CasADi vector in a slice."""
    return [vector[index] for index in range(where.start, where.stop)]
