# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
# pyright: reportPrivateUsage=false
# (mjlab keeps histories and the sensors' cache in private places.)
"""mjlab's environment with fewer launches.

All reward terms are in one array; rewards, terminations and observations are CUDA graphs.

mjlab weighs, cleans, sums and logs each reward term separately. With 30 terms this is 200 launches on the GPU in every step,
and 84 more in a step in which an episode ends. It also asks the device eight times for the causes of the ends. Here all terms
are weighed at once and added in mjlab's order, so that even the last bit is the same. Only the sums of
`policy_runtime.learning.progress` are logged.

A step has four parts. It acts and simulates. It judges (terminations, rewards) in one graph. It restarts ended episodes. It
observes (commands, observations) in one graph. mjlab computes all quantities, constraint forces included, between the last two
and again in the next step. Here the first half of the next step (`mujoco_warp.step1`: places, contacts, velocities) serves the
observations. Only its second half follows the action: four solves a policy step instead of five. Contact forces are those of
the last substep, and zero in an episode's first step.
"""

import sys
from collections.abc import Callable
from typing import Any

import mujoco
import mujoco_warp
import torch
import warp
from mjlab.envs import ManagerBasedRlEnv
from mjlab.managers.reward_manager import RewardManager
from mjlab.managers.termination_manager import TerminationManager
from mjlab.sim.sim import _suspend_gc

from sim.skate.mdp import measuring
from sim.skate.mdp.observations import skate_command

EAGER_CALLS = 3
"""Calls before one is recorded: libraries allocate memory at their first use."""


class Graphed:
    """A function without arguments: recorded at its fourth call, then replayed.

    The function writes lasting results in place and asks nothing of the host (no `.item()`, no lists whose length depends on
    data); Python in it runs only while it is recorded. Its result is what the recorded call returned: tensors whose content
    every replay renews. If recording fails, it warns once and goes on without a graph.
    """

    def __init__(self, function: Callable[[], Any], *, enabled: bool = True) -> None:
        """Keep the function; it is never recorded unless enabled."""
        self._function, self._enabled = function, enabled
        self._calls, self._graph, self._result = 0, None, None

    def __call__(self) -> Any:
        """Do it, and return the result."""
        self._calls += 1
        if self._graph is None and self._enabled and self._calls > EAGER_CALLS:
            self._record()
        if self._graph is None:
            return self._function()
        self._graph.replay()
        return self._result

    def _record(self) -> None:
        graph = torch.cuda.CUDAGraph()
        try:
            with torch.cuda.graph(graph, capture_error_mode="thread_local"):
                self._result = self._function()
        except RuntimeError as error:
            self._enabled, self._result = False, None
            torch.cuda.synchronize()
            reason = str(error).strip().splitlines()[0]
            print(f"{self._function}: goes on without a CUDA graph ({reason})", file=sys.stderr)  # noqa: T201
        else:
            self._graph = graph


class FusedRewards(RewardManager):
    """All terms at once."""

    def __init__(self, cfg: Any, env: ManagerBasedRlEnv, *, scale_by_dt: bool = True) -> None:
        """Put the weights on the device; change them by `set_weight`."""
        super().__init__(cfg, env, scale_by_dt=scale_by_dt)
        weights = [term.weight for term in self._term_cfgs]
        self._weights = torch.tensor(weights, device=self.device)[:, None]

    def set_weight(self, name: str, weight: float) -> None:
        """Change the weight of a term."""
        place = self._term_names.index(name)
        self._term_cfgs[place].weight = weight
        self._weights[place] = weight

    def compute(self, dt: float) -> torch.Tensor:
        """Return the sum of all weighted terms of this step, (n,)."""
        scale = dt if self._scale_by_dt else 1.0
        raw = torch.stack([term.func(self._env, **term.params) for term in self._term_cfgs])
        # Values that are not finite count as zero, as in mjlab.
        values = torch.nan_to_num(raw * self._weights * scale, nan=0.0, posinf=0.0, neginf=0.0)
        self._reward_buf.zero_()
        for value in values:
            self._reward_buf += value
        self._step_reward.copy_((values / scale).T)
        return self._reward_buf

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> dict[str, torch.Tensor]:
        """Return no log: `Progress` has the sums, and no term remembers."""
        return {}


class QuietTerminations(TerminationManager):
    """Terminations written in place, for a graph, without mjlab's counts, which wait for the device."""

    def compute(self) -> torch.Tensor:
        """Return whose episode is over, (n,)."""
        self._truncated_buf.zero_()
        self._terminated_buf.zero_()
        for name, term in zip(self._term_names, self._term_cfgs, strict=True):
            over = self._term_dones[name].copy_(term.func(self._env, **term.params))
            ended = self._truncated_buf if term.time_out else self._terminated_buf
            ended |= over
        return self._truncated_buf | self._terminated_buf

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> dict[str, torch.Tensor]:
        """Let the terms that remember begin anew."""
        for term in self._class_term_cfgs:
            term.func.reset(env_ids=slice(None) if env_ids is None else env_ids)
        return {}


