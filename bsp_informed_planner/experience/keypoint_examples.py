"""Training of keypoint networks: examples from datasets, and losses (Algorithm 1, line 2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from bsp_informed_planner.decomposition.cost_to_go import NOWHERE, CostToGo, cost_to_go
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import DatasetMismatchError, KeypointsUnavailableError
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.symmetries import random_symmetry, turned_grids, turned_points
from bsp_informed_planner.networks.encoding import PlanarDistances, SceneEncoding
from bsp_informed_planner.networks.keypoint_heatmap import KeypointHeatmap
from bsp_informed_planner.networks.keypoint_regression import KeypointRegression
from bsp_informed_planner.scene.encodings import unit_cell_centres
from bsp_informed_planner.scene.pose import FloatArray

Report = Callable[[int, int], None]
_Floats32 = NDArray[np.float32]


def _silent(done: int, total: int) -> None:
    pass


class RegressionExamples:
    """Pairs of neighbouring keypoints of the chains of a dataset, with scene and target: as the paper trains.

    Args:
        experience: solved problems.
        encoding: of their scenes.
        planar: whether states are points of the plane, whose symmetries are used as augmentation.
        noise: standard deviation of what is added to current keypoints, in unit coordinates.
    """

    def __init__(self, experience: Experience, encoding: SceneEncoding, planar: bool, noise: float) -> None:
        self._planar, self._noise = planar, noise
        scenes, rows = [], []
        currents, nexts, targets = [], [], []
        for number in range(len(experience)):
            scene = experience.scene(number)
            chain = encoding.state_frame(scene).to_unit(experience.keypoints[number])
            scenes.append(encoding.encode(scene))
            rows += [number] * (len(chain) - 1)
            currents.append(chain[:-1])
            nexts.append(chain[1:])
            targets.append(np.repeat(chain[-1:], len(chain) - 1, axis=0))
        self._scenes = np.array(scenes, dtype=np.float32)
        self._rows = np.array(rows, dtype=np.int64)
        self._currents, self._nexts, self._targets = (
            np.concatenate([np.zeros((0, experience.dof)), *parts]).astype(np.float32)
            for parts in (currents, nexts, targets)
        )

    def __len__(self) -> int:
        return len(self._rows)

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> dict[str, Tensor]:
        """scenes (b, s), currents, targets, nexts (b, n)."""
        scenes = torch.from_numpy(self._scenes[self._rows[indices]])
        states = [torch.from_numpy(array[indices]) for array in (self._currents, self._targets, self._nexts)]
        if self._planar:
            symmetry = random_symmetry(rng)
            scenes = turned_grids(symmetry, scenes)
            states = [turned_points(symmetry, points) for points in states]
        if rng is not None and self._noise > 0.0:
            states[0] = states[0] + torch.from_numpy(rng.normal(0.0, self._noise, states[0].shape).astype(np.float32))
        currents, targets, nexts = states
        return {"scenes": scenes.flatten(1), "currents": currents, "targets": targets, "nexts": nexts}


class RegressionObjective(nn.Module):
    """Mean squared error of the next keypoint."""

    def __init__(self, network: KeypointRegression) -> None:
        super().__init__()
        self.network = network

    def forward(self, batch: dict[str, Tensor]) -> dict[str, Tensor]:
        estimated = self.network(batch["scenes"], batch["currents"], batch["targets"])
        error = estimated - batch["nexts"]
        return {"loss": (error**2).mean(), "distance": error.norm(dim=1).mean().detach()}


@dataclass(frozen=True)
class HeatmapTargets:
    """How targets of the heatmap network are made from the scenes of a dataset.

    The chain that Algorithm 2 finds for a point robot is the shortest one through the connectivity graph. One search
    from the goal gives it for all starts (`cost_to_go`), so that each scene teaches the next keypoint from everywhere.

    Attributes:
        currents: current keypoints kept for a scene and goal; half of them anywhere free, half keypoint candidates.
        drawn: of these, how many are drawn for each visit.
        clearance_weight: see `shortest_chain`: keypoints in the middle of gaps forgive small errors.
        progress: keypoints nearer than this are passed over for the next of the chain, in edges of the grid.
        noise: standard deviation of what is added to current keypoints that are candidates, in edges of the grid.
        both_ways: whether the start is used as a goal too.
    """

    currents: int = 96
    drawn: int = 32
    clearance_weight: float = 0.1
    progress: float = 0.03
    noise: float = 0.01
    both_ways: bool = True


class HeatmapExamples:
    """Scenes with a goal, current keypoints, and the next keypoint of the exact chain from each of these.

    Args:
        experience: solved problems of a planar robot.
        encoding: of their scenes; the grid of the network has half as many cells.
        targets: how targets are made.
        seed: of the choice of current keypoints.
        report: told how many problems of how many have been read.

    Raises:
        DatasetMismatchError: if the robot is not planar.
    """

    def __init__(
        self,
        experience: Experience,
        encoding: PlanarDistances,
        targets: HeatmapTargets,
        seed: int,
        report: Report = _silent,
    ) -> None:
        robot = experience.description.robot
        if robot.workspace_dimension != 2 or robot.dof != 2:
            found = f"{robot.workspace_dimension}, {robot.dof} joints"
            raise DatasetMismatchError(str(experience.folder), "workspace dimension of the robot", found, "2, 2 joints")
        self._targets = targets
        self._cells = encoding.cells // 2
        count = len(experience) * (1 + targets.both_ways)
        self._scenes = np.zeros((len(experience), encoding.cells, encoding.cells), np.float16)
        self._rows = np.zeros(count, np.int64)
        self._goals = np.zeros((count, 2), np.float32)
        self._currents = np.zeros((count, targets.currents, 2), np.float32)
        self._nexts = np.zeros((count, targets.currents, 2), np.float32)
        self._costs = np.zeros((count, self._cells**2), np.float16)
        options = DecompositionOptions(dimension=2, section_height=encoding.section_height)
        example = 0
        for number in range(len(experience)):
            scene = experience.scene(number)
            self._scenes[number] = encoding.encode(scene)
            frame = encoding.state_frame(scene)
            decomposition = decompose(scene, options)
            ends = (experience.goals[number], experience.starts[number])
            for way, goal in enumerate(ends[: 1 + targets.both_ways]):
                rng = np.random.default_rng([seed, number, way])
                try:
                    table = cost_to_go(decomposition, goal, targets.clearance_weight)
                except KeypointsUnavailableError:
                    continue
                drawn = _draw_currents(rng, table, targets.currents, targets.progress * frame.size)
                if drawn is None:
                    continue
                self._rows[example] = number
                self._goals[example] = frame.to_unit(goal)
                self._currents[example], self._nexts[example] = (frame.to_unit(points) for points in drawn)
                centres = frame.to_metres(unit_cell_centres(self._cells))
                costs, _ = table.first(np.column_stack((centres, np.full(len(centres), table.goal[2]))))
                self._costs[example] = np.where(np.isfinite(costs), costs / frame.size, np.nan)
                example += 1
            report(number + 1, len(experience))
        self._count = example

    def __len__(self) -> int:
        return self._count

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> dict[str, Tensor]:
        """distances (b, 2 c, 2 c), goals (b, 2), currents and nexts (b, m, 2), costs (b, c * c), NaN in obstacles.

        Current keypoints are drawn without replacement, more or less; plain batches take the first ones.
        """
        targets = self._targets
        count = min(targets.drawn, targets.currents)
        half = targets.currents // 2
        if rng is None:
            chosen = np.arange(count) * (targets.currents // count)
        else:
            chosen = rng.permutation(targets.currents)[:count]
        currents = self._currents[indices][:, chosen]
        if rng is not None:
            noise = rng.normal(0.0, targets.noise, currents.shape) * (chosen >= half)[None, :, None]
            currents = np.clip(currents + noise, 0.0, 1.0).astype(np.float32)
        symmetry = random_symmetry(rng)
        scenes = torch.from_numpy(self._scenes[self._rows[indices]].astype(np.float32))
        costs = torch.from_numpy(self._costs[indices].astype(np.float32)).view(-1, self._cells, self._cells)
        points = (self._goals[indices], currents, self._nexts[indices][:, chosen])
        goals, turned, nexts = (turned_points(symmetry, torch.from_numpy(array)) for array in points)
        return {
            "distances": turned_grids(symmetry, scenes),
            "goals": goals,
            "currents": turned,
            "nexts": nexts,
            "costs": turned_grids(symmetry, costs).flatten(1),
        }


class HeatmapObjective(nn.Module):
    """Cross-entropy of the next keypoint's cell, distance within the cell, and error of the cost to go.

    Args:
        network: to train.
        cost_weight: of the error of the cost to go, which is there to teach the way through the whole maze.
    """

    def __init__(self, network: KeypointHeatmap, cost_weight: float = 2.0) -> None:
        super().__init__()
        self.network = network
        self.cost_weight = cost_weight

    def forward(self, batch: dict[str, Tensor]) -> dict[str, Tensor]:
        network = self.network
        fields = network(batch["distances"], batch["goals"])
        cells = network.cells_of(batch["nexts"])
        logits = network.logits(fields, batch["currents"])
        entropy = functional.cross_entropy(logits.flatten(0, 1), cells.flatten())
        estimated = network.keypoints(fields).gather(1, cells[..., None].expand(-1, -1, 2))
        offset = network.cells * (estimated - batch["nexts"]).abs().mean()
        known = torch.isfinite(batch["costs"])
        cost = functional.smooth_l1_loss(fields.costs[known], batch["costs"][known], beta=0.1)
        loss = entropy + offset + self.cost_weight * cost
        correct = (logits.argmax(dim=2) == cells).float().mean()
        terms = {"entropy": entropy, "offset_cells": offset, "cost_error": cost, "correct_cell": correct}
        return {"loss": loss, **{name: term.detach() for name, term in terms.items()}}


def _draw_currents(
    rng: np.random.Generator, table: CostToGo, count: int, progress: float
) -> tuple[FloatArray, FloatArray] | None:
    """Current keypoints and the next one from each, (count, 2) each [m]; None if the goal is cut off from all.

    The first half lies anywhere free, the second on candidates.
    """
    decomposition = table.decomposition
    lower, upper = decomposition.bounds.lower, decomposition.bounds.upper
    half = count // 2
    points = np.zeros((0, 3))
    nodes = np.zeros(0, np.int64)
    reachable = np.flatnonzero(table.successors != NOWHERE)
    if not len(reachable):
        return None
    for _ in range(20):
        drawn = rng.uniform(lower, upper, (2 * count, 3))
        drawn[:, 2] = table.goal[2]
        _, first = table.first(drawn)
        points = np.concatenate((points, drawn[first != NOWHERE]))
        nodes = np.concatenate((nodes, first[first != NOWHERE]))
        if len(points) >= half:
            break
    else:
        return None
    chosen = rng.choice(reachable, count - half)
    points = np.concatenate((points[:half], decomposition.candidates[chosen]))
    nodes = np.concatenate((nodes[:half], table.successors[chosen]))
    for _ in range(4):
        places = _places(table, nodes)
        close = (nodes >= 0) & (np.linalg.norm(places - points, axis=1) < progress)
        if not close.any():
            break
        nodes = np.where(close, table.successors[nodes], nodes)
    return points[:, :2], _places(table, nodes)[:, :2]


def _places(table: CostToGo, nodes: NDArray[np.int64]) -> FloatArray:
    """(m, 3) where nodes are: candidates, or the goal."""
    if not table.decomposition.candidate_count:
        return np.broadcast_to(table.goal, (len(nodes), 3))
    return np.where((nodes >= 0)[:, None], table.decomposition.candidates[nodes], table.goal)
