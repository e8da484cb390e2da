# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""The whole task as mjlab's configuration: scene, cycle, observations, rewards, terminations, events."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.skate.cycle.tilt_guidance import TiltGuidance
from sim.skate.mdp.actor_observation import FRAMES, NOISE, SCALE
from sim.skate.mdp.rewards import Task, rewards
from sim.skate.mdp.rewards._base import Clip
from sim.skate.options import STYLE_FRAMES, SkateOptions
from sim.skate.robot.g1 import JOINTS, motor_of
from sim.skate.robot.poses import load_poses
from sim.skate.world.posterior import BoardDraws, Spread, board_draws, draw_boards
from sim.skate.world.scene import (
    DECIMATION,
    SceneOptions,
    as_written,
    mjlab_scene,
    mjlab_simulation,
)
from sysid.board import Board

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnvCfg
    from mjlab.managers.event_manager import EventTermCfg
    from mjlab.managers.observation_manager import ObservationGroupCfg
    from mjlab.managers.reward_manager import RewardTermCfg
    from mjlab.managers.termination_manager import TerminationTermCfg

    from sim.skate.mdp.commands import SkateCommandCfg

RUNAWAY_SPEED = 4.0
"""Speed at which a ride down a slope ends as if by time [m/s]: real slopes end."""
SOLE_FRICTION_RANGE = (0.35, 1.6)
"""Factors of the soles' friction, on ground and deck: below the suite's 0.4, and up to the paper's 1.6."""


def skate_env_cfg(
    board: Board, options: SkateOptions, *, environments: int, seed: int, clips: Sequence[Clip] = ()
) -> "ManagerBasedRlEnvCfg":
    """Return the environment's configuration.

    Args:
        seed: Seed of everything random, the drawn boards included.

    Raises:
        SysidError: The board cannot be built, or the canonical poses are missing.
        ValueError: Pushing by tracking without clips.
    """
    from mjlab.envs import ManagerBasedRlEnvCfg

    from sim.skate.mdp.actions import BoardTermCfg, DelayedJointPositionCfg

    scene = SceneOptions(
        coupling=options.coupling,
        steered=options.steered,
        terrain=options.terrain,
        ledge=options.terrain == "flat" and options.strength > 0,
    )
    draws = None  # all worlds have the record's board
    if options.boards > 0:
        rng = np.random.default_rng(seed)
        boards = draw_boards(as_written(board, scene), options.boards, Spread(), rng)
        draws = board_draws(boards, scene.timestep)
    rake = board.geometry["rake"].value if options.steered else 0.0
    actions: dict[str, Any] = {
        "joint_pos": DelayedJointPositionCfg(
            entity_name="robot",
            actuator_names=(".*",),
            scale={joint: motor_of(joint).action_scale for joint in JOINTS},
            use_default_offset=True,
        ),
        "board": BoardTermCfg(
            entity_name="board",
            rake=rake if options.coupling == "direct" else None,
            dampers=None if draws is None else draws.learned_dampers,
        ),
    }
    return ManagerBasedRlEnvCfg(
        scene=mjlab_scene(board, scene, environments),
        sim=mjlab_simulation(scene),
        decimation=DECIMATION,
        episode_length_s=options.episode,
        seed=seed,
        observations=_observations(options),
        actions=actions,
        commands={"skate": skate_command_cfg(board, options)},
        rewards=reward_terms(options, clips),
        terminations=_terminations(options),
        events=_events(options, draws),
    )


def skate_command_cfg(board: Board, options: SkateOptions) -> "SkateCommandCfg":
    """Return the command term's configuration: ranges, cycle, guidance, canonical poses."""
    from sim.skate.mdp.commands import SkateCommandCfg, key_bodies_at

    poses = load_poses()
    offset = np.r_[np.zeros(7), np.full(len(JOINTS), options.pose_offset)]
    return SkateCommandCfg(
        options=options,
        guidance=TiltGuidance(
            wheelbase=board.geometry["wheelbase"].value,
            rake=board.geometry["rake"].value,
            limit=board.tilt["range"].value,
            kinematics=options.kinematics,
        ),
        ends=key_bodies_at([poses[name] + offset for name in ("push", "steer")]),
    )


def reward_terms(options: SkateOptions, clips: Sequence[Clip] = ()) -> "dict[str, RewardTermCfg]":
    """Return the reward terms of `sim/skate/mdp/rewards/`, with their weights and the phases in which they count."""
    from mjlab.managers.reward_manager import RewardTermCfg

    from sim.skate.mdp.measuring import pay

    return {
        term.name: RewardTermCfg(func=pay, weight=term.weight, params={"reward": term})
        for term in rewards(Task(options=options, clips=clips))
    }