class FrameHistory:
    """The last frames, oldest first, in one place in memory; stands for mjlab's circular buffer."""

    def __init__(self, length: int) -> None:
        """Keep so many frames."""
        self._length = length
        self._frames: torch.Tensor | None = None
        self._new: torch.Tensor | None = None

    @property
    def is_initialized(self) -> bool:
        """Whether there are frames."""
        return self._frames is not None

    @property
    def buffer(self) -> torch.Tensor:
        """Frames, oldest first, (n, length, …)."""
        assert self._frames is not None  # mjlab appends first
        return self._frames

    def append(self, frame: torch.Tensor) -> None:
        """Add a frame, (n, …); the first of an episode fills all places."""
        repeated = frame[:, None].expand(-1, self._length, *frame.shape[1:])
        if self._frames is None or self._new is None:
            self._frames = repeated.clone()
            self._new = torch.zeros(len(frame), dtype=torch.bool, device=frame.device)
            return
        later = torch.cat((self._frames[:, 1:], frame[:, None]), dim=1)
        new = self._new.view(-1, *[1] * frame.ndim)
        self._frames.copy_(torch.where(new, repeated, later))
        self._new.zero_()

    def backfill(self, frame: torch.Tensor, ids: torch.Tensor) -> None:
        """Fill all places of some worlds with their frame."""
        assert self._frames is not None  # mjlab appends first
        assert self._new is not None
        self._frames[ids] = frame[ids][:, None]
        self._new[ids] = False

    def reset(self, batch_ids: Any = None) -> None:
        """Let the next frame of some worlds be an episode's first."""
        if self._new is not None:
            self._new[slice(None) if batch_ids is None else batch_ids] = True


class HalfStep:
    """Half of a step of all worlds, as a CUDA graph where mjlab uses those for whole steps."""

    def __init__(self, sim: Any, function: Any) -> None:
        """Record it; arrays of the model must stay in their places from now on."""
        self._sim, self._function, self._graph = sim, function, None
        if sim.use_cuda_graph:
            with _suspend_gc(), warp.ScopedDevice(sim.wp_device), warp.ScopedCapture() as capture:
                function(sim.wp_model, sim.wp_data)
            self._graph = capture.graph

    def __call__(self) -> None:
        """Do it."""
        sim = self._sim
        with warp.ScopedDevice(sim.wp_device), sim.nan_guard.watch(sim.data):
            if self._graph is None:
                self._function(sim.wp_model, sim.wp_data)
            else:
                warp.capture_launch(self._graph)


class SkateEnv(ManagerBasedRlEnv):
    """mjlab's environment, stepped in two graphs."""

    def __init__(self, cfg: Any, device: str) -> None:
        """Build the worlds; on a GPU it records CUDA graphs."""
        super().__init__(cfg, device)
        model = self.sim.mj_model
        felt = model.sensor_needstage == mujoco.mjtStage.mjSTAGE_ACC
        columns = [
            column
            for start, size in zip(model.sensor_adr[felt], model.sensor_dim[felt], strict=True)
            for column in range(start, start + size)
        ]
        self._felt_columns = torch.tensor(columns, device=device)
        # mjlab's own array writes on Warp's stream, outside the graphs of PyTorch.
        self._sensordata = self.sim.data.sensordata[:]
        self._felt = self._sensordata[:, self._felt_columns]
        graphs = device != "cpu"
        begin: Any = self.event_manager.get_term_cfg("begin").func
        for term in (begin, skate_command(self)):
            term.draw = Graphed(term.draw, enabled=graphs)
        self._first_half = HalfStep(self.sim, mujoco_warp.step1)
        self._second_half = HalfStep(self.sim, mujoco_warp.step2)
        self._judge = Graphed(self._judge_state, enabled=graphs)
        self._see = Graphed(self._see_state, enabled=graphs)

    def load_managers(self) -> None:
        """Load all managers, exchange two and the history of observations."""
        super().load_managers()
        self.reward_manager = FusedRewards(self.cfg.rewards, self, scale_by_dt=self.cfg.scale_rewards_by_dt)
        self.termination_manager = QuietTerminations(self.cfg.terminations, self)
        histories: dict[str, dict[str, Any]] = self.observation_manager._group_obs_term_history_buffer
        for buffers in histories.values():
            for name, buffer in buffers.items():
                buffers[name] = FrameHistory(buffer.max_length)

    def step(self, action: torch.Tensor) -> Any:
        """Take a policy step; returns like mjlab's environment."""
        self.extras["log"] = {}
        self.action_manager.process_action(action)
        for substep in range(self.cfg.decimation):
            self.action_manager.apply_action()
            self.scene.write_data_to_sim()
            if substep == 0:
                self._second_half()  # the first was taken at the end of the last step, or by a reset's forward
            else:
                self.sim.step()
            self.scene.update(dt=self.physics_dt)
        self._sim_step_counter += self.cfg.decimation
        self.common_step_counter += 1
        measuring.keep(self, self._judge())
        for mode in ("step", "interval"):
            if mode in self.event_manager.available_modes:
                self.event_manager.apply(mode=mode, dt=self.step_dt)
        over = self.reset_buf.nonzero(as_tuple=False).squeeze(-1)
        if len(over) > 0:
            self._reset_idx(over)
            self.scene.write_data_to_sim()
        self._first_half()
        # Copied, because the graph overwrites it and the learner keeps it.
        self.obs_buf = {name: seen.clone() for name, seen in self._see().items()}
        return self.obs_buf, self.reward_buf, self.reset_terminated, self.reset_time_outs, self.extras

    def _judge_state(self) -> Any:
        """Compute ends and rewards; return the state that they were computed from."""
        measuring.keep(self, None)
        self._felt.copy_(self._sensordata[:, self._felt_columns])
        self.episode_length_buf += 1
        self.reset_buf = self.termination_manager.compute()
        self.reset_terminated = self.termination_manager.terminated
        self.reset_time_outs = self.termination_manager.time_outs
        self.reward_buf = self.reward_manager.compute(dt=self.step_dt)
        return measuring.measured(self)

    def _see_state(self) -> Any:
        felt = torch.where(self.reset_buf[:, None], 0.0, self._felt)
        self._sensordata[:, self._felt_columns] = felt
        for sensor in self.scene.sensors.values():
            sensor._invalidate_cache()
        self.command_manager.compute(dt=self.step_dt)
        return self.observation_manager.compute(update_history=True)
