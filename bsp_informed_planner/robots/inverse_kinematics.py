"""Closed-form inverse kinematics of arms with six revolute joints, by EAIK."""

from __future__ import annotations

import logging
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from bsp_informed_planner.robots.kinematic_chain import KinematicChain
from bsp_informed_planner.robots.motion_bound import joint_axes
from bsp_informed_planner.robots.numerical_ik import NumericalInverseKinematics
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)

_POLISH_ITERATIONS, _POLISH_PATIENCE = 10, 3
# Branches of a six-joint arm that differ by less in every joint are one [rad].
_DISTINCT = 1e-4
# Size of the detour around a singular pose [m and rad].
_DETOUR = 1e-3


class InverseKinematics(Protocol):
    """Finds joint values that bring a frame to a pose."""

    chain: KinematicChain

    @property
    def method(self) -> str:
        """In words."""
        ...

    def solve(self, target: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """All solutions found for a pose (4, 4) of the frame: (k, m) values of the chain's joints within the limits."""
        ...

    def solve_batch(self, targets: FloatArray, rng: np.random.Generator | None = None) -> list[FloatArray]:
        """`solve` of many poses (t, 4, 4)."""
        ...


def solver_for(model: pin.Model, frame_id: int) -> InverseKinematics:
    """The best solver for a frame: closed form where EAIK knows the arm's kinematic family, numerical otherwise."""
    return AnalyticInverseKinematics.build(model, frame_id) or NumericalInverseKinematics(
        KinematicChain.to_frame(model, frame_id)
    )


class AnalyticInverseKinematics:
    """Closed-form inverse kinematics (EAIK: Ostermeier, Kuelz, Althoff, "Automatic geometric decomposition for
    analytical inverse kinematics", IEEE Robotics and Automation Letters, 2025).

    EAIK solves chains of six revolute joints whose axes intersect or are parallel in certain ways. Near singularities
    it loses solutions or returns least-squares rows in their place. Therefore every row is brought to the pose by
    damped least squares (rows that are solutions already take one evaluation), and rows that do not get there are
    dropped. Where that tells of a singularity, poses close by are solved too, and their solutions are brought to the
    pose. At a pose that is singular itself the solutions are a continuum; some of its members are returned.
    """

    def __init__(self, model: pin.Model, frame_id: int, chain: KinematicChain, eaik_robot: Any) -> None:
        """Use `build`."""
        self.chain = chain
        self.method = f"closed form (EAIK, {eaik_robot.get_kinematic_family()})"
        self._solve = eaik_robot.calculate_IK
        self._to_eaik = _to_eaik(model, frame_id)
        self._detours = _detours()
        self._reach = chain.reach + 1e-6

    @staticmethod
    def build(model: pin.Model, frame_id: int) -> AnalyticInverseKinematics | None:
        """The solver for a frame of a model; None if EAIK is not installed or does not solve this arm.

        EAIK's claim to know the arm is tested on random configurations.
        """
        chain = KinematicChain.to_frame(model, frame_id)
        if chain.dof != 6 or chain.prismatic.any():
            return None
        try:
            from eaik.pybindings.EAIK import Robot as EaikRobot
        except ImportError:
            logger.info("EAIK is not installed; inverse kinematics is numerical")
            return None
        axes, points = _product_of_exponentials(model, frame_id)
        eaik_robot = EaikRobot(axes.T, points.T, np.eye(3), [], True)
        if not eaik_robot.has_known_decomposition():
            return None
        solver = AnalyticInverseKinematics(model, frame_id, chain, eaik_robot)
        if not solver._recovers_random_configurations():
            family = eaik_robot.get_kinematic_family()
            logger.warning("EAIK takes '%s' for %s but does not solve it", model.name, family)
            return None
        return solver

    def solve(self, target: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """See `InverseKinematics`; `rng` is not used."""
        return self.solve_batch(target[None])[0]

    def solve_batch(self, targets: FloatArray, rng: np.random.Generator | None = None) -> list[FloatArray]:
        """See `InverseKinematics`; `rng` is not used."""
        near = np.linalg.norm(targets[:, :3, 3] - self.chain.offsets[0], axis=1) <= self._reach
        solutions = [np.empty((0, self.chain.dof))] * len(targets)
        places = np.flatnonzero(near)
        answers = [self._solve(matrix) for matrix in targets[places] @ self._to_eaik]
        rows = [answer.Q for answer in answers]
        begins = np.cumsum([0, *(len(some) for some in rows)])
        if begins[-1] == 0:
            together: list[FloatArray] = [np.empty((0, self.chain.dof))] * len(places)
            reached = np.zeros(0, dtype=np.bool_)
        else:
            together, reached = self.chain.solve_batch(
                targets[places],
                np.concatenate([some for some in rows if len(some)]),
                begins,
                _POLISH_ITERATIONS,
                _POLISH_PATIENCE,
                _DISTINCT,
                int(begins[-1]),
                inside=False,
            )
        for place, answer, found, begin, end in zip(
            places.tolist(), answers, together, begins[:-1].tolist(), begins[1:].tolist(), strict=True
        ):
            # Regular poses: the proper rows are solutions, the least-squares rows are not.
            arrived = reached[begin:end]
            if arrived.any() and (arrived == np.logical_not(answer.is_LS)).all():
                solutions[place] = found
            else:
                solutions[place] = self._solve_around(targets[place], answer.Q)
        return solutions

    def _solve_around(self, target: FloatArray, rows: FloatArray) -> FloatArray:
        """Solutions of poses close by, brought to the pose."""
        seeds = [rows] if len(rows) else []
        for detour in self._detours:
            nearby = self._solve(target @ detour @ self._to_eaik).Q
            if len(nearby):
                seeds.append(nearby)
        if not seeds:
            return np.empty((0, self.chain.dof))
        return self._polished(target, np.concatenate(seeds))[0]

    def _polished(self, target: FloatArray, rows: FloatArray) -> tuple[FloatArray, np.ndarray]:
        return self.chain.solve(target, rows, _POLISH_ITERATIONS, _POLISH_PATIENCE, _DISTINCT, len(rows), inside=False)

    def _recovers_random_configurations(self, trials: int = 20) -> bool:
        rng = np.random.default_rng(0)
        for _ in range(trials):
            values = rng.uniform(self.chain.lower, self.chain.upper)
            found = self.solve(self.chain.forward(values))
            difference = np.abs(np.remainder(found - values + np.pi, 2 * np.pi) - np.pi)
            if not (difference.max(axis=1, initial=0.0) < 1e-4).any():
                return False
        return True


def _product_of_exponentials(model: pin.Model, frame_id: int) -> tuple[FloatArray, FloatArray]:
    """Axes H (6, 3) and offsets P (7, 3) at the zero configuration, in the root frame; the end is at the last joint."""
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(model.nq))
    local_axes, _ = joint_axes(model)
    joint = int(model.frames[frame_id].parentJoint)
    axes, origins = np.zeros((6, 3)), np.zeros((7, 3))
    origins[6] = data.oMi[joint].translation
    for row in range(5, -1, -1):
        axes[row] = data.oMi[joint].rotation @ local_axes[joint - 1]
        origins[row] = data.oMi[joint].translation
        joint = int(model.parents[joint])
    # URDFs round half and quarter turns to some eleven digits; EAIK should see parallel axes as parallel.
    return np.round(axes, 9), np.round(np.diff(origins, axis=0, prepend=np.zeros((1, 3))), 9)


def _to_eaik(model: pin.Model, frame_id: int) -> FloatArray:
    """(4, 4): pose of the frame times this is the pose that EAIK asks for, which is unrotated at zero."""
    frame = model.frames[frame_id]
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(model.nq))
    matrix = frame.placement.inverse().homogeneous
    unrotated = np.eye(4)
    unrotated[:3, :3] = data.oMi[frame.parentJoint].rotation.T
    return np.asarray(matrix @ unrotated)


def _detours() -> tuple[FloatArray, ...]:
    """Small motions (4, 4) off a singular pose, there and back, in a direction that is special for no arm."""
    twist = np.array([0.46, -0.27, 0.61, 0.31, 0.52, -0.41]) * _DETOUR
    forth = pin.exp6(twist).homogeneous
    return forth, np.linalg.inv(forth)