def _observations(options: SkateOptions) -> "dict[str, ObservationGroupCfg]":
    from mjlab.managers.observation_manager import ObservationGroupCfg, ObservationTermCfg
    from mjlab.utils.noise import UniformNoiseCfg

    from sim.skate.mdp import observations

    noise = UniformNoiseCfg(n_min=tuple(-n for n in NOISE), n_max=NOISE) if options.noise else None
    frame = ObservationTermCfg(func=observations.SensedFrame, noise=noise, scale=SCALE)
    in_transitions = options.transition == "style"
    window = {"joints": ObservationTermCfg(func=observations.joint_angles, history_length=STYLE_FRAMES)}
    if in_transitions:
        window["phase"] = ObservationTermCfg(func=observations.phase_one_hot)
    return {
        "actor": ObservationGroupCfg(
            {"frame": frame}, enable_corruption=options.noise, history_length=FRAMES
        ),
        "critic": ObservationGroupCfg({"privileged": ObservationTermCfg(func=observations.CriticVector)}),
        "style": ObservationGroupCfg(window),
        "style_mask": ObservationGroupCfg(
            {
                "mask": ObservationTermCfg(
                    func=observations.style_mask,
                    params={"pushing": options.pushing == "amp", "transitions": in_transitions},
                )
            }
        ),
    }


def _terminations(options: SkateOptions) -> "dict[str, TerminationTermCfg]":
    from mjlab.envs import mdp
    from mjlab.managers.termination_manager import TerminationTermCfg

    from sim.skate.mdp import terminations
    from sim.skate.mdp.measuring import EndsAfter, ends, not_finite

    def end(rule: Any, *, func: Any = ends, time_out: bool = False, **arguments: Any) -> TerminationTermCfg:
        return TerminationTermCfg(func=func, time_out=time_out, params={"rule": rule, **arguments})

    terms = {
        "time_out": TerminationTermCfg(func=mdp.time_out, time_out=True),
        "fallen": end(terminations.fallen),
        "off_board": end(terminations.off_board, func=EndsAfter, patience=1),
        "body_contact": end(terminations.body_contact),
        "not_finite": TerminationTermCfg(func=not_finite),
    }
    if options.strength > 0:
        terms["runaway"] = end(terminations.runaway, time_out=True, speed=RUNAWAY_SPEED)
    if options.stance_patience > 0:
        terms["wrong_stance"] = end(
            terminations.wrong_stance, func=EndsAfter, patience=options.stance_patience
        )
    if options.idle_patience > 0:
        terms["idle_foot"] = end(terminations.idle_foot, patience=options.idle_patience)
    return terms


def _events(options: SkateOptions, draws: BoardDraws | None) -> "dict[str, EventTermCfg]":
    from mjlab.envs.mdp import dr
    from mjlab.managers.event_manager import EventTermCfg
    from mjlab.managers.scene_entity_config import SceneEntityCfg

    from sim.skate.mdp import randomisation
    from sim.skate.mdp.worlds import Worlds, draw_slope, roll_on

    def startup(function: Any, **params: Any) -> EventTermCfg:
        return EventTermCfg(func=function, mode="startup", params=params)

    def shifted(entity: str, body: str) -> EventTermCfg:
        return startup(
            dr.body_com_offset,
            asset_cfg=SceneEntityCfg(entity, body_names=(body,)),
            operation="add",
            ranges={axis: (-0.025, 0.025) for axis in range(3)},
        )

    events = {"begin": EventTermCfg(func=randomisation.Begin, mode="reset", params={"options": options})}
    if options.strength > 0:
        events |= {
            "torso_com": shifted("robot", "torso_link"),
            "board_com": shifted("board", "deck"),
            "sole_friction": startup(
                dr.geom_friction,
                asset_cfg=SceneEntityCfg("robot", geom_names=(".*_foot.*_collision",)),
                operation="scale",
                ranges=SOLE_FRICTION_RANGE,
                distribution="log_uniform",
                shared_random=True,
            ),
        }
    events |= {
        "worlds": startup(Worlds, strength=options.strength),
        "slope": EventTermCfg(func=draw_slope, mode="reset"),
        "ground": EventTermCfg(func=roll_on, mode="step"),
    }
    if draws is not None:
        coupled = options.steered and options.coupling == "equality"
        events["board"] = startup(randomisation.draw_board, draws=draws, coupled=coupled)
    if options.pushes > 0:
        events["push"] = EventTermCfg(
            func=randomisation.push,
            mode="interval",
            interval_range_s=(5.0, 10.0),
            params={"speed": options.pushes},
        )
    return events
