"""Training of networks of whole paths: problems as they see them, and the loss."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.networks.path_chains import PathChains
from bsp_informed_planner.networks.problem_view import ProblemView, azimuths, turns_about_vertical
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.path_shapes import resampled, shape_of
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.signed_distance import SignedDistance

#: Waypoints of a path at which the tool is looked at for the box in which distances are taken, the share of them that
#: it leaves out on each side, and its margin [m].
_BOX_POINTS, _BOX_TAIL, _BOX_MARGIN = 16, 0.02, 0.1
#: Problems that it is made from.
_BOX_PROBLEMS = 500


def tool_box(experience: Experience, robot: Robot) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Corners (3,) of the box in which the tool mostly is on paths of problems, with the goal straight ahead [m]."""
    points = []
    for path in list(experience.paths.subset(np.arange(min(len(experience), _BOX_PROBLEMS)))):
        angle = azimuths(robot, path[-1:])[0] if turns_about_vertical(robot) else 0.0
        states = resampled(path, _BOX_POINTS)
        states[:, 0] -= angle
        points.append(robot.reference_points(states))
    every = np.concatenate(points)
    lower, upper = np.quantile(every, [_BOX_TAIL, 1.0 - _BOX_TAIL], axis=0) + np.array([[-1.0], [1.0]]) * _BOX_MARGIN
    return tuple(np.round(lower, 3).tolist()), tuple(np.round(upper, 3).tolist())


class PathExamples:
    """Problems and the shapes of their paths, each in both directions.

    Args:
        experience: solved problems.
        view: what the network sees.
        waypoints: of a shape.
        report: told how many problems have been read.
    """

    def __init__(
        self, experience: Experience, view: ProblemView, waypoints: int, report: Callable[[int, int], None]
    ) -> None:
        conditions, shapes = [], []
        for number in range(len(experience)):
            path = experience.paths[number]
            field = SignedDistance(experience.scene(number))
            conditions.append(view.conditions(field, path[[0, -1]], path[[-1, 0]]).astype(np.float16))
            shape = shape_of(path, waypoints)
            shapes.append(np.stack((shape, shape[::-1])).astype(np.float32))
            report(number + 1, len(experience))
        self.conditions = np.concatenate(conditions)
        self._shapes = np.concatenate(shapes)

    def __len__(self) -> int:
        return len(self.conditions)

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> dict[str, Tensor]:
        """conditions (b, c) and shapes (b, waypoints, n)."""
        return {
            "conditions": torch.from_numpy(self.conditions[indices].astype(np.float32)),
            "shapes": torch.from_numpy(self._shapes[indices]),
        }


class PathObjective(nn.Module):
    """The squared distance of the best head from the path, and how well the network knows which head that is.

    Args:
        network: to train.
        radii: (n,) how far each joint moves the robot, see `Robot.motion_radii`: joints count by it.
        share: of the mean over all heads in the loss, so that no head is left behind for ever.
        choice: weight of the cross entropy of the choice of a head.
    """

    def __init__(self, network: PathChains, radii: FloatArray, share: float = 0.02, choice: float = 0.05) -> None:
        super().__init__()
        self.network = network
        self.share, self.choice = share, choice
        weights = np.asarray(radii) / np.max(radii)
        self.register_buffer("weights", torch.from_numpy(weights.astype(np.float32)))

    def forward(self, batch: dict[str, Tensor]) -> dict[str, Tensor]:
        proposals = self.network(batch["conditions"])
        difference = (proposals.shapes - batch["shapes"][:, None]) * self.weights
        squares = difference.square().sum(dim=3).mean(dim=2)
        best, winner = squares.min(dim=1)
        entropy = nn.functional.cross_entropy(proposals.logits, winner)
        loss = (1.0 - self.share) * best.mean() + self.share * squares.mean() + self.choice * entropy
        return {"loss": loss, "best": best.mean().detach(), "choice": entropy.detach()}
