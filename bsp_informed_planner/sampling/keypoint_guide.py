"""Exact keypoints: the decomposition's chain, lifted to configurations by inverse kinematics."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import KeypointChain, shortest_chain
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance, KeypointGuideOptions
from bsp_informed_planner.sampling.guide import EXACT, GuideSetting
from bsp_informed_planner.sampling.layers import keypoint_layer, paths_through_layers, tool_orientations
from bsp_informed_planner.sampling.tube import TubeSampler, tube_sampler
from bsp_informed_planner.scene.pose import FloatArray

SAMPLER_ID = EXACT


def _never() -> bool:
    return False


def portal_normal(corners: FloatArray) -> FloatArray:
    """Unit normal (3,) of a portal's polygon (c, 3), either way (Newell's method, which no single corner spoils)."""
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    return np.asarray(normal / np.linalg.norm(normal))


class ExactKeypointGuide:
    """Finds keypoint chains by searching the connectivity graph, as Algorithm 2 of the paper does, online.

    The workspace chain comes from Dijkstra (line 5); a keypoint that no free configuration reaches is removed and the
    graph searched again (line 8); one configuration for each keypoint is chosen by a shortest path through the layers
    of all of them. Edges that are in collision are left to the planner, which is not called here.

    Args:
        robot: the robot.
        decomposition: of the scene that `checker` checks.
        options: see there.
    """

    def __init__(self, robot: Robot, decomposition: Decomposition, options: KeypointGuideOptions | None = None) -> None:
        self._robot = robot
        self._decomposition = decomposition
        self._options = options or KeypointGuideOptions()

    @property
    def sigma(self) -> float:
        """Standard deviation of the tube for this robot [rad or m]."""
        return self._options.tube_sigma(self._robot)

    def guide(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """Chains from the start to one of the goals, and the tube around them.

        Args:
            start: (n,), free.
            goals: (k, n), free.
            checker: exact check; not used by another thread meanwhile.
            should_stop: ends the work early, with what there is.

        Raises:
            KeypointsUnavailableError: if no chain connects start and goals, or time was over before there was one.
        """
        begin = time.monotonic()
        chains = self.chains(start, goals, checker, should_stop)
        sampler = self.sampler([chain.configurations for chain in chains])
        return Guidance(SAMPLER_ID, chains, sampler, seconds=time.monotonic() - begin)

    def sampler(self, chains: Sequence[FloatArray]) -> TubeSampler:
        """The Gaussian tube around chains, see `Guide`."""
        return tube_sampler(chains, self.sigma, self._robot.lower, self._robot.upper)

    def chains(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> tuple[ConfigurationChain, ...]:
        """The chains alone; arguments and errors as for `guide`."""
        should_stop = should_stop or _never
        start_pose = self._robot.forward_kinematics(start)
        # Goals that share a reference point (branches and windings of one pose) share a workspace chain.
        groups: dict[tuple[float, ...], list[int]] = {}
        for index, point in enumerate(np.round(self._robot.reference_points(goals), 6).tolist()):
            groups.setdefault(tuple(point), []).append(index)
        chains: list[tuple[bool, float, ConfigurationChain]] = []
        reason = ""
        for members in groups.values():
            if should_stop() and chains:
                break
            pose = self._robot.forward_kinematics(goals[members[0]])
            quaternions = (start_pose.quaternion, pose.quaternion)
            try:
                chains.extend(
                    self._lift(
                        start, goals[members], start_pose.position, pose.position, quaternions, checker, should_stop
                    )
                )
            except KeypointsUnavailableError as error:
                reason = error.reason
        if not chains:
            raise KeypointsUnavailableError(reason)
        chains.sort(key=lambda entry: (not entry[0], entry[1]))
        return tuple(chain for _, _, chain in chains[: self._options.chain_count])

    def _lift(
        self,
        start: FloatArray,
        goals: FloatArray,
        start_point: FloatArray,
        goal_point: FloatArray,
        quaternions: tuple[FloatArray, FloatArray],
        checker: CollisionChecker,
        should_stop: Callable[[], bool],
    ) -> list[tuple[bool, float, ConfigurationChain]]:
        removed: set[int] = set()
        layers_of: dict[int, FloatArray] = {}
        nearest_goal = goals[int(np.argmin(np.linalg.norm(goals - start, axis=1)))]
        for _ in range(self._options.removals + 1):
            chain = shortest_chain(
                self._decomposition,
                start_point,
                goal_point,
                removed_candidates=sorted(removed),
                clearance_weight=self._options.clearance_weight,
            )
            blocked = None
            for position, candidate in enumerate(chain.candidate_indices, start=1):
                if should_stop():
                    raise KeypointsUnavailableError("the time was over before the keypoints were lifted")
                if int(candidate) not in layers_of:
                    layers_of[int(candidate)] = self.layer(
                        chain, position, int(candidate), start, nearest_goal, quaternions, checker
                    )
                if not len(layers_of[int(candidate)]):
                    blocked = int(candidate)
                    break
            if blocked is None:
                break
            removed.add(blocked)
        else:
            raise KeypointsUnavailableError(
                f"{len(removed)} keypoints in a row have no collision-free configuration, the last one of "
                f"{len(self._decomposition.candidates)} at {np.round(chain.points[position], 3).tolist()} m"
            )
        layers = [layers_of[int(candidate)] for candidate in chain.candidate_indices]

        def is_free(first: FloatArray, second: FloatArray) -> bool:
            return bool(checker.surely_free_edges(np.array((first, second)))[0])

        paths = paths_through_layers(self._robot, start, layers, goals, is_free, self._options, should_stop)
        return [(path.is_free, path.length, ConfigurationChain(path.configurations, chain.points)) for path in paths]

    def layer(
        self,
        chain: KeypointChain,
        position: int,
        candidate: int,
        start: FloatArray,
        goal: FloatArray,
        quaternions: tuple[FloatArray, FloatArray],
        checker: CollisionChecker,
    ) -> FloatArray:
        """Free configurations at one keypoint of a chain: all branches, in many orientations.

        Args:
            chain: of the workspace.
            position: of the keypoint in the chain, from 1.
            candidate: index of the keypoint.
            start, goal: (n,).
            quaternions: of the tool at start and goal.
            checker: exact check.

        Returns:
            (k, n), nearest first; empty if no free configuration was found.
        """
        lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(chain.points, axis=0), axis=1))))
        fraction = float(lengths[position] / lengths[-1]) if lengths[-1] > 0.0 else 0.5
        if self._robot.orientation_free:
            orientations = quaternions[1][None]
        else:
            normal = portal_normal(self._decomposition.portal(int(self._decomposition.candidate_portals[candidate])))
            orientations = tool_orientations(*quaternions, normal, fraction, self._options)
        guess = start + fraction * (goal - start)
        return keypoint_layer(self._robot, checker, chain.points[position], orientations, guess, self._options)


def exact_guide(setting: GuideSetting) -> ExactKeypointGuide:
    """The guide of the sampler id "keypoint_tube", see `sampling.guide`."""
    return ExactKeypointGuide(setting.robot, setting.decomposition(), setting.options)
